"""One batch from its sources to its data set, and whether its camera's focal length is right."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from doorway3ds.camera.vanishing import FocalWatch
from doorway3ds.errors import UserError
from doorway3ds.lab.batch import on_ray, pool
from doorway3ds.lab.batch.items import Item, find_items
from doorway3ds.lab.batch.rows import DataSet
from doorway3ds.lab.batch.worker import Chunk, Job

CHUNK = 8
_TRIED = 20  # items: those of an assumed camera, or that cannot be read, do not count


@dataclass(frozen=True)
class Outcome:
    """How many images a call answered, left as they were, and could not answer."""

    answered: int
    kept: int
    errors: int


def run_batch(
    sources: list[str],
    out: Path,
    job: Job,
    settings: dict[str, Any],
    *,
    workers: int,
    ray: str | None = None,
    told: Callable[[Outcome], None] = lambda outcome: None,
) -> Outcome:
    """Decides for every image of the sources that has no row of the same content in `out`.

    settings: what the answers depend on, plain values. workers: processes on this machine.
    ray: address of a cluster, or "auto", instead of them. told: called after each image.

    Raises CallError for sources and folders that cannot be used, UserError if a row cannot be
    written; what was decided before is kept.
    """
    answered = kept = errors = 0
    with DataSet(out, settings) as rows:
        chunks = _chunks(rows, find_items(sources))
        answers = (
            pool.answers(chunks, job, workers) if ray is None else on_ray.answers(chunks, job, ray)
        )
        for _, row in answers:
            if row is None:
                kept += 1
            else:
                rows.add(row)
                errors += row["error"] is not None
                answered += row["error"] is None
            told(Outcome(answered, kept, errors))
    return Outcome(answered, kept, errors)


def _chunks(rows: DataSet, items: Iterable[Item]) -> Iterator[Chunk]:
    source = iter(items)
    while chunk := list(islice(source, CHUNK)):
        yield [(item, rows.known(item.name, item.occurrence)) for item in chunk]


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
