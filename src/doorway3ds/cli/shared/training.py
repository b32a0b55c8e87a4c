"""How a command trains: its progress on standard error, its run, what it says at the end."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from doorway3ds.cli.shared.output import say
from doorway3ds.cli.shared.progress import Progress, bar
from doorway3ds.lab.train.options import RunOptions

if TYPE_CHECKING:
    from rich.console import Console

    from doorway3ds.lab.train.engine.training import Run


def command_line() -> str:
    """The command as typed, for the card."""
    return shlex.join(["3ds", *sys.argv[1:]])


class Watch:
    """Losses and time left on a live bar over all epochs; one lasting line per epoch."""

    def __init__(self, epochs: int, console: Console | None = None) -> None:
        self._epochs, self._console = epochs, console
        self._live = sys.stderr is not None and sys.stderr.isatty()
        self._bar: Any = None

    def batch(self, epoch: int, step: int, steps: int, losses: dict[str, float]) -> None:
        if not self._live:
            return
        if self._bar is None:
            self._bar = bar(told=True, console=self._console)
            self._bar.add_task("", name="", text="")
        told = {"loss": losses["loss"], **losses} if "loss" in losses else losses
        self._bar.start()
        self._bar.update(
            self._bar.task_ids[0],
            completed=(epoch - 1) * steps + step,
            total=self._epochs * steps,
            name=f"{epoch}/{self._epochs}",
            text=_text(told),
        )

    def epoch(self, row: dict[str, float]) -> None:
        if self._bar is not None:
            self._bar.stop()
        losses = {key: value for key, value in row.items() if key != "epoch"}
        say(f"epoch {row['epoch']:.0f}  {_text(losses)}")


@contextmanager
def running(out: Path, epochs: int, options: RunOptions, **facts: Any) -> Iterator[Run]:
    """A training's run, with progress told and the team of `torchrun`, if there is one.

    facts: for its card, beside the command.
    """
    from doorway3ds.lab.train.engine import backend
    from doorway3ds.lab.train.engine.training import Run
    from doorway3ds.lab.train.engine.watch import TensorBoard

    backend.start(options.threads)
    team = backend.join()
    watcher: Any = Watch(epochs)
    if options.tensorboard and team.leads:
        watcher = TensorBoard(out / "tensorboard", watcher)
    with Progress() as seen:
        told = {"command": command_line(), **facts}
        yield Run(out, options.resume, watcher, seen, team, told)
    backend.leave(team)


def _text(losses: dict[str, float]) -> str:
    return "  ".join(f"{name} {value:.4f}" for name, value in losses.items())
