"""A progress bar with rate and time left, on a terminal only."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any


class RateBar:
    """Steps a second and the time left of work whose size is counted while it runs.

    count: returns the number of steps, or None if that cannot be known; called in a thread.
    """

    def __init__(self, count: Callable[[], int | None]) -> None:
        self._count = count
        self._progress: Any = None
        self._task: Any = None

    def __enter__(self) -> RateBar:
        if sys.stderr is None or not sys.stderr.isatty():
            return self
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            ProgressColumn,
            Task,
            TextColumn,
            TimeRemainingColumn,
        )
        from rich.text import Text

        class Rate(ProgressColumn):
            def render(self, task: Task) -> Text:
                speed = task.finished_speed or task.speed
                return Text(f"{speed:.0f} a second" if speed else "")

        self._progress = Progress(
            BarColumn(),
            MofNCompleteColumn(),
            Rate(),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._progress.add_task("", total=None)
        self._progress.start()
        threading.Thread(target=self._size, daemon=True).start()
        return self

    def _size(self) -> None:
        self._progress.update(self._task, total=self._count())

    def show(self, done: int, about: str = "") -> None:
        """So many steps are done; `about` is written beside the bar."""
        if self._progress is not None:
            self._progress.update(self._task, completed=done, description=about)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._progress is not None:
            self._progress.stop()
