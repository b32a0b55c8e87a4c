"""A wrong focal length noticed while a camera is watched."""

from __future__ import annotations

import time
from collections.abc import Callable

from doorway3ds.camera.vanishing import FocalWatch
from doorway3ds.threads import Worker
from doorway3ds.types import Frame

_EVERY_S = 2.0  # another view by then, and little of the processor's time


class LensWatch:
    """Checks a few of the frames it is offered, in a thread of its own, and tells once.

    tell: called with one line if the room's lines contradict the camera.
    """

    def __init__(self, tell: Callable[[str], None], every_s: float = _EVERY_S) -> None:
        self._tell, self._every_s = tell, every_s
        self._watch = FocalWatch()
        self._worker: Worker | None = None
        self._due_s = 0.0

    @property
    def done(self) -> bool:
        """Whether it has seen enough, and told if there was something to tell."""
        return self._watch.done and not self._busy

    @property
    def _busy(self) -> bool:
        return self._worker is not None and self._worker.alive

    def offer(self, frame: Frame) -> None:
        """A further frame; returns at once."""
        now_s = time.monotonic()
        if self._busy or self._watch.done or now_s < self._due_s:
            return
        self._due_s = now_s + self._every_s
        self._worker = Worker(lambda: self._look(frame), "lens check")

    def _look(self, frame: Frame) -> None:
        self._watch.look(frame.image, frame.camera)
        if self._watch.done and self._watch.doubt is not None:
            self._tell(self._watch.doubt)
