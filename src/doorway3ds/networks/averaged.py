"""Several looks at one image as one network: steadier, at as many times the time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.errors import CallError
from doorway3ds.networks.base import Network, presets_of, thresholds_of
from doorway3ds.types import ColumnVotes, Perception, RelativeDepth

T = TypeVar("T")
_SURE = 1e-6  # probabilities stay this far from 0 and 1, so that logits stay finite


class Averaged:
    """Several networks that look at the same image, as one network.

    Probabilities are averaged as logits, depth as its logarithm, edges by each look's score;
    depth that not all looks know is the mean of those that do. Thresholds and presets are the first
    network's.

    Raises CallError without a network.
    """

    def __init__(self, networks: Sequence[Network], name: str | None = None) -> None:
        if not networks:
            raise CallError("expected one network or more to average, got none")
        self.networks = tuple(networks)
        first = self.networks[0]
        self.name = name or " and ".join(network.name for network in self.networks)
        self.gives = frozenset.intersection(*(frozenset(n.gives) for n in self.networks))
        self.thresholds = thresholds_of(first)
        self.presets = presets_of(first)

    def __repr__(self) -> str:
        return f"<Averaged {self.name}>"

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        looks = self._looks(image, camera)
        stages = {stage for look in looks for stage in look.timings_ms}
        return replace(
            looks[0],
            p_open=float(_mean_probability([look.p_open for look in looks])),
            columns=_if_all(_mean_columns, [look.columns for look in looks]),
            depth_m=_if_all(_mean_depth, [look.depth_m for look in looks]),
            floor=_if_all(_mean_probability, [look.floor for look in looks]),
            relative=_if_all(_mean_relative, [look.relative for look in looks]),
            network=self.name,
            timings_ms={s: sum(look.timings_ms.get(s, 0.0) for look in looks) for s in stages},
        )

    def _looks(self, image: NDArray[np.uint8], camera: Camera) -> list[Perception]:
        return [network(image, camera) for network in self.networks]


class Mirrored(Averaged):
    """A network that looks at the image and at its mirror image, as one network."""

    def __init__(self, network: Network) -> None:
        super().__init__([network], f"{network.name}, mirrored average")

    def _looks(self, image: NDArray[np.uint8], camera: Camera) -> list[Perception]:
        network = self.networks[0]
        plain = network(image, camera)
        other = network(np.ascontiguousarray(image[:, ::-1]), camera.mirrored())
        return [plain, _turned_back(other, image.shape[1])]


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


def _if_all(mean: Callable[[Sequence[T]], T], looks: Sequence[T | None]) -> T | None:
    told = [look for look in looks if look is not None]
    return mean(told) if len(told) == len(looks) else None


def _mean_probability(looks: Sequence[Any]) -> NDArray[np.float32]:
    told = [np.clip(np.asarray(p, np.float64), _SURE, 1 - _SURE) for p in looks]
    odds = reduce(np.multiply, (p / (1 - p) for p in told)) ** (1 / len(told))
    return np.asarray(odds / (1 + odds), np.float32)


def _mean_columns(looks: Sequence[ColumnVotes]) -> ColumnVotes:
    # a strip's edges are those of the looks that believe in it most
    belief = np.array([look.score for look in looks], np.float64) + _SURE
    belief /= belief.sum(axis=0)

    def edge(name: str) -> NDArray[np.float32]:
        edges = np.array([getattr(look, name) for look in looks])
        return np.asarray((belief * edges).sum(axis=0), np.float32)

    return replace(
        looks[0],
        score=_mean_probability([look.score for look in looks]),
        left_px=edge("left_px"),
        right_px=edge("right_px"),
        clear=_if_all(_mean_probability, [look.clear for look in looks]),
    )


def _mean_depth(looks: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    known = np.isfinite(looks)
    logs = np.log(np.where(known, looks, 1.0)).sum(axis=0)
    with np.errstate(invalid="ignore"):  # nobody knows: nan
        return np.asarray(np.exp(logs / known.sum(axis=0)), np.float32)


def _mean_relative(looks: Sequence[RelativeDepth]) -> RelativeDepth:
    """Inverse depth of the first look, with the others brought to its scale if it has one."""
    first = looks[0]
    if first.shifted:
        return first  # unknown scales and shifts have no mean
    scaled = [first.inverse]
    for look in looks[1:]:
        known = np.isfinite(first.inverse) & np.isfinite(look.inverse) & (look.inverse > 0)
        gain = np.median(first.inverse[known] / look.inverse[known]) if known.any() else 1.0
        scaled.append(np.asarray(look.inverse * gain, np.float32))
    known = np.isfinite(scaled)
    total = np.where(known, scaled, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return replace(first, inverse=(total / known.sum(axis=0)).astype(np.float32))
