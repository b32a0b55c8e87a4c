"""A wrong focal length noticed while a camera is watched."""

from __future__ import annotations

import time
from collections.abc import Callable

from doorway3ds.camera.vanishing import FocalWatch
from doorway3ds.threads import Worker
from doorway3ds.types import Frame

_EVERY_S = 2.0  # another view by then, and little of the processor's time
_MOST_CAMERAS = 4  # of one source; one that zooms has ever other ones


class LensWatch:
    """Checks a few of the frames it is offered, in a thread of its own, and tells once a camera.

    tell: called with one line if the room's lines contradict the camera. An assumed camera is not
        checked.
    """

    def __init__(self, tell: Callable[[str], None], every_s: float | None = None) -> None:
        self._tell = tell
        self._every_s = _EVERY_S if every_s is None else every_s
        self._watches: dict[tuple[str, float, int], FocalWatch] = {}
        self._watch: FocalWatch | None = None
        self._told: list[FocalWatch] = []
        self._worker: Worker | None = None
        self._due_s = 0.0

    @property
    def done(self) -> bool:
        """Whether it has seen enough of the present camera, and told if there was reason to."""
        return not self._busy and self._watch is not None and self._watch.done

    @property
    def doubt(self) -> str | None:
        """What was told of the present camera."""
        return self._watch.doubt if self._watch is not None and self._watch in self._told else None

    @property
    def _busy(self) -> bool:
        return self._worker is not None and self._worker.alive

    def offer(self, frame: Frame) -> None:
        """A further frame; returns at once."""
        camera = frame.camera
        if camera.assumed:
            self._watch = None
            return
        key = (camera.name, camera.fx, camera.width)
        if key not in self._watches and len(self._watches) < _MOST_CAMERAS:
            self._watches[key] = FocalWatch()
        self._watch = watch = self._watches.get(key)
        now_s = time.monotonic()
        if watch is None or watch.done or self._busy or now_s < self._due_s:
            return
        self._due_s = now_s + self._every_s
        self._worker = Worker(lambda: self._look(watch, frame), "lens check")

    def close(self) -> None:
        """No further frame comes: what a few frames have shown is told."""
        if self._watch is not None and not self._busy:
            self._report(self._watch)

    def _look(self, watch: FocalWatch, frame: Frame) -> None:
        watch.look(frame.image, frame.camera)
        if watch.done:
            self._report(watch)

    def _report(self, watch: FocalWatch) -> None:
        if watch.doubt is not None and watch not in self._told:
            self._told.append(watch)
            self._tell(watch.doubt)
