"""One line of progress on standard error, only where somebody watches it."""

from __future__ import annotations

import sys
import time
from types import TracebackType

_WIDTH = 24


class Progress:
    """A bar over `total` steps. `clear` it before writing anything else to the terminal."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._start = time.monotonic()
        self._shown = total > 1 and sys.stderr is not None and sys.stderr.isatty()

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.clear()

    def show(self, done: int) -> None:
        if not self._shown:
            return
        filled = _WIDTH * done // self._total
        left = (time.monotonic() - self._start) / max(done, 1) * (self._total - done)
        rest = f"  {left:.0f} s left" if done else ""
        bar = "━" * filled + "─" * (_WIDTH - filled)
        sys.stderr.write(f"\r\x1b[K{bar} {done}/{self._total}{rest}")
        sys.stderr.flush()

    def clear(self) -> None:
        if self._shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
