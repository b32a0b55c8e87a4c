"""The training loop of the paper's networks: epochs, checkpoints, early stopping, Ctrl-C.

A training that is stopped and resumed ends with the weights of one that was not: the order of
pictures and their augmentation follow from seed and epoch alone.
"""

from __future__ import annotations

import csv
import io
import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.train import checkpoint
from doorway3ds.train.engine import ALONE, Team, device_of

Row = dict[str, float]
Losses = Callable[[Any, Any], Mapping[str, Any]]
"""(output, target) tensors -> scalars, means over the batch; "loss" is what is made smaller."""


class Data(Protocol):
    """What is learned from: numbered pictures with their targets.

    load gives arrays of equal first axis. epoch: what augmentation may depend on, with the
    index; None means none.
    """

    @property
    def names(self) -> Sequence[str]: ...

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]: ...


class Watcher(Protocol):
    """Who is told how a training goes."""

    def batch(self, epoch: int, step: int, steps: int, losses: Row) -> None: ...

    def epoch(self, row: Row) -> None: ...


@dataclass(frozen=True)
class LoopConfig:
    """patience: epochs without a better validation loss before stopping; 0 = never, and the
    last weights are kept rather than the best. clip_norm: of all gradients together.
    half: compute in bfloat16, weights stay float32.
    """

    epochs: int
    learning_rate: float
    batch: int
    seed: int = 0
    clip_norm: float = 10.0
    patience: int = 0
    amsgrad: bool = False
    half: bool = False


@dataclass
class _Run:
    """Where a training stands: `epoch` whole epochs and `step` batches of the next are done."""

    epoch: int = 0
    step: int = 0
    sums: Row = field(default_factory=dict)
    history: list[Row] = field(default_factory=list)
    best: float = math.inf
    best_epoch: int = 0


