"""Progress of a training on standard error: a live line where somebody watches it."""

from __future__ import annotations

import shlex
import shutil
import sys
import time
from collections import deque
from datetime import timedelta

from doorway3ds.cli.shared.progress import Progress

_WIDTH = 20


def command_line() -> str:
    """The command as typed, for the card."""
    return shlex.join(["3ds", *sys.argv[1:]])


class Watch:
    """Losses and time left of the epoch on a live line; one lasting line per epoch."""

    def __init__(self, epochs: int) -> None:
        self._epochs = epochs
        self._live = sys.stderr is not None and sys.stderr.isatty()
        self._times: deque[float] = deque()

    def batch(self, epoch: int, step: int, steps: int, losses: dict[str, float]) -> None:
        if not self._live:
            return
        self._times.append(time.monotonic())
        # the pace of the last epoch: later stages may be slower, and validation takes time, too
        while len(self._times) > steps + 1:
            self._times.popleft()
        left = ""
        if len(self._times) > 1:
            pace = (self._times[-1] - self._times[0]) / (len(self._times) - 1)
            missing = max(self._epochs * steps - ((epoch - 1) * steps + step), 0)
            left = f"{timedelta(seconds=round(pace * missing))} left  "
        filled = _WIDTH * step // steps
        bar = "━" * filled + "─" * (_WIDTH - filled)
        told = {"loss": losses["loss"], **losses} if "loss" in losses else losses
        line = f"{epoch}/{self._epochs} {bar} {left}{_text(told)}"
        # a line that wraps could not be taken back
        sys.stderr.write(f"\r\x1b[K{line[: shutil.get_terminal_size().columns - 1]}")
        sys.stderr.flush()

    def epoch(self, row: dict[str, float]) -> None:
        start = "\r\x1b[K" if self._live else ""
        losses = {key: value for key, value in row.items() if key != "epoch"}
        sys.stderr.write(f"{start}epoch {row['epoch']:.0f}  {_text(losses)}\n")
        sys.stderr.flush()


class Count:
    """A bar over something counted, such as pictures read; made anew for each count."""

    def __init__(self) -> None:
        self._bar: Progress | None = None
        self._total = 0

    def __call__(self, done: int, total: int) -> None:
        if self._bar is None or total != self._total or done == 0:
            self._bar, self._total = Progress(total), total
        self._bar.show(done)

    def clear(self) -> None:
        """Takes the bar away."""
        if self._bar is not None:
            self._bar.clear()


def say(text: str) -> None:
    """One line on standard error."""
    sys.stderr.write(text + "\n")


def _text(losses: dict[str, float]) -> str:
    return "  ".join(f"{name} {value:.4f}" for name, value in losses.items())
