"""TensorBoard is told how a training goes, beside who else watches."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine.loop import Row, Watcher


class TensorBoard:
    """Writes each epoch's losses to folder as event files, training beside held out.

    watcher: is told of the same, first.

    A resumed training hides what an earlier one wrote of the same epochs. Raises UserError where
    the package is missing, before the training rather than after its first epoch.
    """

    def __init__(self, folder: Path, watcher: Watcher) -> None:
        if find_spec("tensorboard") is None:
            raise UserError("--tensorboard needs its package: pip install tensorboard")
        self._folder, self._watcher = folder, watcher
        self._writer: Any = None

    def batch(self, epoch: int, step: int, steps: int, losses: Row) -> None:
        self._watcher.batch(epoch, step, steps, losses)

    def epoch(self, row: Row) -> None:
        self._watcher.epoch(row)
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
