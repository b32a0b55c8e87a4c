"""A picture's truth as a network that makes no mistakes would report it."""

from __future__ import annotations

import numpy as np

from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.lab.sim.pictures.dataset import Shot
from doorway3ds.types import Frame, Perception


def perceive(shot: Shot) -> tuple[Frame, Perception]:
    """The frame of a shot and its perfect perception."""
    spans = [(o.left_px, o.right_px) for o in shot.truth.openings]
    perception = Perception(
        p_open=float(bool(spans)),
        columns=columns_from_spans(spans, shot.camera.width),
        depth_m=shot.depth,
        floor=shot.truth.floor.astype(np.float32),
    )
    return Frame(shot.rgb, shot.camera, shot.eye.pose), perception
