"""Looks on demand, for a closed loop that acts on one frame at a time."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.live.tracker import Tracked
from doorway3ds.types import Decision, Frame


@dataclass(frozen=True)
class Update:
    """What is known after a frame, or after none came for too long.

    number: of the frame, counted from 1; of the last one if `fresh` is false.
    name: of the frame: a file of a folder, else the source.
    tracked: the decision with memory, and the frame's own.
    fresh: a frame was decided on; false: the camera is silent and the decision is `lost`.
    problem: why no frame comes, in words, or None.
    """

    number: int
    name: str
    tracked: Tracked
    fresh: bool = True
    problem: str | None = None

    @property
    def decision(self) -> Decision:
        """The decision with memory: act on this one."""
        return self.tracked.decision

    @property
    def raw(self) -> Decision:
        """The frame's own decision, without memory."""
        return self.tracked.raw


class Eyes(ABC):
    """Updates one by one, and from them the looks that a `TurnLoop` asks for.

    clock: of the frames' stamps.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._from_s = -math.inf  # frames older than this are of no use

    @property
    @abstractmethod
    def pipeline(self) -> Pipeline:
        """What decides."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Nothing further will come."""

    @abstractmethod
    def read(self, timeout_s: float | None = None) -> Update | None:
        """The next update; None if there is none within `timeout_s` seconds, or when `ended`."""

    @property
    def looks_down(self) -> bool:
        """Whether `check_way` has an answer: the paper's method knows no floor."""
        return self.pipeline.method == "opening"

    def look(
        self, after_s: float, within_s: float, expected_deg: float | None = None
    ) -> Decision | None:
        """The decision on a frame taken at `after_s` or later; None if none comes in time.

        expected_deg: stay with the doorway at this bearing (`Pipeline.stay`).

        Raises SourceLost if the source is gone.
        """
        raw = self._taken(after_s, within_s)
        return None if raw is None else self.pipeline.stay(raw, expected_deg)

    def check_way(
        self, after_s: float, within_s: float, decision: Decision
    ) -> tuple[Frame, bool | None] | None:
        """A frame that looks down along a decided way, and whether the way is free in it."""
        raw = self._taken(after_s, within_s)
        if raw is None:
            return None
        return raw.frame, self.pipeline.check_way(raw.frame, decision, raw.perception)

    def _taken(self, after_s: float, within_s: float) -> Decision | None:
        """A frame's own decision; older frames are left out."""
        self._from_s, deadline = after_s, self._clock() + within_s
        while not self.ended and (left := deadline - self._clock()) > 0:
            update = self.read(left)
            if update is not None and update.fresh and update.raw.frame.stamp_s >= after_s:
                return update.raw
        return None


class Relay(Eyes):
    """The newest of the updates that another thread reads, shows and offers here."""

    def __init__(self, pipeline: Pipeline) -> None:
        super().__init__()
        self._pipeline = pipeline
        self._news = threading.Condition()
        self._newest: Update | None = None
        self._error: BaseException | None = None
        self._over = False

    @property
    def pipeline(self) -> Pipeline:
        return self._pipeline

    @property
    def ended(self) -> bool:
        with self._news:
            return self._over and self._newest is None and self._error is None

    def offer(self, update: Update) -> None:
        """A further update; the one before is forgotten."""
        with self._news:
            self._newest = update
            self._news.notify_all()

    def end(self, error: BaseException | None = None) -> None:
        """No further update comes, because of `error` if there was one, which `read` raises."""
        with self._news:
            self._over, self._error = True, error
            self._news.notify_all()

    def read(self, timeout_s: float | None = None) -> Update | None:
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._over, timeout_s)
            newest, self._newest = self._newest, None
            if newest is None and self._error is not None:
                raise self._error
            return newest
