"""One worker of a batch: a pipeline of its own, from an item to its row."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from doorway3ds.errors import UserError
from doorway3ds.lab.batch.items import Item
from doorway3ds.lab.batch.rows import Row, answered, unanswered
from doorway3ds.sources.base import View

if TYPE_CHECKING:
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.types import Decision, Frame

Chunk = Sequence[tuple[Item, str | None]]
"""Items, each with the digest that its row was made of, or None if it has no row."""


@dataclass(frozen=True)
class Job:
    """What is done with each item; it is sent to every worker.

    pipeline: makes the pipeline, in the worker. view: camera and pose that the user gave.
    annotate, depth: folders for annotated images and depth maps, or None.
    """

    pipeline: Callable[[], Pipeline]
    view: View
    annotate: Path | None = None
    depth: Path | None = None

    def frame(self, item: Item, data: bytes) -> Frame:
        """The frame of an item; data: its file, unused if it brings a frame of its own."""
        if item.frame is not None:
            frame = item.frame
            return self.view.frame(frame.image, frame.stamp_s, camera=frame.camera, pose=frame.pose)
        from doorway3ds.images.codec import read_image

        picture = read_image(data, name=item.name)
        try:
            return self.view.of_picture(picture)
        except UserError as error:
            raise UserError(f"{item.name}: {error}") from error


class Worker:
    """Answers chunks of items with one thread, so that several workers do not fight for cores."""

    def __init__(self, job: Job) -> None:
        import cv2

        cv2.setNumThreads(1)
        self._job = job
        self._decide = job.pipeline()

    def answer(self, chunk: Chunk) -> list[Row | None]:
        """A row for each item; None where the item is the same as when its row was made.

        Raises UserError only if an annotated image or a depth map cannot be written.
        """
        return [self._row(item, known) for item, known in chunk]

    def _row(self, item: Item, known: str | None) -> Row | None:
        digest = None
        try:
            data = item.frame.image.tobytes() if item.frame is not None else item.read()
            digest = hashlib.sha256(data).hexdigest()
            if digest == known:
                return None
            decision = self._decide(self._job.frame(item, data))
        except UserError as error:
            return unanswered(item.name, item.occurrence, digest, str(error))
        self._draw(item, digest, decision)
        return answered(item.name, item.occurrence, digest, decision)

    def _draw(self, item: Item, digest: str, decision: Decision) -> None:
        # The digest keeps images of one name in different folders apart.
        stem = f"{Path(item.name).stem[:80]}-{digest[:8]}"
        if self._job.annotate is not None:
            from doorway3ds.draw import annotate
            from doorway3ds.images.codec import write_image

            write_image(self._job.annotate / f"{stem}_3ds.jpg", annotate(decision))
        depth = decision.perception.depth_m
        if self._job.depth is not None and depth is not None:
            from doorway3ds.files import write_array

            write_array(self._job.depth / f"{stem}.npy", depth)
