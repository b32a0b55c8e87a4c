"""Calibration on held-out places: logits become probabilities, errors become numbers.

Platt's scaling ("Probabilistic outputs for support vector machines", 1999), fitted by Newton's
method with his smoothed targets, so that a separable set gives finite scales.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]


def platt(
    logits: Array, labels: Array, weights: Array | None = None, steps: int = 50
) -> tuple[float, ...]:
    """(scale, ..., shift) such that sigmoid(scale * logit + ... + shift) is a probability.

    logits: (N,) or (N, K) for K logits that speak of the same thing; labels: (N,), 0 or 1.
    weights: (N,), of each image, default 1; only their ratios count.
    The mean of the logits where there are fewer than ten of either label. A scale below zero
    is no calibration: that logit is left out.
    """
    labels = np.asarray(labels, float)
    logits = np.asarray(logits, float).reshape(len(labels), -1)
    count = logits.shape[1]
    positive, negative = labels.sum(), (1 - labels).sum()
    if min(positive, negative) < 10:
        return (*(1 / count for _ in range(count)), 0.0)
    target = np.where(labels > 0.5, (positive + 1) / (positive + 2), 1 / (negative + 2))
    design = np.column_stack([logits, np.ones(len(labels))])
    share = np.ones(len(labels)) if weights is None else np.asarray(weights, float)
    share = share * (len(labels) / share.sum())
    found = np.zeros(count + 1)  # from here Newton steps do not overshoot
    for _ in range(steps):
        p = 1 / (1 + np.exp(-np.clip(design @ found, -30, 30)))
        gradient = design.T @ (share * (p - target))
        hessian = design.T @ (design * (share * p * (1 - p))[:, None]) + 1e-6 * np.eye(count + 1)
        step = np.linalg.solve(hessian, gradient)
        found = found - step * min(1.0, 5.0 / max(np.abs(step).max(), 1e-9))
        if np.abs(step).max() < 1e-8:
            break
    if count > 1 and (found[:-1] < 0).any():
        worst = int(np.argmin(found[:-1]))
        kept = list(platt(np.delete(logits, worst, axis=1), labels, weights, steps))
        return (*kept[:worst], 0.0, *kept[worst:])
    return (*(float(max(scale, 0.0)) for scale in found[:-1]), float(found[-1]))


def best_strips(pairs: Iterable[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Each image's highest score, and 1 if an opening is in that strip, else 0.

    pairs: (N,) logits of an image's strips with the share of each that is inside an opening.
    """
    found = []
    for score, truth in pairs:
        best = int(np.argmax(score))
        found.append((score[best], truth[best] > 0.5))
    return np.array([s for s, _ in found]), np.array([t for _, t in found], float)


def relative_depth_error(predicted: Sequence[Array], true: Sequence[Array]) -> float:
    """Robust relative standard deviation of depth within an image: 1.4826 x median |log ratio|.

    predicted, true: depth maps of several images, each pair of one shape, 0 and nan unknown. The
    scale of a whole image, which no single one tells exactly, is taken out by its median ratio.
    """
    ratios = []
    for guess, truth in zip(predicted, true, strict=True):
        known = (truth > 0) & (guess > 0) & np.isfinite(truth) & np.isfinite(guess)
        ratio = np.log(guess[known] / truth[known])
        ratios.append(ratio - np.median(ratio) if ratio.size else ratio)
    return float(1.4826 * np.median(np.abs(np.concatenate(ratios))))
