"""A wrong focal length noticed before very many images are decided on."""

from __future__ import annotations

import contextlib
from itertools import islice

from doorway3ds.camera.vanishing import FocalWatch
from doorway3ds.errors import UserError
from doorway3ds.lab.batch.items import find_items
from doorway3ds.lab.batch.worker import Job

_TRIED = 20  # items: those of an assumed camera, or that cannot be read, do not count


def lens_doubt(sources: list[str], job: Job) -> str | None:
    """Why the camera's focal length is in doubt by the first images, in one line, or None."""
    watch = FocalWatch()
    for item in islice(find_items(sources), _TRIED):
        with contextlib.suppress(UserError):  # which its row will say
            frame = job.frame(item, b"" if item.frame is not None else item.read())
            watch.look(frame.image, frame.camera)
        if watch.done:
            break
    return watch.doubt
