"""Scores of depth maps over many images.

An image's errors are means over its pixels; a data set's are means over images (`mean`),
and also over all pixels together (`pooled`), because publications use both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.evaluate.intervals import Interval, by_place, mean
from doorway3ds.lab.evaluate.metrics import DEPTH_LIMITS_M, DepthErrors, depth_errors

MEASURES = ("delta1", "delta2", "delta3", "abs_rel", "rmse", "log10")


@dataclass(frozen=True)
class DepthRecord:
    """One image's errors under one protocol."""

    image: str
    place: str
    errors: DepthErrors


@dataclass(frozen=True)
class DepthMetrics:
    """metrics: means over images, with intervals by place. pooled: over all pixels together."""

    pictures: int
    places: int
    metrics: Mapping[str, Interval]
    pooled: Mapping[str, float]


def resize_map(depth_m: NDArray[Any], height: int, width: int) -> NDArray[np.float32]:
    """A map (h, w) that covers the whole image, bilinear, at (height, width)."""
    source = np.asarray(depth_m, np.float32)
    if source.shape == (height, width):
        return source
    return np.asarray(
        cv2.resize(source, (width, height), interpolation=cv2.INTER_LINEAR), np.float32
    )


def average_with_mirrored(
    plain: NDArray[np.float32], of_mirrored: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Mean of a map (h, w) and the map (h, w) of the mirrored image."""
    return np.asarray((plain + of_mirrored[:, ::-1]) / 2, np.float32)


def compare(
    image: str,
    place: str,
    predicted_m: NDArray[Any],
    truth_m: NDArray[np.float32],
    box: tuple[int, int, int, int] | None = None,
    limits_m: tuple[float, float] = DEPTH_LIMITS_M,
) -> DepthRecord:
    """One record; the prediction is brought to the truth's size bilinearly first."""
    resized = resize_map(predicted_m, *truth_m.shape)
    return DepthRecord(image, place, depth_errors(resized, truth_m, box, limits_m))


def score(records: Sequence[DepthRecord], repeats: int = 2000) -> DepthMetrics:
    """Means over the images that have any compared pixel."""
    known = [r for r in records if r.errors.pixels]
    places = [r.place for r in known]
    pixels = np.array([r.errors.pixels for r in known], float)
    values = {name: np.array([getattr(r.errors, name) for r in known], float) for name in MEASURES}
    pooled = dict.fromkeys(MEASURES, math.nan)
    if known:
        pooled = {name: float(np.average(own, weights=pixels)) for name, own in values.items()}
        pooled["rmse"] = float(np.sqrt(np.average(values["rmse"] ** 2, weights=pixels)))
    means = by_place({name: mean(own) for name, own in values.items()}, places, repeats)
    return DepthMetrics(len(known), len(set(places)), means, pooled)
