"""Fits doornet: mixed sources in batches of one shape, stages, averaged weights."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.data.augment import AugmentConfig, Target, view
from doorway3ds.lab.train.doornet.data.samples import Sample
from doorway3ds.lab.train.doornet.losses import LossWeights, all_losses
from doorway3ds.lab.train.doornet.model import DoorNet, split_at
from doorway3ds.lab.train.engine.backend import device_of
from doorway3ds.lab.train.engine.loop import LoopConfig, Row
from doorway3ds.lab.train.engine.outcome import identity as digest_of
from doorway3ds.lab.train.engine.training import Run

_NONE = 99  # more convolutions than the encoder has
_CLIP_NORM = 2.0
LANDSCAPE, PORTRAIT, WIDE = (192, 256), (256, 192), (160, 288)

Encode = Callable[[Any], list[Any]] | None
"""(B, 3, h, w) to features; None: the network takes the image itself."""


@dataclass(frozen=True)
class Stage:
    """One stretch of training.

    thaw: first convolution of the encoder that learns, by its number in the file; a number past
    the last keeps the encoder as it is.
    """

    epochs: int
    learning_rate: float
    thaw: int = _NONE


@dataclass(frozen=True)
class FitConfig:
    """What one training needs besides data.

    encoder_rate: learning rate of the encoder as a share of the rest's; its batch norm is
    folded, and at the full rate it forgets what it has learnt of scenes.
    patience: epochs without a better held-out loss after which a stage ends; 0: never.
    validate: at most about so many held-out images are looked at after each epoch; 0: all.
    """

    stages: tuple[Stage, ...]
    steps_per_epoch: int = 100
    batch: int = 16
    weight_decay: float = 1e-3
    shares: Mapping[str, float] | None = None  # share of each source in a batch
    portrait_shares: Mapping[str, float] | None = None  # in portrait batches; None = the same
    open_share: float = 0.45  # share of images with an opening, within each source
    ema: float = 0.99
    encoder_rate: float = 1.0
    seed: int = 1
    patience: int = 0
    validate: int = 0


def collate(targets: Sequence[Target]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(B, 3, h, w) float32 RGB 0..255, and every label stacked as float32."""
    image = np.stack([t.image for t in targets]).transpose(0, 3, 1, 2).astype(np.float32)
    names = [name for name in Target.__dataclass_fields__ if name != "image"]
    labels = {
        name: np.stack([np.asarray(getattr(t, name), np.float32) for t in targets])
        for name in names
    }
    return image, labels


def plain_shape(sample: Sample) -> tuple[int, int]:
    """(h, w) of the plain view that an image is judged by."""
    return PORTRAIT if sample.image.shape[0] > sample.image.shape[1] else LANDSCAPE


class Sampler:
    """Draws batches: sources by share, open and not open images by share, one shape each."""

    def __init__(self, samples: Sequence[Sample], config: FitConfig, augment: AugmentConfig):
        if not samples:
            raise UserError("no training images were found in the given data sets")
        self._config, self._augment = config, augment
        self._pools: dict[str, tuple[list[Sample], list[Sample]]] = {}
        for sample in samples:
            has_opening, has_none = self._pools.setdefault(sample.source, ([], []))
            (has_opening if sample.spans else has_none).append(sample)
        # a door photographed a hundred times must not teach a hundred times as much
        sizes = Counter(sample.place for sample in samples)
        self._chances = {
            id(pool): np.cumsum([sample.draws * sizes[sample.place] ** -0.5 for sample in pool])
            for pair in self._pools.values()
            for pool in pair
        }
        self._shares = self._normalised(config.shares)
        self._portrait_shares = self._normalised(config.portrait_shares or config.shares)

    def _normalised(self, shares: Mapping[str, float] | None) -> np.ndarray:
        weights = np.array([dict(shares or {}).get(name, 1.0) for name in self._pools], float)
        if not weights.any():
            raise UserError(
                f"the recipe's shares leave nothing of the images given: {', '.join(self._pools)}"
            )
        return np.asarray(weights / weights.sum())

    def draw(self, step: int) -> list[tuple[Sample, Target]]:
        """Batch number `step`, the same for the same seed whatever came before."""
        rng = np.random.default_rng((self._config.seed, step))
        shape = (LANDSCAPE, PORTRAIT, WIDE)[rng.choice(3, p=[0.72, 0.2, 0.08])]
        shares = self._portrait_shares if shape == PORTRAIT else self._shares
        drawn = []
        for _ in range(self._config.batch):
            name = list(self._pools)[rng.choice(len(self._pools), p=shares)]
            has_opening, has_none = self._pools[name]
            wanted = has_opening if rng.random() < self._config.open_share else has_none
            pool = wanted or has_opening or has_none
            chances = self._chances[id(pool)]
            sample = pool[int(np.searchsorted(chances, rng.random() * chances[-1]))]
            drawn.append((sample, view(sample, shape, rng, self._augment)))
        return drawn


