"""A bar of progress on standard error, only where somebody watches it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from doorway3ds.threads import Worker

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as RichProgress
    from rich.progress import ProgressColumn
    from typing_extensions import Self

PACE_S = 3600.0  # time left is told by the pace of so many seconds


def bar(*, told: bool = False, rate: bool = False, console: Console | None = None) -> RichProgress:
    """Rich's bar and the time left, which leaves nothing behind once it is stopped.

    told: instead of the count, the task's fields `name` before it and `text` behind it.
    rate: steps a second and the task's description, too.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress
    from rich.table import Column

    rest = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    name = TextColumn("{task.fields[name]}") if told else MofNCompleteColumn()
    text: list[ProgressColumn] = []
    if told:
        text = [TextColumn("{task.fields[text]}", markup=False, table_column=rest)]
    if rate:
        text = [_rate(), TextColumn("{task.description}")]
    return RichProgress(
        name,
        BarColumn(20),
        TimeRemainingColumn(),
        *text,
        console=console or Console(stderr=True),
        expand=told,
        transient=True,
        # what is written to the standard streams is nobody else's to take
        redirect_stdout=False,
        redirect_stderr=False,
        speed_estimate_period=PACE_S,
    )


def _rate() -> ProgressColumn:
    from rich.progress import ProgressColumn, Task
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:.0f} a second" if task.speed else "")

    return Rate()


class _Shown:
    """A bar once there is one. `clear` it before writing anything else to the terminal."""

    def __init__(self) -> None:
        self._watched = sys.stderr is not None and sys.stderr.isatty()
        self._bar: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.clear()

    def clear(self) -> None:
        """Takes the bar away."""
        if self._bar is not None:
            self._bar.stop()


class Progress(_Shown):
    """How many are done of `total`."""

    def __init__(self, total: int = 0) -> None:
        super().__init__()
        self._total = total

    def __call__(self, done: int, total: int | None = None) -> None:
        """Shows the bar; another total, or none done, begins another, and all done ends it."""
        total = self._total if total is None else total
        if not self._watched or total < 2:
            return
        if done == total:
            self.clear()
            return
        if self._bar is None or total != self._total or done == 0:
            self.clear()
            self._bar, self._total = bar(), total
            self._bar.add_task("", total=total)
        self._bar.start()
        self._bar.update(self._bar.task_ids[0], completed=done)


class CountedBar(_Shown):
    """A bar over work whose size is counted while it runs, with its rate.

    count: returns the number of steps, or None if that cannot be known; called in a thread.
    """

    def __init__(self, count: Callable[[], int | None]) -> None:
        super().__init__()
        self._count = count

    def __enter__(self) -> Self:
        if self._watched:
            self._bar = bar(rate=True)
            self._bar.add_task("", total=None)
            self._bar.start()
            Worker(self._size, "count")
        return self

    def _size(self) -> None:
        self._bar.update(self._bar.task_ids[0], total=self._count())

    def __call__(self, done: int, about: str = "") -> None:
        """So many steps are done; `about` is written beside the bar."""
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=done, description=about)
