"""Elementary measures of classifiers and depth maps: pure functions on arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.floating[Any]]

DEPTH_LIMITS_M = (1e-3, 10.0)


@dataclass(frozen=True)
class Confusion:
    """Counts of a two-class answer; positive = open doorway."""

    tp: int
    fp: int
    tn: int
    fn: int

    @property
    def accuracy(self) -> float:
        return _ratio(self.tp + self.tn, self.tp + self.fp + self.tn + self.fn)

    @property
    def sensitivity(self) -> float:
        return _ratio(self.tp, self.tp + self.fn)

    @property
    def specificity(self) -> float:
        return _ratio(self.tn, self.tn + self.fp)

    @property
    def balanced_accuracy(self) -> float:
        return (self.sensitivity + self.specificity) / 2


@dataclass(frozen=True)
class Calibration:
    """Reliability of probabilities in equal-width bins; empty bins are left out.

    probability, frequency: (B,) mean probability and share of positives of each bin.
    count: (B,) images in it. ece: expected calibration error, the mean of
    |probability - frequency| weighted by count (Guo et al. 2017, eq. 3, for a binary event).
    """

    probability: FloatArray
    frequency: FloatArray
    count: NDArray[np.int64]
    ece: float


@dataclass(frozen=True)
class DepthErrors:
    """Errors of one depth map over its `pixels` compared pixels (Eigen et al. 2014, sec. 4.3).

    delta1..3: share with max(p/t, t/p) < 1.25, 1.25^2, 1.25^3; abs_rel: mean |p - t| / t;
    rmse: metres; log10: mean |log10 p - log10 t|. All nan where no pixel could be compared.
    """

    delta1: float
    delta2: float
    delta3: float
    abs_rel: float
    rmse: float
    log10: float
    pixels: int


def confusion(truth: ArrayLike, answer: ArrayLike) -> Confusion:
    """Counts of (N,) booleans, True = open doorway."""
    t, a = np.asarray(truth, bool), np.asarray(answer, bool)
    if t.shape != a.shape:
        raise ValueError(f"truth and answer must have one shape, got {t.shape} and {a.shape}")
    return Confusion(
        tp=int(np.sum(t & a)),
        fp=int(np.sum(~t & a)),
        tn=int(np.sum(~t & ~a)),
        fn=int(np.sum(t & ~a)),
    )


def auc(truth: ArrayLike, score: ArrayLike) -> float:
    """Area under the ROC curve: chance that a positive scores above a negative, ties half.

    nan where one of the classes is missing.
    """
    t, s = np.asarray(truth, bool), np.asarray(score, float)
    positives, negatives = int(t.sum()), int((~t).sum())
    if positives == 0 or negatives == 0:
        return math.nan
    _, inverse, counts = np.unique(s, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    rank = (last - (counts - 1) / 2)[inverse]
    above = rank[t].sum() - positives * (positives + 1) / 2
    return float(above / (positives * negatives))


def roc_curve(truth: ArrayLike, score: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """False- and true-positive rates from (0, 0) to (1, 1), one point per distinct score."""
    t, s = np.asarray(truth, bool), np.asarray(score, float)
    order = np.argsort(-s, kind="stable")
    ends = np.flatnonzero(np.append(np.diff(s[order]) != 0, True))
    true = np.cumsum(t[order])[ends]
    false = np.cumsum(~t[order])[ends]
    zero = np.zeros(1)
    return (
        np.concatenate([zero, false / max(int((~t).sum()), 1)]),
        np.concatenate([zero, true / max(int(t.sum()), 1)]),
    )


def calibration(truth: ArrayLike, probability: ArrayLike, bins: int = 10) -> Calibration:
    """Reliability bins of (N,) probabilities against (N,) booleans."""
    t, p = np.asarray(truth, float), np.asarray(probability, float)
    index = np.clip((p * bins).astype(int), 0, bins - 1)
    count = np.bincount(index, minlength=bins)
    used = count > 0
    n = count[used]
    mean_p = np.bincount(index, p, bins)[used] / n
    mean_t = np.bincount(index, t, bins)[used] / n
    ece = float(np.sum(n * np.abs(mean_p - mean_t)) / n.sum()) if len(t) else math.nan
    return Calibration(mean_p, mean_t, n.astype(np.int64), ece)


def calibration_by_chance(
    probability: ArrayLike, bins: int = 10, repeats: int = 1000, seed: int = 0
) -> FloatArray:
    """(repeats,) calibration errors that (N,) probabilities show although they are true.

    Outcomes are drawn from the probabilities themselves. What a network shows beyond these is
    its own error; with few images most of what is measured is chance.
    """
    p = np.asarray(probability, float)
    drawn = np.random.default_rng(seed).random((repeats, p.size)) < p
    return np.array([calibration(outcome, p, bins).ece for outcome in drawn])


def depth_errors(
    predicted: FloatArray,
    truth: FloatArray,
    box: tuple[int, int, int, int] | None = None,
    limits_m: tuple[float, float] = DEPTH_LIMITS_M,
) -> DepthErrors:
    """Errors of a predicted map against a true one, both (H, W) metres.

    Pixels count where the truth is known and lies strictly within `limits_m` (a sensor's
    "10 m or more" is no depth), inside `box` = (top, bottom, left, right), end-exclusive.
    Predictions are clipped to the limits; an unknown (nan) prediction counts as the lower
    limit, so that leaving pixels out cannot help.
    """
    if predicted.shape != truth.shape:
        raise ValueError(
            f"predicted and true depth must have one shape, got {predicted.shape} "
            f"and {truth.shape}; resize the prediction first"
        )
    if box is not None:
        top, bottom, left, right = box
        predicted, truth = predicted[top:bottom, left:right], truth[top:bottom, left:right]
    low, high = limits_m
    with np.errstate(invalid="ignore"):
        valid = (truth > low) & (truth < high)
    t = truth[valid].astype(np.float64)
    if t.size == 0:
        return DepthErrors(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, 0)
    p = np.clip(np.nan_to_num(predicted[valid].astype(np.float64), nan=low), low, high)
    ratio = np.maximum(p / t, t / p)
    return DepthErrors(
        delta1=float(np.mean(ratio < 1.25)),
        delta2=float(np.mean(ratio < 1.25**2)),
        delta3=float(np.mean(ratio < 1.25**3)),
        abs_rel=float(np.mean(np.abs(p - t) / t)),
        rmse=float(np.sqrt(np.mean((p - t) ** 2))),
        log10=float(np.mean(np.abs(np.log10(p) - np.log10(t)))),
        pixels=int(t.size),
    )


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else math.nan
