"""One training of CNN-SRIN: features, head, optional fine-tuning, ONNX file, card, report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.datasets.doors import DoorPictures, Split, split_pictures
from doorway3ds.lab.datasets.samples import Sample
from doorway3ds.lab.evaluate import classifier
from doorway3ds.lab.evaluate.classifier import ClassifierMetrics, ClassifierRecord
from doorway3ds.lab.train.engine import outcome
from doorway3ds.lab.train.engine.backend import ALONE, Team, device_of, wants_half
from doorway3ds.lab.train.engine.loop import Data, Loop, LoopConfig, Row, Watcher
from doorway3ds.lab.train.onnx.file import export
from doorway3ds.lab.train.paper import cnn_srin
from doorway3ds.lab.train.paper.cnn_srin import FeatureCache, Wanted
from doorway3ds.networks.cnn_srin import SIDE

FINE_TUNE_RATE = 1e-5


@dataclass(frozen=True)
class SrinOptions:
    """copies: augmented copies of each training picture. fine_tune: epochs with VGG16's top
    block unfrozen, after the head's. weights: "imagenet", "none" or a file. side: of the input;
    `3ds look` needs 224.
    """

    epochs: int = 20
    learning_rate: float = 1e-3
    batch: int = 32
    weights: str = "imagenet"
    copies: int = 0
    fine_tune: int = 0
    validation: float = 0.2
    patience: int = 0
    seed: int = 0
    precision: str = "auto"
    side: int = SIDE


class Rows:
    """Features that are learned from; one or more rows per picture."""

    def __init__(
        self, names: Sequence[str], features: NDArray[np.float32], labels: Sequence[bool | None]
    ) -> None:
        self.names, self.features = names, features
        self.labels = np.array(labels, np.float32).reshape(-1, 1)

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        return self.features[list(indices)], self.labels[list(indices)]


class Pictures:
    """Pictures read anew each time, augmented where `augment` and there is an epoch."""

    def __init__(self, samples: Sequence[Sample], side: int, augment: bool, seed: int) -> None:
        self.names = [s.name for s in samples]
        self._samples, self._side, self._augment, self._seed = samples, side, augment, seed

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        images = []
        for index in indices:
            image = cnn_srin.picture(self._samples[index], self._side)
            if self._augment and epoch is not None:
                rng = np.random.default_rng((self._seed, epoch, index))
                image = cnn_srin.augmented(image, rng)
            images.append(image)
        labels = np.array([[self._samples[i].is_open] for i in indices], np.float32)
        return np.stack(images), labels


def training_rows(pictures: DoorPictures, split: Split, copies: int) -> list[Wanted]:
    """The pictures to learn from and their copies; copies are made after the split, of these
    pictures only."""
    return [
        Wanted(pictures.samples[i], pictures.digests[i], copy)
        for copy in range(copies + 1)
        for i in split.train
    ]


@dataclass(frozen=True)
class Prepared:
    """What the head's training needs: the split, the frozen part, and features of both sides."""

    split: Split
    base: Any
    head: Any
    train: Rows
    held: Rows
    identity: str

    def records(
        self, pictures: DoorPictures, p_open: NDArray[np.float64]
    ) -> list[ClassifierRecord]:
        """The held-out pictures with these probabilities."""
        return [
            ClassifierRecord(s.name, group, bool(s.is_open), float(p), s.kinds)
            for s, group, p in (
                (pictures.samples[i], pictures.groups[i], p)
                for i, p in zip(self.split.held, p_open, strict=True)
            )
        ]


def prepare(
    pictures: DoorPictures,
    options: SrinOptions,
    out: Path,
    *,
    seen: Callable[[int, int], None] = lambda done, total: None,
    team: Team = ALONE,
) -> Prepared:
    """Splits, builds both parts and computes the features, kept in out/features.npz."""
    import keras

    split = split_pictures(pictures, options.validation, options.seed)
    keras.utils.set_random_seed(options.seed)
    base = cnn_srin.build_base(_weights(options.weights), options.side)
    base.trainable = False
    head = cnn_srin.build_head()
    cache = FeatureCache(out / "features.npz", base, options.seed)
    rows = training_rows(pictures, split, options.copies)
    held = [Wanted(pictures.samples[i], pictures.digests[i]) for i in split.held]
    if team.leads:
        cache.features([*rows, *held], seen=seen)
    team.told(None)  # the others wait for the file
    if not team.leads:
        cache = FeatureCache(out / "features.npz", base, options.seed)
    return Prepared(
        split,
        base,
        head,
        _rows(rows, cache.features(rows)),
        _rows(held, cache.features(held)),
        _identity(pictures, split, options, cnn_srin.weights_digest(base)),
    )


def loop_config(options: SrinOptions) -> LoopConfig:
    """How the head is trained."""
    return LoopConfig(
        epochs=options.epochs,
        learning_rate=options.learning_rate,
        batch=options.batch,
        seed=options.seed,
        patience=options.patience,
        half=wants_half(options.precision),
    )


