"""The shape of every network adapter, and several adapters joined into one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.types import Perception

P_OPEN, COLUMNS, DEPTH, FLOOR = "p_open", "columns", "depth", "floor"
RELATIVE = "relative"  # depth without metres; with a floor and a lens height it becomes depth


class Network(Protocol):
    """Anything that perceives.

    name: as `--network` and the answer call it.
    gives: which of "p_open", "columns", "depth", "floor", "relative" it fills in.
    """

    @property
    def name(self) -> str: ...

    @property
    def gives(self) -> frozenset[str]: ...

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        """Perceives (H, W, 3) uint8 RGB taken by `camera`, which is for W x H pixels."""
        ...


class Joined:
    """Networks that look at the same image; what a later one gives replaces an earlier's.

    `cnn-srin+densedepth` is the paper's pair; `doornet+densedepth` is doornet with another depth.
    Relative depth is a depth, too: it replaces an earlier one's, and joined with a floor it
    counts as depth, since `decide.scene.metres.in_metres` makes it that.
    """

    def __init__(self, networks: Sequence[Network]) -> None:
        if not networks:
            raise ValueError("expected at least one network, got none")
        self.networks = tuple(networks)
        self.name = "+".join(network.name for network in self.networks)
        self.gives = joint_gives([network.gives for network in self.networks])
        self.thresholds = next(
            (thresholds_of(n) for n in reversed(self.networks) if COLUMNS in n.gives), {}
        )
        self.presets = next(
            (presets_of(n) for n in reversed(self.networks) if COLUMNS in n.gives), {}
        )

    def __repr__(self) -> str:
        return f"<Joined {self.name}>"

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        seen = [(network, network(image, camera)) for network in self.networks]
        timings: dict[str, float] = {}
        for _, perception in seen:
            for stage, spent in perception.timings_ms.items():
                timings[stage] = timings.get(stage, 0.0) + spent

        def last(field: str) -> Perception | None:
            return next((p for network, p in reversed(seen) if field in network.gives), None)

        judge, columns, floor = (last(f) for f in (P_OPEN, COLUMNS, FLOOR))
        depth = next((p for net, p in reversed(seen) if net.gives & {DEPTH, RELATIVE}), None)
        return Perception(
            p_open=judge.p_open if judge else float("nan"),
            columns=columns.columns if columns else None,
            depth_m=depth.depth_m if depth else None,
            floor=floor.floor if floor else None,
            depth_error=depth.depth_error if depth else 0.0,
            bearing_error_deg=columns.bearing_error_deg if columns else None,
            relative=depth.relative if depth else None,
            network=self.name,
            timings_ms=timings,
        )


def joint_gives(parts: Sequence[frozenset[str]]) -> frozenset[str]:
    """What networks with these `gives` give when they are joined in this order."""
    gives = frozenset[str]().union(*parts)
    depths = [part & {DEPTH, RELATIVE} for part in parts]
    last = next((found for found in reversed(depths) if found), frozenset())
    if RELATIVE in last and FLOOR in gives:
        last = frozenset({DEPTH})
    return gives - {DEPTH, RELATIVE} | last


def thresholds_of(network: Network) -> Mapping[str, Any]:
    """Limits of the `opening` method that this network was measured with, by their names."""
    return getattr(network, "thresholds", None) or {}


def presets_of(network: Network) -> Mapping[str, Any]:
    """Operating points that this network was measured at: name to `open_from` and `limits`."""
    return getattr(network, "presets", None) or {}
