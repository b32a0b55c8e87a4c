"""Who is told how a training goes: TensorBoard, and several watchers at once."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine.loop import Row, Watcher


class Together:
    """Tells several watchers."""

    def __init__(self, *watchers: Watcher) -> None:
        self._watchers = watchers

    def batch(self, epoch: int, step: int, steps: int, losses: Row) -> None:
        for watcher in self._watchers:
            watcher.batch(epoch, step, steps, losses)

    def epoch(self, row: Row) -> None:
        for watcher in self._watchers:
            watcher.epoch(row)


class TensorBoard:
    """Writes each epoch's losses to folder as event files, training beside held out.

    A resumed training hides what an earlier one wrote of the same epochs. Raises UserError where
    the package is missing, before the training rather than after its first epoch.
    """

    def __init__(self, folder: Path) -> None:
        if find_spec("tensorboard") is None:
            raise UserError("--tensorboard needs its package: pip install tensorboard")
        self._folder = folder
        self._writer: Any = None

    def batch(self, epoch: int, step: int, steps: int, losses: Row) -> None:
        pass

    def epoch(self, row: Row) -> None:
        number = int(row["epoch"])
        try:
            if self._writer is None:
                from torch.utils.tensorboard import SummaryWriter

                self._writer = SummaryWriter(str(self._folder), purge_step=number)
            for key, value in row.items():
                if key != "epoch":
                    held = key.startswith("val_")
                    side = "held out" if held else "training"
                    self._writer.add_scalar(f"{key.removeprefix('val_')}/{side}", value, number)
            self._writer.flush()
        except OSError as error:
            raise UserError(
                f"cannot write for TensorBoard to {self._folder}: {error.strerror or error}"
            ) from error