def train_cnn_srin(
    pictures: DoorPictures,
    options: SrinOptions,
    out: Path,
    *,
    resume: bool = False,
    watcher: Watcher | None = None,
    seen: Callable[[int, int], None] = lambda done, total: None,
    team: Team = ALONE,
    facts: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Trains, writes out/cnn-srin.onnx, its card and report.html; returns what the card says.

    watcher, seen: told of the training's and the features' progress. facts: for the card.
    """
    outcome.require_plots()
    ready = prepare(pictures, options, out, seen=seen, team=team)
    split, base, head, identity = ready.split, ready.base, ready.head, ready.identity
    config = loop_config(options)
    loop = Loop(
        head,
        cnn_srin.losses,
        ready.train,
        ready.held,
        config,
        out,
        identity=identity,
        watcher=watcher,
        team=team,
    )
    history = loop.run(resume)
    whole = cnn_srin.join(base, head)
    tuned: list[Row] = []
    if options.fine_tune:
        tuned = _fine_tune(
            whole, base, pictures, split, options, config, out, identity, resume, watcher, team
        )
    if not team.leads:
        return {}
    if options.fine_tune:
        samples_held = [pictures.samples[i] for i in split.held]
        p_open = predict(whole, Pictures(samples_held, options.side, False, 0))
    else:
        p_open = predict(head, ready.held)
    records = ready.records(pictures, p_open)
    scored = classifier.score(records)
    card = _card(pictures, split, options, scored, facts or {})
    path = out / "cnn-srin.onnx"
    card["parity"] = export(
        whole,
        path,
        [(3, options.side, options.side)],
        ["p_open"],
        lambda logits: logits.sigmoid().reshape(-1),
        {key: card[key] for key in ("name", "date", "initialised_from")},
        scale=255.0,
    )
    outcome.write_card(path, card)
    samples = {s.name: s for s in pictures.samples}
    outcome.classifier_report(out, card, [*history, *tuned], records, scored, samples)
    return card


def _fine_tune(
    whole: Any,
    base: Any,
    pictures: DoorPictures,
    split: Split,
    options: SrinOptions,
    config: LoopConfig,
    out: Path,
    identity: str,
    resume: bool,
    watcher: Watcher | None,
    team: Team,
) -> list[Row]:
    """The second stage: VGG16's top block learns, too, a hundred times slower."""
    base.trainable = True
    for layer in base.layers:
        layer.trainable = layer.name.startswith(cnn_srin.TOP_BLOCK)
    sides = [
        Pictures(
            [pictures.samples[i] for i in part], options.side, bool(options.copies), config.seed
        )
        for part in (split.train, split.held)
    ]
    second = LoopConfig(
        **{
            **asdict(config),
            "epochs": options.fine_tune,
            "learning_rate": FINE_TUNE_RATE,
            "first": options.epochs,
        }
    )
    loop = Loop(
        whole,
        cnn_srin.losses,
        sides[0],
        sides[1],
        second,
        out,
        stem=f"fine-tune-after-{options.epochs}",  # another head needs another second stage
        identity=identity,
        watcher=watcher,
        team=team,
    )
    return loop.run(resume)


def _rows(wanted: Sequence[Wanted], features: NDArray[np.float32]) -> Rows:
    names = [f"{w.sample.name} (copy {w.copy})" if w.copy else w.sample.name for w in wanted]
    return Rows(names, features, [w.sample.is_open for w in wanted])


def predict(model: Any, data: Data, batch: int = 16) -> NDArray[np.float64]:
    """(N,) probabilities of a model that gives logits."""
    import torch

    found: list[float] = []
    for at in range(0, len(data.names), batch):
        inputs, _ = data.load(range(at, min(at + batch, len(data.names))), None)
        with torch.no_grad():
            tensor = torch.from_numpy(inputs).to(device_of(model))
            found += model(tensor, training=False).sigmoid().flatten().tolist()
    return np.array(found)


def _weights(text: str) -> str | Path:
    return text if text in ("imagenet", "none") else Path(text)


def _identity(pictures: DoorPictures, split: Split, options: SrinOptions, base: str) -> str:
    return outcome.identity(
        [*(pictures.digests[i] for i in split.train), "held"],
        pictures.digests,
        base,
        options.copies,
        options.fine_tune,
        options.validation,
    )


def _card(
    pictures: DoorPictures,
    split: Split,
    options: SrinOptions,
    scored: ClassifierMetrics,
    facts: dict[str, Any],
) -> dict[str, Any]:
    return {
        "name": "cnn-srin",
        **outcome.when_and_where(),
        **facts,
        "initialised_from": options.weights,
        "pictures": {
            side: {
                label: sum(pictures.labels[i] == label for i in part)
                for label in sorted(set(pictures.labels))
            }
            for side, part in (("train", split.train), ("held_out", split.held))
        },
        "left_out": dict(pictures.left_out),
        "grouping": pictures.grouping,
        "groups": len(set(pictures.groups)),
        "near_copies_across_the_split": len(split.leaks),
        "options": asdict(options),
        "held_out": scored.to_dict(),
    }
