"""The pace of things that have a time of their own, such as films."""

from __future__ import annotations

import threading
import time


class Clock:
    """Film time that runs as the clock on the wall does, from the first time it is asked."""

    def __init__(self) -> None:
        self._closing = threading.Event()
        self._zero_s: float | None = None

    def late_s(self, stamp_s: float) -> float:
        """How long ago `stamp_s` was due; negative where it is still to come."""
        now = time.monotonic()
        if self._zero_s is None:
            self._zero_s = now - stamp_s
        return now - self._zero_s - stamp_s

    def delay(self, seconds: float) -> None:
        """Sets the film's time back, where the reader cannot keep up."""
        if self._zero_s is not None:
            self._zero_s += seconds

    def wait_for(self, stamp_s: float, timeout_s: float | None) -> bool:
        """Waits until `stamp_s` is due, `timeout_s` at most; whether it is due."""
        ahead = -self.late_s(stamp_s)
        if ahead <= 0:
            return True
        if timeout_s is not None and timeout_s < ahead:
            self._closing.wait(timeout_s)
            return False
        return not self._closing.wait(ahead)

    def stop(self) -> None:
        """Ends every wait."""
        self._closing.set()
