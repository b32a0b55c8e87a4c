"""The node's topics: the newest image as a live source, with camera and pose, and what is told."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from doorway3ds.camera.model import Pose
from doorway3ds.errors import UserError
from doorway3ds.live.eyes import Update
from doorway3ds.ros import messages
from doorway3ds.ros.messages import ros_message as make
from doorway3ds.ros.received import Calibration, image_of, stamp_of
from doorway3ds.sources.base import Source, View
from doorway3ds.types import Frame

_CALIBRATION_S = 1.0  # how long the first images wait for their camera_info
_ANNOTATED = "annotated/compressed"
TOPICS = {**messages.TOPICS, _ANNOTATED: "sensor_msgs/msg/CompressedImage"}
_OF_THE_IMAGE = ("depth", "camera_info")
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


class Outputs:
    """Publishes what is known after each frame."""

    def __init__(self, node: Any, image_topic: str, robot_frame: str) -> None:
        from rclpy.event_handler import PublisherEventCallbacks

        self._topic, self._robot_frame = image_topic, robot_frame
        # Each event that is listened for costs rclpy's executor time with every message.
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        self._by_name = {
            name: node.create_publisher(
                messages.message_class(kind), f"~/{name}", 1, event_callbacks=quiet
            )
            for name, kind in TOPICS.items()
        }

    def publish(self, update: Update) -> None:
        """Everything about one frame, or that no frame comes."""
        decision = update.decision
        assert isinstance(decision.frame, TopicFrame)
        seen = decision.frame.header
        top = messages.header(make, self._robot_frame, seen.stamp)
        out = messages.decided(make, top, seen, decision, lambda: self._answer(update))
        if update.fresh:
            out[_ANNOTATED] = lambda: _annotated(update)
        else:
            out = {name: message for name, message in out.items() if name not in _OF_THE_IMAGE}
        for name, message in out.items():
            if self._by_name[name].get_subscription_count() > 0:
                self._by_name[name].publish(message())

    def _answer(self, update: Update) -> dict[str, Any]:
        """The JSON of `3ds live --json`, and the header of the image that it is about."""
        frame = update.raw.frame
        assert isinstance(frame, TopicFrame)
        stamp = frame.header.stamp
        answer = update.raw.to_dict(self._topic)
        if not update.fresh:
            answer |= {"reason": str(update.decision.reason), "turn_deg": None}
        return {
            **answer,
            "stamp": {"sec": int(stamp.sec), "nanosec": int(stamp.nanosec)},
            "frame_id": frame.header.frame_id,
            "stamp_s": int(stamp.sec) + int(stamp.nanosec) * 1e-9,
            "tracked": update.tracked.to_dict(),
            "problem": update.problem,
        }


def _annotated(update: Update) -> Any:
    from doorway3ds.draw import overlay

    frame = update.decision.frame
    assert isinstance(frame, TopicFrame)
    return messages.compressed(make, frame.header, overlay(update.decision))
