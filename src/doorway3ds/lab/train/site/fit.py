"""Fine-tuning of a doornet on few images: the openings' heads, then the whole decoder.

The encoder and all statistics of batch norm stay as they are. The heads do not touch depth
and floor at all; when the decoder learns, too, it is held to the depth and floor that the
network gave before (Li & Hoiem, "Learning without Forgetting", 2016). Of the network before,
after the first and after the second stage that one is kept whose openings fit best to places
set apart for this choice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.lab.train.doornet.data.augment import AugmentConfig
from doorway3ds.lab.train.doornet.data.samples import Sample
from doorway3ds.lab.train.doornet.export import Calibration
from doorway3ds.lab.train.doornet.fit import FitConfig, Held, Stage, fit
from doorway3ds.lab.train.doornet.losses import LossWeights, all_losses
from doorway3ds.lab.train.doornet.model import DoorNet, is_batch_norm
from doorway3ds.lab.train.engine.backend import device_of
from doorway3ds.lab.train.engine.calibrate import best_strips, platt
from doorway3ds.lab.train.engine.loop import Row
from doorway3ds.lab.train.engine.training import Run
from doorway3ds.lab.train.options import TuneOptions
from doorway3ds.lab.train.site.score import MAX_DEPTH_CHANGE
from doorway3ds.networks.doornet import DoorNet as Runtime

SITE = "site"
BEFORE, HEADS, DECODER = "before", "heads", "decoder"
ENOUGH = 25  # images of either class from which on calibration is fitted anew
_REPLAY = 0.4  # share of a batch that comes from other data sets
_AUGMENT = AugmentConfig(whole=0.6, min_zoom=0.7, occluder=0.1)
# serves training alone, is not in a file, and comes back untrained: nothing to learn by
_UNTRAINED = "segments"
_OPENINGS = LossWeights(p_open=1.0, depth=0.0, gradient=0.0, floor=0.0, segments=0.0)
_ALL = replace(_OPENINGS, depth=1.0, gradient=0.5, floor=0.5)


@dataclass(frozen=True)
class Tuned:
    """What fine-tuning came to; the network itself has been changed in place.

    stage: which of BEFORE, HEADS and DECODER was kept. losses: of the openings on the places set
    apart, by stage. history: losses of each epoch, by stage.
    """

    stage: str
    calibration: Calibration
    recalibrated: tuple[str, ...]
    losses: dict[str, float]
    history: dict[str, list[Row]]


@dataclass(frozen=True)
class _Outlook:
    """The network's answers to the plain views of some images."""

    loss: float
    answers: list[tuple[Sample, dict[str, Any], dict[str, Any]]]  # sample, outputs, target


def tune(
    net: DoorNet,
    calibration: Calibration,
    learn: Sequence[Sample],
    inner: Sequence[Sample],
    options: TuneOptions,
    run: Run,
    tell: Callable[[str], None] = lambda line: None,
) -> Tuned:
    """Fine-tunes `net` in place on `learn`; `inner` stops, chooses and calibrates.

    Samples carry the depth and floor to hold the network to (`keep_depth`).
    """
    first = _look(net, inner, options.batch)
    losses, history = {BEFORE: first.loss}, dict[str, list[Row]]()
    kept, best = BEFORE, first
    weights = net.whole.get_weights()
    for stage, rate, counted in (
        (HEADS, options.learning_rate, _OPENINGS),
        (DECODER, options.learning_rate / 3, _ALL),
    ):
        tell(f"the {stage} learns" if stage == DECODER else f"the {stage} learn")
        _freeze(net, stage)
        history[stage] = fit(
            net,
            learn,
            _config(learn, rate, options),
            replace(run, out=run.out / stage),
            augment=_AUGMENT,
            weights=counted,
            held=inner,
        )
        now = _look(net, inner, options.batch)
        losses[stage] = now.loss
        if now.loss < best.loss and _depth_change(first, now) <= MAX_DEPTH_CHANGE:
            kept, best, weights = stage, now, net.whole.get_weights()
        else:
            net.whole.set_weights(weights)
    found, fitted = (calibration, ()) if kept == BEFORE else _calibrate(calibration, best)
    return Tuned(kept, found, fitted, losses, history)


