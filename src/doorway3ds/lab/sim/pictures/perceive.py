"""A picture's truth as a network that makes no mistakes would report it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.lab.sim.pictures.dataset import Shot
from doorway3ds.lab.sim.pictures.truth import Truth
from doorway3ds.types import Frame, Perception


def perfect(truth: Truth, depth_m: NDArray[np.float32]) -> Perception:
    """What a network that makes no mistakes would say; depth_m: (H, W), of the whole image."""
    spans = [(o.left_px, o.right_px) for o in truth.openings]
    return Perception(
        p_open=float(bool(spans)),
        columns=columns_from_spans(spans, depth_m.shape[1]),
        depth_m=depth_m,
        floor=truth.floor.astype(np.float32),
    )


def perceive(shot: Shot) -> tuple[Frame, Perception]:
    """The frame of a shot and its perfect perception."""
    return Frame(shot.rgb, shot.camera, shot.eye.pose), perfect(shot.truth, shot.depth)
