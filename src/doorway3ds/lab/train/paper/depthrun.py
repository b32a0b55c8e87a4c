"""One training of DenseDepth on images with depth."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.datasets.samples import Sample, load_depth, load_frame
from doorway3ds.lab.evaluate import depth as scores
from doorway3ds.lab.evaluate.depth import DepthRecord
from doorway3ds.lab.evaluate.intervals import plain
from doorway3ds.lab.evaluate.report import pages
from doorway3ds.lab.evaluate.report.html import Report
from doorway3ds.lab.evaluate.runners import Protocol
from doorway3ds.lab.train.engine import outcome
from doorway3ds.lab.train.engine.backend import device_of
from doorway3ds.lab.train.engine.calibrate import relative_depth_error
from doorway3ds.lab.train.engine.loop import Row
from doorway3ds.lab.train.engine.training import Loaded, Run, Training, loop_config
from doorway3ds.lab.train.options import DepthOptions
from doorway3ds.lab.train.paper import densedepth
from doorway3ds.lab.train.paper.densedepth import SETTINGS, Setting
from doorway3ds.lab.train.paper.depthpairs import DepthPairs, target
from doorway3ds.networks.adapter import squeeze

# As the published code: half of the images mirrored, half with the channels in another order.
MIRRORED, RECOLOURED = 0.5, 0.5
_ORDERS = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
HALF_DECODER = 832  # filters of the decoder's first convolution, the published code's default
_SHOWN = 8
_HELD_OUT = Protocol("held out", "whole", False)


def picture(sample: Sample, setting: Setting) -> NDArray[np.float32]:
    """(3, h, w) RGB 0..1: the whole image squeezed into the input, as at run time."""
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


class DepthTraining(Training):
    """The file's output is 10 m / depth as `3ds look` expects for the setting nyu, and farthest
    depth / depth for others. blocks, setting: other than the published network's.
    """

    name = "densedepth"

    def __init__(
        self,
        pairs: DepthPairs,
        options: DepthOptions,
        run: Run,
        *,
        blocks: Sequence[int] | None = None,
        setting: Setting | None = None,
    ) -> None:
        self.pairs, self.options, self.run, self.blocks = pairs, options, run, blocks
        self.setting = setting or SETTINGS[options.setting]
        self.split = pairs.split(options.validation, options.seed)

    def fit(self) -> list[Row]:
        import keras

        options, setting = self.options, self.setting
        keras.utils.set_random_seed(options.seed)
        self._model = densedepth.build_densedepth(
            options.first_weights,
            size=(setting.height, setting.width),
            filters=HALF_DECODER if options.half_decoder else None,
            blocks=self.blocks,
        )
        if options.freeze_encoder:
            for layer in densedepth.encoder_layers(self._model):
                layer.trainable = False

        def pair(sample: Sample) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
            return picture(sample, setting), target(sample, setting)

        train, held = (
            Loaded([self.pairs.samples[i] for i in part], pair, augment, options.seed)
            for part, augment in (
                (self.split.train, augmented if options.augment else None),
                (self.split.held, None),
            )
        )
        identity = outcome.identity(
            [s.name for s in self.pairs.samples],
            self.split.train,
            asdict(setting),
            options.weights,
            options.freeze_encoder,
            options.augment,
            self.blocks,
        )
        losses = functools.partial(densedepth.losses, most=setting.most)
        config = loop_config(options, amsgrad=True)
        loop = self.run.loop(self._model, losses, train, held, config, identity=identity)
        return loop.run(self.run.resume)

    def describe(self) -> dict[str, Any]:
        error = self._measure()
        self._scored = scores.score(self._records)
        return {
            "initialised_from": self.options.weights,
            "pictures": {"train": len(self.split.train), "held_out": len(self.split.held)},
            **self.pairs.told(self.split),
            "median_depth_m": self.pairs.median_m,
            "parameters": self._model.count_params(),
            "options": asdict(self.options),
            "depth_error": error,
            "held_out": plain(self._scored),
        }

    def export(self, path: Path, card: Mapping[str, Any]) -> float:
        shown = {key: card[key] for key in ("name", "date", "initialised_from", "depth_error")}
        shown["farthest_m"] = self.setting.farthest_m
        return densedepth.export(self._model, path, shown, self.setting)

    def page(self, card: Mapping[str, Any]) -> Report:
        report = outcome.training_report(card, self.history)
        report.tables.append(pages.depth_table({_HELD_OUT: self._scored}))
        worst = sorted(self._records, key=lambda r: r.errors.delta1)[:_SHOWN]
        samples = {s.name: s for s in self.pairs.samples}
        tiles = [(samples[r.image], self._maps[r.image], r) for r in worst if r.errors.pixels]
        shown = {"held out": tiles} if tiles else {}
        pages.add_depth_pictures(report, {_HELD_OUT: self._records}, shown)
        return report

    def _measure(self) -> float:
        """Errors of the held-out images and maps in metres; returns their relative error."""
        import torch

        setting = self.setting
        self._records: list[DepthRecord] = []
        self._maps: dict[str, NDArray[np.float32]] = {}
        true, guessed = [], []
        for index in self.split.held:
            sample = self.pairs.samples[index]
            with torch.no_grad():
                image = torch.from_numpy(picture(sample, setting)[None]).to(device_of(self._model))
                raw = self._model(image, training=False)[0, 0].float().cpu().numpy()
            depth = np.asarray(setting.farthest_m / np.clip(raw, 1.0, setting.most), np.float32)
            truth = load_depth(sample)
            assert truth is not None
            self._maps[sample.name] = depth
            limits = (setting.nearest_m, setting.farthest_m)
            group = self.pairs.groups[index]
            self._records.append(scores.compare(sample.name, group, depth, truth, limits_m=limits))
            small = target(sample, setting)[0]
            metres = setting.farthest_m / np.maximum(small, 1e-6)
            true.append(np.where(small > 0, metres, 0).ravel())
            guessed.append(depth.ravel())
        return relative_depth_error(guessed, true)
