"""The training loop of all networks: epochs, checkpoints, early stopping, Ctrl-C.

A training that is stopped and resumed ends with the weights of one that was not: the order of
images, their augmentation and dropout follow from seed, epoch and step alone.
"""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.lab.datasets.csvfile import csv_bytes
from doorway3ds.lab.train.engine import checkpoint
from doorway3ds.lab.train.engine.average import Average
from doorway3ds.lab.train.engine.backend import ALONE, Team, device_of
from doorway3ds.lab.train.engine.prefetch import ahead

Row = dict[str, float]
Losses = Callable[[Any, Any], Mapping[str, Any]]
"""(output, target) tensors -> scalars, means over the batch; "loss" is what is made smaller."""


class Data(Protocol):
    """What is learned from: numbered images with their targets.

    load gives inputs and targets: arrays, lists or dicts of arrays, of equal first axis. It runs
    in a thread. epoch: what augmentation may depend on, with the index; None means none.
    """

    @property
    def names(self) -> Sequence[str]: ...

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]: ...


@runtime_checkable
class Planned(Data, Protocol):
    """Data that say themselves which images make up the batches of an epoch.

    Others are taken in an order drawn from seed and epoch, or with epoch None as they come.
    """

    def batches(self, epoch: int | None) -> list[list[int]]: ...


class Watcher(Protocol):
    """Who is told how a training goes."""

    def batch(self, epoch: int, step: int, steps: int, losses: Row) -> None: ...

    def epoch(self, row: Row) -> None: ...


