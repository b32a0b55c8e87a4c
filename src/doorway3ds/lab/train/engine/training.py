"""The skeleton of a training: fit, describe, export, judge, page; each network fills them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.datasets.places import Seen, unseen
from doorway3ds.lab.datasets.samples import Sample
from doorway3ds.lab.evaluate.report.html import Report, write_report
from doorway3ds.lab.train.engine import outcome
from doorway3ds.lab.train.engine.backend import ALONE, Team, wants_half
from doorway3ds.lab.train.engine.loop import Data, Loop, LoopConfig, Losses, Row, Watcher
from doorway3ds.lab.train.options import TrainOptions

Array = NDArray[np.float32]
Read = Callable[[Sample], tuple[Array, Array]]
Augment = Callable[[Array, Array, np.random.Generator], tuple[Array, Array]]


def loop_config(options: TrainOptions, **more: Any) -> LoopConfig:
    """How the loop runs by these options; more: of `LoopConfig`, over what they say."""
    told = {
        "epochs": options.epochs,
        "learning_rate": options.learning_rate,
        "batch": options.batch,
        "seed": options.seed,
        "patience": options.patience,
        "half": wants_half(options.precision),
    }
    return LoopConfig(**{**told, **more})


@dataclass(frozen=True)
class Run:
    """One run of a training.

    out: folder of checkpoints, logs and what it leaves. resume: go on from the checkpoint there.
    watcher, seen: told of the training's and of other progress. facts: what else the card says.
    """

    out: Path
    resume: bool = False
    watcher: Watcher | None = None
    seen: Seen = unseen
    team: Team = ALONE
    facts: Mapping[str, Any] = field(default_factory=dict)

    def loop(
        self, model: Any, losses: Losses, train: Data, held: Data, config: LoopConfig, **more: Any
    ) -> Loop:
        """What trains `model` in this run's folder; more: of `Loop`."""
        told = {"watcher": self.watcher, "team": self.team, **more}
        return Loop(model, losses, train, held, config, self.out, **told)


class Loaded:
    """Samples that are read anew each time.

    read: (input, target) of a sample. augment: the same changed at random, by a generator that
    seed, epoch and index determine; None means never.
    """

    def __init__(
        self, samples: Sequence[Sample], read: Read, augment: Augment | None, seed: int
    ) -> None:
        self.names = [sample.name for sample in samples]
        self._samples, self._read, self._augment, self._seed = samples, read, augment, seed

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        pairs = []
        for index in indices:
            pair = self._read(self._samples[index])
            if self._augment and epoch is not None:
                pair = self._augment(*pair, np.random.default_rng((self._seed, epoch, index)))
            pairs.append(pair)
        inputs, targets = zip(*pairs, strict=True)
        return np.stack(inputs), np.stack(targets)


class Training(ABC):
    """One network's training."""

    name: ClassVar[str]
    run: Run
    history: list[Row]

    @abstractmethod
    def fit(self) -> list[Row]:
        """Trains; one row of losses per epoch."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """What the card says of data, options and the held-out scores."""

    @abstractmethod
    def export(self, path: Path, card: Mapping[str, Any]) -> float:
        """Writes the ONNX file; the largest difference to Keras."""

    def judge(self, path: Path) -> dict[str, Any]:
        """What the card says of the written file; nothing unless a network's training does."""
        return {}

    @abstractmethod
    def page(self, card: Mapping[str, Any]) -> Report:
        """The report, with tables and plots of the held-out scores."""

    def train(self) -> dict[str, Any]:
        """Trains and writes NAME.onnx and its card; returns what the card says.

        Empty in every process of a team but the leader's.
        """
        self.history = self.fit()
        if not self.run.team.leads:
            return {}
        card = {"name": self.name, **outcome.when_and_where(), **self.run.facts, **self.describe()}
        path = self.run.out / f"{self.name}.onnx"
        card["parity"] = self.export(path, card)
        card |= self.judge(path)
        outcome.write_card(path, card)
        return card

    def __call__(self) -> dict[str, Any]:
        """The same with report.html."""
        outcome.require_plots()
        card = self.train()
        if card:
            data = {"card": card, "history": self.history}
            write_report(self.page(card), self.run.out, data)
        return card
