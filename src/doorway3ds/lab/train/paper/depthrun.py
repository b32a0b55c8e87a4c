"""One training of DenseDepth: pairs, network, ONNX file, card, report."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.samples import Sample, load_depth, load_frame
from doorway3ds.lab.evaluate import depth as scores
from doorway3ds.lab.evaluate.depth import DepthRecord
from doorway3ds.lab.evaluate.report import pages
from doorway3ds.lab.evaluate.runners import Protocol
from doorway3ds.lab.train.engine import outcome
from doorway3ds.lab.train.engine.backend import ALONE, Team, device_of, wants_half
from doorway3ds.lab.train.engine.calibrate import relative_depth_error
from doorway3ds.lab.train.engine.loop import Loop, LoopConfig, Watcher
from doorway3ds.lab.train.onnx.file import export
from doorway3ds.lab.train.paper import densedepth
from doorway3ds.lab.train.paper.densedepth import SETTINGS, Setting
from doorway3ds.lab.train.paper.depthpairs import DepthPairs, split_pairs, target
from doorway3ds.networks.adapter import squeeze

# As the published code: half of the pictures mirrored, half with the channels in another order.
MIRRORED, RECOLOURED = 0.5, 0.5
_ORDERS = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
_SHOWN = 8


@dataclass(frozen=True)
class DepthOptions:
    """freeze_encoder: as the paper's text says; trained, as the published code does.
    filters: of the decoder's first convolution; None: the encoder's own number.
    """

    setting: str = "nyu"
    epochs: int = 20
    learning_rate: float = 1e-4
    batch: int = 4
    weights: str = "imagenet"
    freeze_encoder: bool = False
    augment: bool = True
    filters: int | None = None
    validation: float = 0.1
    patience: int = 0
    seed: int = 0
    precision: str = "auto"


class Pairs:
    """Pictures (B, 3, h, w) RGB 0..1 with targets (B, 1, h/2, w/2), augmented where wanted."""

    def __init__(
        self, samples: Sequence[Sample], setting: Setting, augment: bool, seed: int
    ) -> None:
        self.names = [s.name for s in samples]
        self._samples, self._setting = samples, setting
        self._augment, self._seed = augment, seed

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        images, targets = [], []
        for index in indices:
            sample, setting = self._samples[index], self._setting
            image, truth = picture(sample, setting), target(sample, setting)
            if self._augment and epoch is not None:
                rng = np.random.default_rng((self._seed, epoch, index))
                image, truth = augmented(image, truth, rng)
            images.append(image)
            targets.append(truth)
        return np.stack(images), np.stack(targets)


def picture(sample: Sample, setting: Setting) -> NDArray[np.float32]:
    """(3, h, w) RGB 0..1: the whole picture squeezed into the input, as at run time."""
    image = load_frame(sample).image
    whole = squeeze(image, setting.width, setting.height, channels_last=False)
    return np.asarray(whole[0] / np.float32(255), np.float32)


def augmented(
    image: NDArray[np.float32], truth: NDArray[np.float32], rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Mirrored or not, with the colour channels in any order or not."""
    if rng.random() < RECOLOURED:
        image = image[list(_ORDERS[rng.integers(len(_ORDERS))])]
    if rng.random() < MIRRORED:
        image, truth = image[:, :, ::-1], truth[:, :, ::-1]
    return image, truth


