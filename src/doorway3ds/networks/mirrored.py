"""Two mirrorings of the image seen by one network, averaged: steadier, at twice the time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.networks.base import Network, presets_of, thresholds_of
from doorway3ds.types import ColumnVotes, Perception, RelativeDepth

T = TypeVar("T")
_SURE = 1e-6  # probabilities stay this far from 0 and 1, so that logits stay finite


class Mirrored:
    """A network that looks at the image and at its mirror image, as one network.

    Probabilities are averaged as logits, depth as its logarithm, edges by each look's score;
    depth that only one of the two looks knows is kept.
    """

    def __init__(self, network: Network) -> None:
        self.network = network
        self.name = f"{network.name}, mirrored average"
        self.gives = network.gives
        self.thresholds = thresholds_of(network)
        self.presets = presets_of(network)

    def __repr__(self) -> str:
        return f"<Mirrored {self.network.name}>"

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        plain = self.network(image, camera)
        other = self.network(np.ascontiguousarray(image[:, ::-1]), camera.mirrored())
        other = _turned_back(other, image.shape[1])
        timings = {
            stage: plain.timings_ms.get(stage, 0.0) + other.timings_ms.get(stage, 0.0)
            for stage in plain.timings_ms.keys() | other.timings_ms.keys()
        }
        return replace(
            plain,
            p_open=float(_mean_probability(plain.p_open, other.p_open)),
            columns=_if_both(_mean_columns, plain.columns, other.columns),
            depth_m=_if_both(_mean_depth, plain.depth_m, other.depth_m),
            floor=_if_both(_mean_probability, plain.floor, other.floor),
            relative=_if_both(_mean_relative, plain.relative, other.relative),
            network=self.name,
            timings_ms=timings,
        )


def _turned_back(seen: Perception, width: int) -> Perception:
    """What was seen in a mirror image of `width` columns, in the image's own columns."""
    columns, relative = seen.columns, seen.relative
    if columns is not None:
        columns = replace(
            columns,
            score=columns.score[::-1],
            left_px=width - 1 - columns.right_px[::-1],
            right_px=width - 1 - columns.left_px[::-1],
            clear=None if columns.clear is None else columns.clear[::-1],
        )
    if relative is not None:
        relative = replace(relative, inverse=relative.inverse[:, ::-1])
    return replace(
        seen,
        columns=columns,
        depth_m=None if seen.depth_m is None else seen.depth_m[:, ::-1],
        floor=None if seen.floor is None else seen.floor[:, ::-1],
        relative=relative,
    )


def _if_both(mean: Callable[[T, T], T], a: T | None, b: T | None) -> T | None:
    return None if a is None or b is None else mean(a, b)


def _mean_probability(a: Any, b: Any) -> NDArray[np.float32]:
    a, b = (np.clip(np.asarray(p, np.float64), _SURE, 1 - _SURE) for p in (a, b))
    odds = np.sqrt(a / (1 - a) * (b / (1 - b)))
    return np.asarray(odds / (1 + odds), np.float32)


def _mean_columns(a: ColumnVotes, b: ColumnVotes) -> ColumnVotes:
    # a strip's edges are those of the look that believes in it more
    share = a.score / np.maximum(a.score + b.score, _SURE)
    return replace(
        a,
        score=_mean_probability(a.score, b.score),
        left_px=share * a.left_px + (1 - share) * b.left_px,
        right_px=share * a.right_px + (1 - share) * b.right_px,
        clear=_if_both(_mean_probability, a.clear, b.clear),
    )


def _either(
    mean: NDArray[np.floating], a: NDArray[np.float32], b: NDArray[np.float32]
) -> NDArray[np.float32]:
    return np.where(np.isnan(a), b, np.where(np.isnan(b), a, mean)).astype(np.float32)


def _mean_depth(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    return _either(np.sqrt(a * b), a, b)


def _mean_relative(a: RelativeDepth, b: RelativeDepth) -> RelativeDepth:
    """Inverse depth of the first look, with the second brought to its scale if it has one."""
    if a.shifted:
        return a  # two unknown scales and shifts have no mean
    known = np.isfinite(a.inverse) & np.isfinite(b.inverse) & (b.inverse > 0)
    gain = float(np.median(a.inverse[known] / b.inverse[known])) if known.any() else 1.0
    other = np.asarray(b.inverse * gain, np.float32)
    return replace(a, inverse=_either((a.inverse + other) / 2, a.inverse, other))