@dataclass(frozen=True)
class LoopConfig:
    """patience: epochs without a better validation loss before stopping; 0 = never, and the
    last weights are kept rather than the best. clip_norm: of all gradients together.
    half: compute in bfloat16, weights stay float32. ema: decay per step of the moving average
    that is validated and kept; 0 = the weights themselves. first: epochs done before this loop,
    for counting on.
    """

    epochs: int
    learning_rate: float
    batch: int
    seed: int = 0
    clip_norm: float = 10.0
    patience: int = 0
    amsgrad: bool = False
    half: bool = False
    ema: float = 0.0
    first: int = 0


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
    optimizer: a Keras one; Adam by the config where none is given. slow: variables that take only
    this share of each of its steps.
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
        optimizer: Any = None,
        slow: tuple[Sequence[Any], float] = ((), 1.0),
        watcher: Watcher | None = None,
        team: Team = ALONE,
    ) -> None:
        import keras

        if not train.names:
            raise UserError("no training images are left")
        self.model, self.losses, self.train, self.held = model, losses, train, held
        self.config, self.watcher, self.team = config, watcher, team
        self.checkpoint = folder / f"{stem}.npz"
        self.best = folder / f"{stem}-best.npz"
        self.log = folder / f"{stem}.csv"
        self.identity = f"{identity} {config.seed} {config.batch} {config.learning_rate}"
        self.optimizer = optimizer or keras.optimizers.Adam(
            config.learning_rate, amsgrad=config.amsgrad
        )
        self.learns = list(model.trainable_variables)
        self._slow, self._pace = list(slow[0]), slow[1]
        self.optimizer.build(self.learns)
        weights = {id(weight) for weight in model.weights}
        self._noise = [v for v in model.variables if id(v) not in weights]
        self._average: Average | None = None
        self.learned = False  # whether this process's run took any step
        self._interrupted = False

    def run(self, resume: bool = False) -> list[Row]:
        """Trains to the last epoch or early stop; one row of losses per epoch.

        resume: go on from the checkpoint, where there is one.

        Raises UserError where a loss or gradient is not finite, naming the batch, and where the
        checkpoint belongs to another training. KeyboardInterrupt comes after the checkpoint.
        """
        if self.config.ema and self.team.leads:
            self._average = Average(self.model.weights, self.config.ema)
        goes_on = resume and self.team.leads and self.checkpoint.is_file()
        state: _Run = self.team.told(self._restore() if goes_on else _Run())
        self.team.align([*self.model.weights, *self.optimizer.variables])
        with self._watch_interrupt():
            while state.epoch < self.config.epochs and not self._should_stop(state):
                self._one_epoch(state)
        if self._average:
            self._average.put()
        if self.config.patience and self.team.leads and state.best_epoch:
            arrays, _ = checkpoint.load(self.best)
            self._put("w", self.model.weights, arrays, self.best)
        self.team.align(self.model.weights)
        return state.history

    def _one_epoch(self, state: _Run) -> None:
        epoch, number = state.epoch, self.config.first + state.epoch + 1
        batches = self._batches(self.train, epoch)

        def load(indices: list[int]) -> tuple[Any, Any] | None:
            own = self.team.share(indices)
            return self.train.load(own, epoch) if own else None

        seen = sum(len(batch) for batch in batches[: state.step])
        with closing(ahead(load, batches[state.step :])) as loads:
            for loaded in loads:
                indices = batches[state.step]
                for name, value in self._learn(indices, loaded, number, state.step).items():
                    state.sums[name] = state.sums.get(name, 0.0) + value * len(indices)
                state.step += 1
                seen += len(indices)
                if self.watcher and self.team.leads:
                    means = {name: total / seen for name, total in state.sums.items()}
                    self.watcher.batch(number, state.step, len(batches), means)
                if self._anybody_interrupted():
                    self._store(state)
                    raise KeyboardInterrupt
        row: Row = {"epoch": number}
        row |= {name: total / seen for name, total in state.sums.items()}
        with self._average.shown() if self._average else nullcontext():
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

    def _batches(self, data: Data, epoch: int | None) -> list[list[int]]:
        if isinstance(data, Planned):
            return data.batches(epoch)
        count, size = len(data.names), self.config.batch
        order = np.arange(count)
        if epoch is not None:
            order = np.random.default_rng((self.config.seed, epoch)).permutation(count)
        return [order[at : at + size].tolist() for at in range(0, count, size)]

    def _learn(
        self, indices: list[int], loaded: tuple[Any, Any] | None, epoch: int, step: int
    ) -> Row:
        """One batch: losses, gradients clipped together, one step of the optimizer.

        loaded: this process's share of it, None where that is empty. epoch: counted from 1.
        """
        import torch

        self.model.zero_grad()
        self._seed_noise(epoch, step)
        found: dict[str, Any] = {}
        if loaded:
            inputs, target = self._tensors(loaded)
            with self._precision():
                output = self.model(inputs, training=True)
            found = dict(self.losses(output, target))
            weight = len(self.team.share(indices)) / len(indices)
            (found["loss"] * weight).backward()
        grads = [
            v.value.grad if v.value.grad is not None else torch.zeros_like(v.value)
            for v in self.learns
        ]
        self.team.add_up(grads)
        norm = torch.linalg.vector_norm(torch.stack([torch.linalg.vector_norm(g) for g in grads]))
        if not torch.isfinite(norm) or (found and not torch.isfinite(found["loss"])):
            names = ", ".join(self.train.names[i] for i in indices)
            raise UserError(
                f"training stopped: loss or gradient is not finite in epoch {epoch}, "
                f"batch {step + 1} ({names}); look at these images or lower the learning rate; "
                f"the last checkpoint is from before"
            )
        scale = min(1.0, self.config.clip_norm / max(float(norm), 1e-12))
        with torch.no_grad():
            # Keras' optimizers know one rate only; a share of the step is a share of the rate
            before = [v.value.detach().clone() for v in self._slow]
            self.optimizer.apply([g * scale for g in grads], self.learns)
            for variable, old in zip(self._slow, before, strict=True):
                variable.value.copy_(torch.lerp(old, variable.value, self._pace))
        self.learned = True
        if self._average:
            self._average.follow(int(self.optimizer.iterations.value))
        return {name: float(value.detach()) for name, value in found.items()}

    def validate(self) -> Row:
        """Means of all losses over the held-out images, without augmentation."""
        import torch

        sums: Row = {}
        count = 0
        batches = self._batches(self.held, None)
        with closing(ahead(lambda indices: self.held.load(indices, None), batches)) as loads:
            for indices, loaded in zip(batches, loads, strict=True):
                inputs, target = self._tensors(loaded)
                with torch.no_grad(), self._precision():
                    output = self.model(inputs, training=False)
                for name, value in self.losses(output, target).items():
                    sums[name] = sums.get(name, 0.0) + float(value) * len(indices)
                count += len(indices)
        return {name: total / count for name, total in sums.items()}

    def _tensors(self, arrays: tuple[Any, Any]) -> tuple[Any, Any]:
        import keras
        import torch

        device = device_of(self.model)

        def tensor(array: Any) -> Any:
            return torch.from_numpy(np.ascontiguousarray(array)).to(device)

        def laid_out(value: Any) -> Any:
            # this layout of memory makes convolutions faster: 1.6 times doornet's on a CPU
            layout = torch.channels_last if value.ndim == 4 else torch.contiguous_format
            return value.contiguous(memory_format=layout)

        inputs, target = keras.tree.map_structure(tensor, arrays)
        return keras.tree.map_structure(laid_out, inputs), target

    def _seed_noise(self, epoch: int, step: int) -> None:
        """Dropout follows from seed, epoch, step and process, whatever was drawn before."""
        import torch

        parts = (self.config.seed, epoch, step, self.team.rank)
        first, *others = np.random.SeedSequence(parts).generate_state(1 + len(self._noise))
        torch.manual_seed(int(first))
        for state, seed in zip(self._noise, others, strict=True):
            state.assign([int(seed) >> 1, 0])  # as Keras makes its own: below 2**31

    def _precision(self) -> Any:
        import torch

        device = device_of(self.model).type
        return torch.autocast(device, torch.bfloat16, enabled=self.config.half)

    def _should_stop(self, state: _Run) -> bool:
        waited = state.epoch - state.best_epoch
        return bool(self.config.patience) and waited >= self.config.patience and state.step == 0

    def _store(self, state: _Run) -> None:
        if not self.team.leads:
            return
        arrays = _numbered("w", self.model.weights) | _numbered("o", self.optimizer.variables)
        if self._average:
            arrays |= {f"a{n}": mean.cpu().numpy() for n, mean in enumerate(self._average.means)}
        told = {**vars(state), "identity": self.identity}
        checkpoint.save(self.checkpoint, arrays, told)
        if state.history:
            names = list(dict.fromkeys(name for row in state.history for name in row))
            write_bytes(self.log, csv_bytes(names, state.history))

    def _restore(self) -> _Run:
        arrays, state = checkpoint.load(self.checkpoint)
        if state.pop("identity", None) != self.identity:
            raise UserError(
                f"the checkpoint {self.checkpoint} is of another training (data, network or "
                f"settings differ); use another --out, or leave --resume out"
            )
        self._put("w", self.model.weights, arrays, self.checkpoint)
        self._put("o", self.optimizer.variables, arrays, self.checkpoint)
        if self._average:
            with self._average.shown():
                self._put("a", self.model.weights, arrays, self.checkpoint)
                self._average.take()
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