class Drawn:
    """What a stage learns from: the batches from number `first` on, `steps` an epoch.

    Images are numbered through all batches. Each process of a team draws the whole batch, so
    that all together see what one alone would, and takes its share.
    """

    def __init__(self, sampler: Sampler, batch: int, first: int, steps: int, encode: Encode):
        self._sampler, self._batch, self._encode = sampler, batch, encode
        self._first, self._steps = first, steps
        self.names = _Names(sampler, batch)

    def batches(self, epoch: int | None) -> list[list[int]]:
        """Numbers of the images in each batch of an epoch of this stage."""
        start = self._first + (epoch or 0) * self._steps
        size = self._batch
        return [list(range(n * size, (n + 1) * size)) for n in range(start, start + self._steps)]

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        drawn = self._sampler.draw(indices[0] // self._batch)
        image, target = collate([drawn[index % self._batch][1] for index in indices])
        return (self._encode(image) if self._encode else image), target


class _Names(Sequence[str]):
    """Names of drawn images, found by drawing them again."""

    def __init__(self, sampler: Sampler, batch: int) -> None:
        self._sampler, self._batch = sampler, batch

    def __len__(self) -> int:
        return self._batch

    def __getitem__(self, index: Any) -> Any:
        return self._sampler.draw(index // self._batch)[index % self._batch][0].name


class Held:
    """Plain views of held-out images, in batches of one shape."""

    def __init__(self, samples: Sequence[Sample], batch: int, encode: Encode) -> None:
        self.names = [sample.name for sample in samples]
        self._samples, self._batch, self._encode = samples, batch, encode

    def batches(self, epoch: int | None) -> list[list[int]]:
        found = []
        for shape in (LANDSCAPE, PORTRAIT):
            own = [k for k, sample in enumerate(self._samples) if plain_shape(sample) == shape]
            found += [own[at : at + self._batch] for at in range(0, len(own), self._batch)]
        return found

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        samples = [self._samples[index] for index in indices]
        image, target = collate([view(s, plain_shape(s), None) for s in samples])
        return (self._encode(image) if self._encode else image), target


def fit(
    net: DoorNet,
    samples: Sequence[Sample],
    config: FitConfig,
    run: Run,
    *,
    augment: AugmentConfig,
    weights: LossWeights,
    held: Sequence[Sample] = (),
    half: bool = False,
    identity: str = "",
) -> list[Row]:
    """Trains `net` in place; one row of losses per epoch, stages one after the other.

    The averaged weights are in the model, and in run.out/stage-N.weights.h5, after each stage;
    run.out/stage-N.npz and .csv hold its checkpoint and losses after each epoch.

    held: images of other places, whose losses are told and decide with `config.patience`.
    identity: what else must be the same to resume.
    """
    import keras

    from doorway3ds.lab.train.doornet.export import OnnxEncoder

    run.out.mkdir(parents=True, exist_ok=True)
    keras.utils.set_random_seed(config.seed)
    sampler = Sampler(samples, config, augment)
    fixed = {**asdict(config), "patience": None, "validate": None, "stages": None}
    if config.validate:
        held = held[:: max(1, len(held) // config.validate)]
    same = [identity, fixed, asdict(augment), asdict(weights), sorted(s.name for s in samples)]
    history: list[Row] = []
    epochs = 0
    for number, stage in enumerate(config.stages):
        _thaw(net, stage)
        slow: tuple[Sequence[Any], float] = (), 1.0
        if config.encoder_rate != 1:
            slow = net.encoder.trainable_variables, config.encoder_rate
        # what does not learn runs in ONNX Runtime, which is three times as fast on a CPU
        front, rest = split_at(net, stage.thaw)
        apart = front is not None and device_of(net.whole).type == "cpu"
        encode = OnnxEncoder(front) if apart else None
        stem = f"stage-{number}"
        loop = run.loop(
            rest if apart else net.whole,
            functools.partial(_losses, weights=weights),
            Drawn(
                sampler,
                config.batch,
                epochs * config.steps_per_epoch,
                config.steps_per_epoch,
                encode,
            ),
            Held(held, config.batch, encode),
            LoopConfig(
                epochs=stage.epochs,
                learning_rate=stage.learning_rate,
                batch=config.batch,
                seed=config.seed,
                clip_norm=_CLIP_NORM,
                patience=config.patience,
                half=half,
                ema=config.ema,
                first=epochs,
            ),
            stem=stem,
            identity=digest_of(same, [asdict(s) for s in config.stages[: number + 1]]),
            optimizer=_optimizer(stage, config),
            slow=slow,
        )
        history += loop.run(run.resume)
        epochs += stage.epochs
        path = run.out / f"{stem}.weights.h5"
        if run.team.leads and (loop.learned or not path.is_file()):
            save_weights(net, path)
    return history


def _thaw(net: DoorNet, stage: Stage) -> None:
    for layer in net.encoder.layers:
        prefix, _, rest = layer.name.partition("_")
        if prefix == "sem" and rest[:2].isdigit():
            layer.trainable = int(rest[:2]) >= stage.thaw


def _optimizer(stage: Stage, config: FitConfig) -> Any:
    """AdamW; the rate warms up, then falls along a cosine to a fiftieth."""
    import keras

    steps = stage.epochs * config.steps_per_epoch
    schedule = keras.optimizers.schedules.CosineDecay(
        stage.learning_rate / 20,
        steps,
        warmup_target=stage.learning_rate,
        warmup_steps=min(100, steps // 5),
        alpha=0.02,
    )
    return keras.optimizers.AdamW(schedule, weight_decay=config.weight_decay)


def _losses(
    output: Mapping[str, Any], target: Mapping[str, Any], weights: LossWeights
) -> dict[str, Any]:
    """All losses in 32 bits, and their sum."""
    found = all_losses({name: value.float() for name, value in output.items()}, target, weights)
    return {"loss": sum(found.values()), **found}


def save_weights(net: DoorNet, path: Path) -> None:
    """The whole network's weights, whole or not at all; UserError where they cannot be written."""
    partial = path.with_name(f"part-{path.name}")
    try:
        net.whole.save_weights(partial)
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error