def train_densedepth(
    pairs: DepthPairs,
    options: DepthOptions,
    out: Path,
    *,
    resume: bool = False,
    watcher: Watcher | None = None,
    team: Team = ALONE,
    facts: dict[str, Any] | None = None,
    blocks: Sequence[int] | None = None,
    setting: Setting | None = None,
) -> dict[str, Any]:
    """Trains, writes out/densedepth.onnx, its card and report.html; returns what the card says.

    The file's output is 10 m / depth as `3ds look` expects for the setting nyu, and farthest
    depth / depth for others. blocks, setting: other than the published network's.
    """
    import keras

    outcome.require_plots()
    setting = setting or SETTINGS[options.setting]
    train, held = split_pairs(pairs, options.validation, options.seed)
    keras.utils.set_random_seed(options.seed)
    weights = options.weights
    model = densedepth.build_densedepth(
        weights if weights in ("imagenet", "none") else Path(weights),
        size=(setting.height, setting.width),
        filters=options.filters,
        blocks=blocks,
    )
    if options.freeze_encoder:
        for layer in densedepth.encoder_layers(model):
            layer.trainable = False
    config = LoopConfig(
        epochs=options.epochs,
        learning_rate=options.learning_rate,
        batch=options.batch,
        seed=options.seed,
        patience=options.patience,
        amsgrad=True,
        half=wants_half(options.precision),
    )
    names = [s.name for s in pairs.samples]
    history = Loop(
        model,
        functools.partial(densedepth.losses, most=setting.most),
        Pairs([pairs.samples[i] for i in train], setting, options.augment, options.seed),
        Pairs([pairs.samples[i] for i in held], setting, False, options.seed),
        config,
        out,
        identity=outcome.identity(
            names, train, asdict(setting), weights, options.freeze_encoder, options.augment, blocks
        ),
        watcher=watcher,
        team=team,
    ).run(resume)
    if not team.leads:
        return {}
    card = {
        "name": "densedepth",
        **outcome.when_and_where(),
        **(facts or {}),
        "initialised_from": weights,
        "pictures": {"train": len(train), "held_out": len(held)},
        "left_out": dict(pairs.left_out),
        "grouping": pairs.grouping,
        "groups": len(set(pairs.groups)),
        "near_copies_across_the_split": len(groups.leaks(pairs.pairs, held)),
        "median_depth_m": pairs.median_m,
        "parameters": model.count_params(),
        "options": asdict(options),
    }
    records, predicted, error = _measure(model, pairs, held, setting)
    scored = scores.score(records)
    card |= {"depth_error": error, "held_out": scored.to_dict()}
    path = out / "densedepth.onnx"
    card["parity"] = export(
        model,
        path,
        [(3, setting.height, setting.width)],
        ["depth"],
        lambda raw: raw,
        {key: card[key] for key in ("name", "date", "initialised_from", "depth_error")}
        | {"farthest_m": setting.farthest_m},
    )
    outcome.write_card(path, card)
    report = outcome.depth_report(card, history, {Protocol("held out", "whole", False): scored})
    worst = sorted(records, key=lambda r: r.errors.delta1)[:_SHOWN]
    samples = {s.name: s for s in pairs.samples}
    tiles = [(samples[r.image], predicted[r.image], r) for r in worst if r.errors.pixels]
    pages.add_depth_pictures(
        report,
        {Protocol("held out", "whole", False): records},
        {"held out": tiles} if tiles else {},
    )
    outcome.finish_report(report, out, card, history)
    return card


def _measure(
    model: Any, pairs: DepthPairs, held: Sequence[int], setting: Setting
) -> tuple[list[DepthRecord], dict[str, NDArray[np.float32]], float]:
    """Errors of the held-out pictures, the maps in metres, and their relative error."""
    import torch

    records, maps, true, guessed = [], {}, [], []
    limits = (setting.nearest_m, setting.farthest_m)
    for index in held:
        sample = pairs.samples[index]
        with torch.no_grad():
            image = torch.from_numpy(picture(sample, setting)[None]).to(device_of(model))
            raw = model(image, training=False)[0, 0].float().cpu().numpy()
        depth = np.asarray(setting.farthest_m / np.clip(raw, 1.0, setting.most), np.float32)
        truth = load_depth(sample)
        assert truth is not None
        maps[sample.name] = depth
        records.append(
            scores.compare(sample.name, pairs.groups[index], depth, truth, limits_m=limits)
        )
        small = target(sample, setting)[0]
        true.append(np.where(small > 0, setting.farthest_m / np.maximum(small, 1e-6), 0).ravel())
        guessed.append(depth.ravel())
    return records, maps, relative_depth_error(np.concatenate(guessed), np.concatenate(true))