class Loop:
    """Trains a Keras model on `train`, in folder/`stem`.npz and folder/`stem`.csv.

    identity: what must be the same for a resumed training (data, network, settings).
    """

    def __init__(
        self,
        model: Any,
        losses: Losses,
        train: Data,
        held: Data,
        config: LoopConfig,
        folder: Path,
        *,
        stem: str = "checkpoint",
        identity: str = "",
        watcher: Watcher | None = None,
        team: Team = ALONE,
    ) -> None:
        import keras

        if not train.names:
            raise UserError("no training pictures are left")
        self.model, self.losses, self.train, self.held = model, losses, train, held
        self.config, self.watcher, self.team = config, watcher, team
        self.checkpoint = folder / f"{stem}.npz"
        self.best = folder / f"{stem}-best.npz"
        self.log = folder / f"{stem}.csv"
        self.identity = f"{identity} {config.seed} {config.batch} {config.learning_rate}"
        self.optimizer = keras.optimizers.Adam(config.learning_rate, amsgrad=config.amsgrad)
        self.learns = list(model.trainable_variables)
        self.optimizer.build(self.learns)
        self._interrupted = False

    def run(self, resume: bool = False) -> list[Row]:
        """Trains to the last epoch or early stop; one row of losses per epoch.

        resume: go on from the checkpoint, where there is one.

        Raises UserError where a loss or gradient is not finite, naming the batch, and where the
        checkpoint belongs to another training. KeyboardInterrupt comes after the checkpoint.
        """
        goes_on = resume and self.team.leads and self.checkpoint.is_file()
        state: _Run = self.team.told(self._restore() if goes_on else _Run())
        self.team.align([*self.model.weights, *self.optimizer.variables])
        with self._watch_interrupt():
            while state.epoch < self.config.epochs and not self._should_stop(state):
                self._one_epoch(state)
        if self.config.patience:
            if self.team.leads and state.history:
                arrays, _ = checkpoint.load(self.best)
                self._put("w", self.model.weights, arrays, self.best)
            self.team.align(self.model.weights)
        return state.history

    def _one_epoch(self, state: _Run) -> None:
        order = np.random.default_rng((self.config.seed, state.epoch)).permutation(
            len(self.train.names)
        )
        size = self.config.batch
        batches = [order[at : at + size].tolist() for at in range(0, len(order), size)]
        while state.step < len(batches):
            indices = batches[state.step]
            for name, value in self._learn(indices, state.epoch, state.step).items():
                state.sums[name] = state.sums.get(name, 0.0) + value * len(indices)
            state.step += 1
            if self.watcher and self.team.leads:
                seen = min(state.step * size, len(order))
                means = {name: total / seen for name, total in state.sums.items()}
                self.watcher.batch(state.epoch + 1, state.step, len(batches), means)
            if self._anybody_interrupted():
                self._store(state)
                raise KeyboardInterrupt
        row: Row = {"epoch": state.epoch + 1}
        row |= {name: total / len(order) for name, total in state.sums.items()}
        if self.held.names:
            told = self.validate() if self.team.leads else {}
            row |= {f"val_{name}": value for name, value in self.team.told(told).items()}
        state.history.append(row)
        state.epoch, state.step, state.sums = state.epoch + 1, 0, {}
        judged = row.get("val_loss", row["loss"])
        if judged < state.best:
            state.best, state.best_epoch = judged, state.epoch
            if self.config.patience and self.team.leads:
                checkpoint.save(self.best, _numbered("w", self.model.weights), {})
        self._store(state)
        if self.watcher and self.team.leads:
            self.watcher.epoch(row)

    def _learn(self, indices: list[int], epoch: int, step: int) -> Row:
        """One batch: losses, gradients clipped together, one step of the optimizer."""
        import torch

        own = self.team.share(indices)
        self.model.zero_grad()
        found: dict[str, Any] = {}
        if own:
            image, target = self._tensors(self.train.load(own, epoch))
            with self._precision(image):
                output = self.model(image, training=True)
            found = dict(self.losses(output, target))
            weight = len(own) / len(indices)
            (found["loss"] * weight).backward()
        grads = [
            v.value.grad if v.value.grad is not None else torch.zeros_like(v.value)
            for v in self.learns
        ]
        self.team.add_up(grads)
        norm = torch.linalg.vector_norm(torch.stack([torch.linalg.vector_norm(g) for g in grads]))
        if not torch.isfinite(norm) or (own and not torch.isfinite(found["loss"])):
            names = ", ".join(self.train.names[i] for i in indices)
            raise UserError(
                f"training stopped: loss or gradient is not finite in epoch {epoch + 1}, "
                f"batch {step + 1} ({names}); look at these pictures or lower --learning-rate; "
                f"the last checkpoint is from before"
            )
        scale = min(1.0, self.config.clip_norm / max(float(norm), 1e-12))
        with torch.no_grad():
            self.optimizer.apply([g * scale for g in grads], self.learns)
        return {name: float(value.detach()) for name, value in found.items()}

    def validate(self) -> Row:
        """Means of all losses over the held-out pictures, without augmentation."""
        import torch

        sums: Row = {}
        count = len(self.held.names)
        for at in range(0, count, self.config.batch):
            indices = list(range(at, min(at + self.config.batch, count)))
            image, target = self._tensors(self.held.load(indices, None))
            with torch.no_grad(), self._precision(image):
                output = self.model(image, training=False)
            for name, value in self.losses(output, target).items():
                sums[name] = sums.get(name, 0.0) + float(value) * len(indices)
        return {name: total / count for name, total in sums.items()}

    def _tensors(self, arrays: tuple[Any, Any]) -> tuple[Any, Any]:
        import torch

        device = device_of(self.model)
        image, target = (torch.from_numpy(np.ascontiguousarray(a)).to(device) for a in arrays)
        return image, target

    def _precision(self, image: Any) -> Any:
        import torch

        return torch.autocast(image.device.type, torch.bfloat16, enabled=self.config.half)

    def _should_stop(self, state: _Run) -> bool:
        waited = state.epoch - state.best_epoch
        return bool(self.config.patience) and waited >= self.config.patience and state.step == 0

    def _store(self, state: _Run) -> None:
        if not self.team.leads:
            return
        arrays = _numbered("w", self.model.weights) | _numbered("o", self.optimizer.variables)
        told = {**vars(state), "identity": self.identity}
        checkpoint.save(self.checkpoint, arrays, told)
        if state.history:
            names = list(dict.fromkeys(name for row in state.history for name in row))
            text = io.StringIO()
            writer = csv.DictWriter(text, names, lineterminator="\n")
            writer.writeheader()
            writer.writerows(state.history)
            write_bytes(self.log, text.getvalue().encode())

    def _restore(self) -> _Run:
        arrays, state = checkpoint.load(self.checkpoint)
        if state.pop("identity", None) != self.identity:
            raise UserError(
                f"the checkpoint {self.checkpoint} is of another training (data, network, seed, "
                f"batch or learning rate differ); use another --out, or leave --resume out"
            )
        self._put("w", self.model.weights, arrays, self.checkpoint)
        self._put("o", self.optimizer.variables, arrays, self.checkpoint)
        return _Run(**state)

    def _put(self, letter: str, variables: Sequence[Any], arrays: Any, path: Path) -> None:
        for number, variable in enumerate(variables):
            value = arrays.get(f"{letter}{number}")
            if value is None or value.shape != tuple(variable.shape):
                raise UserError(
                    f"the checkpoint {path} does not fit {variable.path}: expected shape "
                    f"{tuple(variable.shape)}, got {None if value is None else value.shape}"
                )
            variable.assign(value)

    def _anybody_interrupted(self) -> bool:
        if self.team.size == 1:
            return self._interrupted
        import torch

        flag = torch.tensor([float(self._interrupted)], device=device_of(self.model))
        self.team.add_up([flag])
        return bool(flag.item())

    @contextmanager
    def _watch_interrupt(self) -> Iterator[None]:
        """Ctrl-C waits for the end of the batch, so that the checkpoint is of one moment."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def note(number: int, frame: Any) -> None:
            self._interrupted = True
            signal.signal(signal.SIGINT, before)  # the second one ends at once

        before = signal.signal(signal.SIGINT, note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)


def _numbered(letter: str, variables: Sequence[Any]) -> dict[str, Any]:
    return {f"{letter}{n}": v.value.detach().cpu().numpy() for n, v in enumerate(variables)}