def keep_depth(samples: Sequence[Sample], network: Runtime) -> list[Sample]:
    """Samples with the network's own depth and floor where they have none, to hold it to."""

    def labelled(sample: Sample) -> Sample:
        if sample.depth_m is not None:
            return sample
        height, width = sample.image.shape[:2]
        seen = network(sample.image, Camera("stored", width, height, *sample.camera))
        if seen.depth_m is None or seen.floor is None:
            return sample
        depth, floor = (
            cv2.resize(np.asarray(value, np.float32), (width, height))
            for value in (seen.depth_m, seen.floor)
        )
        return replace(sample, depth_m=depth, extra={**sample.extra, "floor": floor > 0.5})

    return [labelled(sample) for sample in samples]


def _config(learn: Sequence[Sample], rate: float, options: TuneOptions) -> FitConfig:
    sources = sorted({sample.source for sample in learn})
    own = sum(sample.source == SITE for sample in learn)
    others = [source for source in sources if source != SITE]
    shares = {SITE: 1.0 - _REPLAY if others else 1.0}
    shares |= {source: _REPLAY / len(others) for source in others}
    # each image about twice an epoch
    steps = round(2 * own / shares[SITE] / options.batch)
    return FitConfig(
        stages=(Stage(options.epochs, rate),),
        steps_per_epoch=int(np.clip(steps, 4, 60)),
        batch=options.batch,
        weight_decay=1e-4,
        shares=shares,
        ema=0.95,
        seed=options.seed,
        patience=options.patience,
    )


def _freeze(net: DoorNet, stage: str) -> None:
    """Lets only the layers of `stage` learn; `fit` keeps the encoder as it is."""
    import keras

    decoder = net.decoder
    others = [decoder.output[name] for name in ("depth", "floor", "segments")]
    shared = {id(layer) for layer in keras.Model(decoder.inputs, others).layers}
    for layer in decoder.layers:
        learns = stage == DECODER or id(layer) not in shared
        # few images tell less of the statistics than the thousands before
        layer.trainable = learns and not is_batch_norm(layer) and layer.name != _UNTRAINED


def _look(net: DoorNet, samples: Sequence[Sample], batch: int) -> _Outlook:
    import torch

    held = Held(samples, batch, None)
    device = device_of(net.whole)
    total, answers = 0.0, []
    for indices in held.batches(None):
        image, target = held.load(indices, None)
        with torch.no_grad():
            tensor = torch.from_numpy(np.ascontiguousarray(image)).to(device)
            output = net.whole(tensor, training=False)
            labels = {name: torch.from_numpy(value).to(device) for name, value in target.items()}
            losses = all_losses(output, labels, _OPENINGS)
        total += float(sum(losses.values())) * len(indices)
        values = {name: value.cpu().numpy() for name, value in output.items()}
        for at, index in enumerate(indices):
            own = {name: value[at] for name, value in values.items()}
            answers.append((samples[index], own, {k: v[at] for k, v in target.items()}))
    return _Outlook(total / len(samples), answers)


def depth_change(before: NDArray[Any], after: NDArray[Any]) -> float:
    """Mean of |log ratio| of two depth maps of one size, where both are known."""
    known = np.isfinite(before) & np.isfinite(after) & (before > 0) & (after > 0)
    if not known.any():
        return float("inf")
    return float(np.abs(np.log(after[known] / before[known])).mean())


def _depth_change(first: _Outlook, now: _Outlook) -> float:
    pairs = zip(first.answers, now.answers, strict=True)
    return float(np.mean([depth_change(a["depth"], b["depth"]) for (_, a, _), (_, b, _) in pairs]))


def _calibrate(before: Calibration, outlook: _Outlook) -> tuple[Calibration, tuple[str, ...]]:
    """Refitted where enough images tell, kept where not; and what was refitted."""
    found, fitted = before, []
    told = [(s, o, t) for s, o, t in outlook.answers if s.open is not None]
    logits = np.array([[o["p_open"], o["score"].max()] for _, o, _ in told])
    labels = np.array([s.open for s, _, _ in told])
    if _enough(labels):
        scale, score_scale, shift = platt(logits, labels)
        found = replace(
            found, p_open_scale=scale, p_open_score_scale=score_scale, p_open_shift=shift
        )
        fitted.append("p_open")
    # a strip's score speaks of a place in the image: only marked openings can tell
    marked = [(o["score"], t["score"]) for s, o, t in told if s.spans or s.open == 0]
    logits, labels = best_strips(marked)
    if _enough(labels):
        scale, shift = platt(logits, labels)
        found = replace(found, score_scale=scale, score_shift=shift)
        fitted.append("score")
    return found, tuple(fitted)


def _enough(labels: NDArray[Any]) -> bool:
    return min(int(labels.sum()), len(labels) - int(labels.sum())) >= ENOUGH
