"""An image topic as a live source: the newest image, with its camera and pose."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from doorway3ds.camera.model import Pose
from doorway3ds.errors import UserError
from doorway3ds.ros.received import Calibration, image_of, stamp_of
from doorway3ds.sources.base import Source, View
from doorway3ds.types import Frame

_CALIBRATION_S = 1.0  # how long the first images wait for their camera_info
_EARLY_S, _OLD_S = 0.05, 60.0  # stamps beyond these are of another clock


@dataclass(frozen=True)
class TopicFrame(Frame):
    """A frame and its message's header.

    stamp_s: exposure on `time.monotonic()`'s clock, or arrival if the header's stamp is of another
    clock than the node's; `timed` is then false, and nothing may move by this frame.
    """

    header: Any = None
    timed: bool = True


@dataclass(frozen=True)
class _Shot:
    message: Any
    arrived_s: float
    age_s: float


class TopicSource(Source):
    """Holds one image, the newest; a node offers them.

    clock: the node's time in seconds. pose: the camera's, by its message, None if it is not known.
    """

    live = True

    def __init__(
        self,
        name: str,
        view: View,
        *,
        clock: Callable[[], float],
        pose: Callable[[Any], Pose | None] = lambda message: None,
    ) -> None:
        super().__init__(name)
        self._view, self._clock, self._pose = view, clock, pose
        self._calibration = Calibration(f"camera_info of {name}", rectified="rect" in name)
        self._news = threading.Condition()
        self._shot: _Shot | None = None
        self._info: Any = None
        self._begun_s: float | None = None
        self.arrived_s: float | None = None
        self._images = self._infos = 0
        self.problem = "no image has come"

    def offer(self, message: Any) -> None:
        """A new image; one that nobody took is forgotten and counted as skipped."""
        now = time.monotonic()
        age_s = self._clock() - stamp_of(message)
        with self._news:
            self.skipped += self._shot is not None
            self._shot, self.arrived_s = _Shot(message, now, age_s), now
            self._begun_s = self._begun_s or now
            self._images += 1
            self._news.notify_all()

    def calibrate(self, message: Any) -> None:
        """A new `camera_info`, used for the images from now on."""
        with self._news:
            self._info = message
            self._infos += 1

    def counts(self) -> tuple[int, int]:
        """Images, and messages of `camera_info`, that came since the last call."""
        with self._news:
            found = self._images, self._infos
            self._images = self._infos = 0
        return found

    def silent_s(self) -> float:
        """Seconds since the last image; infinity before the first."""
        arrived_s = self.arrived_s
        return float("inf") if arrived_s is None else time.monotonic() - arrived_s

    def read(self, timeout_s: float | None = None) -> Frame | None:
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while not self.ended:
            with self._news:
                left = None if deadline is None else deadline - time.monotonic()
                self._news.wait_for(lambda: self._shot is not None or self.ended, left)
                shot, info, self._shot = self._shot, self._info, None
            if shot is None:
                if not self.ended and self.arrived_s is not None:
                    self.problem = f"no image for {self.silent_s():.1f} s"
                return None
            if info is None and self._waits(shot):
                continue
            try:
                frame = self._frame(shot, info)
            except UserError as error:
                self._leave_out(str(error))
                continue
            self.problem = None if frame.timed else _another_clock(shot.age_s)
            return frame
        return None

    def close(self) -> None:
        with self._news:
            self.ended = True
            self._news.notify_all()

    def _waits(self, shot: _Shot) -> bool:
        """Whether the calibration may still come; its topic begins as the images' does."""
        if self._view.camera is not None or self._begun_s is None:
            return False
        return shot.arrived_s - self._begun_s < _CALIBRATION_S

    def _frame(self, shot: _Shot, info: Any) -> TopicFrame:
        image = image_of(shot.message, self.name)
        camera = None
        if info is not None and self._view.camera is None:
            camera = self._calibration.camera(info)
            if camera is not None:
                camera = camera.scaled_to(image.shape[1], image.shape[0])
        timed = -_EARLY_S <= shot.age_s <= _OLD_S
        stamp_s = shot.arrived_s - max(0.0, shot.age_s) if timed else shot.arrived_s
        frame = self._view.frame(image, stamp_s, camera=camera, pose=self._pose(shot.message))
        return TopicFrame(
            frame.image, frame.camera, frame.pose, stamp_s, shot.message.header, timed
        )

    def _leave_out(self, problem: str) -> None:
        self.damaged += 1
        if problem != self.problem:
            self.notice(problem)
        self.problem = problem


def _another_clock(age_s: float) -> str:
    return (
        f"the image's stamp is {age_s:.1f} s behind the node's clock: decisions are made, but "
        "nothing moves; is use_sim_time set as it is for the camera?"
    )
