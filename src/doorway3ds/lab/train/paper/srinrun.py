"""One training of CNN-SRIN: features, head, optional fine-tuning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.datasets.doors import DoorPictures
from doorway3ds.lab.evaluate import classifier
from doorway3ds.lab.evaluate.classifier import ClassifierMetrics, ClassifierRecord
from doorway3ds.lab.evaluate.intervals import plain
from doorway3ds.lab.evaluate.report import pages
from doorway3ds.lab.evaluate.report.html import Report
from doorway3ds.lab.train.engine import outcome
from doorway3ds.lab.train.engine.backend import device_of
from doorway3ds.lab.train.engine.loop import Data, LoopConfig, Row
from doorway3ds.lab.train.engine.training import Loaded, Run, Training, loop_config
from doorway3ds.lab.train.options import SrinOptions
from doorway3ds.lab.train.paper import cnn_srin
from doorway3ds.lab.train.paper.cnn_srin import FeatureCache, Wanted
from doorway3ds.networks.cnn_srin import SIDE

FINE_TUNE_RATE = 1e-5


class Rows:
    """Features that are learned from; one or more rows per image."""

    def __init__(self, wanted: Sequence[Wanted], features: NDArray[np.float32]) -> None:
        self.names = [f"{w.sample.name}{f' (copy {w.copy})' if w.copy else ''}" for w in wanted]
        self.features = features
        self.labels = np.array([[w.sample.is_open] for w in wanted], np.float32)

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        return self.features[list(indices)], self.labels[list(indices)]


def wanted_rows(pictures: DoorPictures, indices: Sequence[int], copies: int = 0) -> list[Wanted]:
    """These images and so many augmented copies of each."""
    return [
        Wanted(pictures.samples[i], pictures.digests[i], copy)
        for copy in range(copies + 1)
        for i in indices
    ]


class SrinTraining(Training):
    """The head on VGG16's features, kept in out/features.npz, then VGG16's top block.

    side: of the input; `3ds look` needs 224.
    """

    name = "cnn-srin"

    def __init__(
        self, pictures: DoorPictures, options: SrinOptions, run: Run, side: int = SIDE
    ) -> None:
        import keras

        self.pictures, self.options, self.run, self.side = pictures, options, run, side
        self.split = pictures.split(options.validation, options.seed)
        keras.utils.set_random_seed(options.seed)
        self._base = cnn_srin.build_base(options.first_weights, side)
        self._base.trainable = False
        self._head = cnn_srin.build_head()
        rows = wanted_rows(pictures, self.split.train, options.copies)
        held = wanted_rows(pictures, self.split.held)
        cache = FeatureCache(run.out / "features.npz", self._base, options.seed)
        if run.team.leads:
            cache.features([*rows, *held], seen=run.seen)
        run.team.told(None)  # the others wait for the file
        if not run.team.leads:
            cache = FeatureCache(run.out / "features.npz", self._base, options.seed)
        self._train, self._held = (Rows(own, cache.features(own)) for own in (rows, held))
        self._identity = outcome.identity(
            [*(pictures.digests[i] for i in self.split.train), "held"],
            pictures.digests,
            cnn_srin.weights_digest(self._base),
            options.copies,
            options.fine_tune,
            options.validation,
        )

    def fit_head(self, config: LoopConfig) -> list[Row]:
        """Trains the head alone."""
        loop = self.run.loop(
            self._head, cnn_srin.losses, self._train, self._held, config, identity=self._identity
        )
        return loop.run(self.run.resume)

    def fit(self) -> list[Row]:
        options = self.options
        history = self.fit_head(loop_config(options))
        self._whole = cnn_srin.join(self._base, self._head)
        if not options.fine_tune:
            return history
        # the second stage: VGG16's top block learns, too, a hundred times slower
        self._base.trainable = True
        for layer in self._base.layers:
            layer.trainable = layer.name.startswith(cnn_srin.TOP_BLOCK)
        train, held = self._read(self.split.train), self._read(self.split.held)
        loop = self.run.loop(
            self._whole,
            cnn_srin.losses,
            train,
            held,
            loop_config(
                options,
                epochs=options.fine_tune,
                learning_rate=FINE_TUNE_RATE,
                first=options.epochs,
            ),
            stem=f"fine-tune-after-{options.epochs}",  # another head needs another second stage
            identity=self._identity,
        )
        return history + loop.run(self.run.resume)

    def _read(self, part: Sequence[int]) -> Loaded:
        """Images for the whole network, in training augmented if copies are wanted."""
        options = self.options
        return Loaded(
            [self.pictures.samples[i] for i in part],
            lambda sample: (
                cnn_srin.picture(sample, self.side),
                np.array([sample.is_open], np.float32),
            ),
            (lambda image, label, rng: (cnn_srin.augmented(image, rng), label))
            if options.copies
            else None,
            options.seed,
        )

    def records(self) -> list[ClassifierRecord]:
        """What the network as it is says of the held-out images."""
        samples = [self.pictures.samples[i] for i in self.split.held]
        if self.options.fine_tune:
            p_open = predict(self._whole, self._read(self.split.held))
        else:
            p_open = predict(self._head, self._held)
        groups = [self.pictures.groups[i] for i in self.split.held]
        return [
            ClassifierRecord(s.name, group, bool(s.is_open), float(p), s.kinds)
            for s, group, p in zip(samples, groups, p_open, strict=True)
        ]

    def describe(self) -> dict[str, Any]:
        self._records = self.records()
        self._scored = classifier.score(self._records)
        labels = self.pictures.labels
        return {
            "initialised_from": self.options.weights,
            "pictures": {
                side: {label: sum(labels[i] == label for i in part) for label in sorted({*labels})}
                for side, part in (("train", self.split.train), ("held_out", self.split.held))
            },
            **self.pictures.told(self.split),
            "options": asdict(self.options),
            "held_out": plain(self._scored),
        }

    def export(self, path: Path, card: Mapping[str, Any]) -> float:
        shown = {key: card[key] for key in ("name", "date", "initialised_from")}
        return cnn_srin.export(self._whole, path, shown, self.side)

    def page(self, card: Mapping[str, Any]) -> Report:
        report = outcome.training_report(card, self.history)
        scored = {"held out": self._scored}
        report.tables.append(pages.classifier_table(scored))
        samples = {s.name: s for s in self.pictures.samples}
        pages.add_classifier_pictures(report, samples, {"held out": self._records}, scored)
        return report


@dataclass(frozen=True)
class EpochScores:
    """Held-out scores by epochs, the losses of every epoch, and near-copies across the split."""

    scored: dict[int, ClassifierMetrics]
    history: list[Row]
    leaks: int


def score_epochs(
    pictures: DoorPictures,
    options: SrinOptions,
    run: Run,
    epochs: Sequence[int],
    side: int = SIDE,
) -> EpochScores:
    """Held-out scores of the head after each of `epochs`; options.epochs is not used.

    One training, stopped and resumed: as the learning rate is constant and the order of images
    follows from seed and epoch alone, the weights after N epochs are those of a training for N.
    """
    training = SrinTraining(pictures, replace(options, fine_tune=0), run, side)
    scored: dict[int, ClassifierMetrics] = {}
    history: list[Row] = []
    for count in sorted(set(epochs)):
        training.run = replace(run, resume=bool(scored))
        history = training.fit_head(loop_config(options, epochs=count))
        scored[count] = classifier.score(training.records())
    return EpochScores(scored, history, len(training.split.leaks))


def predict(model: Any, data: Data, batch: int = 16) -> NDArray[np.float64]:
    """(N,) probabilities of a model that returns logits."""
    import torch

    found: list[float] = []
    for at in range(0, len(data.names), batch):
        inputs, _ = data.load(range(at, min(at + batch, len(data.names))), None)
        with torch.no_grad():
            tensor = torch.from_numpy(inputs).to(device_of(model))
            found += model(tensor, training=False).sigmoid().flatten().tolist()
    return np.array(found)
