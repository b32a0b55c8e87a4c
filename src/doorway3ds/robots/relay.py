"""Decisions on every frame, made elsewhere, handed to a closed loop that acts on one at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable

from doorway3ds.decide.follow import follow
from doorway3ds.types import Decision, Frame, Perception


class Relay:
    """Source and judgement of a `TurnLoop`, while another thread watches the same camera.

    The watcher offers every decision; the loop gets the newest, whenever it looks.
    stay: the decision about the doorway expected at a bearing; the pipeline's own `stay`.
    """

    def __init__(self, stay: Callable[[Decision, float | None], Decision] = follow) -> None:
        self._stay = stay
        self._news = threading.Condition()
        self._newest: Decision | None = None
        self._given: Decision | None = None
        self._error: BaseException | None = None
        self._over = False

    def offer(self, decision: Decision) -> None:
        """A further decision; the one before is forgotten."""
        with self._news:
            self._newest = decision
            self._news.notify_all()

    def end(self, error: BaseException | None = None) -> None:
        """No further decision comes, because of `error` if there was one."""
        with self._news:
            self._over, self._error = True, error
            self._news.notify_all()

    @property
    def ended(self) -> bool:
        with self._news:
            return self._over and self._newest is None

    def read(self, timeout_s: float | None = None) -> Frame | None:
        """The frame of the newest decision; None where none came in time, or when `ended`.

        Raises what ended the watcher: a UserError as it is, anything else as the bug that it is.
        """
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._over, timeout_s)
            if self._newest is None:
                if self._error is not None:
                    raise self._error
                return None
            self._given, self._newest = self._newest, None
            return self._given.frame

    def decide(self, frame: Frame, expected_deg: float | None) -> Decision:
        """The decision on the frame that `read` gave last, held to the doorway expected there."""
        return self._stay(self._on(frame), expected_deg)

    def perception(self, frame: Frame) -> Perception:
        """What the network saw in the frame that `read` gave last."""
        return self._on(frame).perception

    def _on(self, frame: Frame) -> Decision:
        if self._given is None or self._given.frame is not frame:
            raise ValueError("a relay decides on the frame that it gave last, and this is another")
        return self._given
