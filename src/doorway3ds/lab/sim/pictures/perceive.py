"""A picture's truth as a network that makes no mistakes would report it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.errors import UserError
from doorway3ds.types import Perception

if TYPE_CHECKING:
    from doorway3ds.lab.sim.pictures.truth import Truth


def perfect(truth: Truth, depth_m: NDArray[np.float32]) -> Perception:
    """What a network that makes no mistakes would say; depth_m: (H, W), of the whole image."""
    spans = [(o.left_px, o.right_px) for o in truth.openings]
    return Perception(
        p_open=float(bool(spans)),
        columns=columns_from_spans(spans, depth_m.shape[1]),
        depth_m=depth_m,
        floor=truth.floor.astype(np.float32),
    )


class TruthNetwork:
    """The last image's truth as a network; seen: returns it with the depth, None before a look."""

    name = "truth"
    gives = frozenset({"p_open", "columns", "depth", "floor"})

    def __init__(self, seen: Callable[[], tuple[Truth, NDArray[np.float32]] | None]) -> None:
        self._seen = seen

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        seen = self._seen()
        if seen is None:
            raise UserError("network truth knows only images of its source")
        return perfect(*seen)
