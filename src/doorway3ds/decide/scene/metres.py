"""Relative depth in metres, by the floor.

The lens stands `height_m` above the floor. A ray r of unit step along the optical axis that falls
by d per step meets the floor at depth height_m / d: on the floor, 1 / depth = d / height_m, known
from the camera and its pose alone. A network that gives g = gain / depth + shift (or without the
shift) is thus known on the floor in two unknowns only, a straight line from g to 1 / depth, and
the same line then holds for the whole image.

The pitch must be known: a pitch that is wrong by e radians shifts 1 / depth by about e / height_m
everywhere, and g on the floor cannot tell one from the other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from doorway3ds.camera.model import Array, grid_pixels, grid_rays, rotation
from doorway3ds.decide.scene.floor import FloorParams, floor_mask
from doorway3ds.errors import UserError
from doorway3ds.types import Frame, Perception

FARTHEST_M = 20.0  # beyond, the line says only that it is far
TOLERANCE = 0.1  # relative, of 1 / depth, within which floor lies on the line
MIN_FLOOR, MOST_FLOOR = 40, 1500  # grid points, fewer of which tell no more than all
MIN_SHARE = 0.5  # of the floor's points that must lie on the line
MIN_SPAN = 1.25  # farthest over nearest floor, or a shift cannot be told from a gain


def in_metres(
    perception: Perception, frame: Frame, params: FloorParams | None = None
) -> Perception:
    """The perception with its relative depth turned into `depth_m`; as it is without any.

    Where too little floor is seen, or depth and floor contradict each other, depth is unknown
    (nan) and the floor is not believed. Raises UserError if the lens
    height or the floor's mask is missing, without which no image tells metres.
    """
    relative = perception.relative
    if relative is None:
        return perception
    need = f"relative depth of {perception.network} becomes metres by the floor: expected"
    if perception.floor is None:
        raise UserError(f"{need} a network that marks it, as in doornet+depth-anything-v2-small")
    if frame.pose.height_m is None:
        raise UserError(f"{need} the lens height, got none; give --height-m or a robot's --camera")
    params = params or FloorParams()
    height, width = relative.inverse.shape
    step = max(1, round(width / params.max_columns))
    rows, columns = grid_pixels(width, height, step)
    rays = grid_rays(frame.camera.stretched_to(width, height), step)
    floor = floor_mask(perception.floor, rows, columns, (height, width), params)
    expected = -(rays @ rotation(frame.pose)[2]) / frame.pose.height_m
    seen = relative.inverse[np.ix_(rows, columns)].astype(np.float64)
    use = floor & np.isfinite(seen) & (expected > 1 / FARTHEST_M)
    thin = slice(None, None, max(1, np.count_nonzero(use) // MOST_FLOOR))
    line = _line(seen[use][thin], expected[use][thin], relative.shifted)
    if line is None:
        unknown = np.full((height, width), np.nan, np.float32)
        return replace(perception, depth_m=unknown, floor=None, relative=None)
    gain, shift = line
    inverse = np.maximum(gain * relative.inverse + shift, 1 / FARTHEST_M)
    return replace(perception, depth_m=np.asarray(1 / inverse, np.float32), relative=None)


def _line(seen: Array, expected: Array, shifted: bool) -> tuple[float, float] | None:
    """(gain, shift) with expected = gain * seen + shift on most of the points, or None."""
    if seen.size < MIN_FLOOR:
        return None
    rng = np.random.default_rng(0)  # fixed: the same image gives the same line
    one, two = rng.integers(0, seen.size, (2, 96))
    with np.errstate(divide="ignore", invalid="ignore"):
        if shifted:
            gains = (expected[one] - expected[two]) / (seen[one] - seen[two])
            shifts = expected[one] - gains * seen[one]
        else:
            gains, shifts = expected[one] / seen[one], np.zeros(one.size)
    usable = np.isfinite(gains) & (gains > 0)
    if not usable.any():
        return None
    gains, shifts = gains[usable], shifts[usable]
    errors = np.abs(np.outer(seen, gains) + shifts - expected[:, None])
    best = np.argmax(np.count_nonzero(errors < TOLERANCE * expected[:, None], axis=0))
    gain, shift = float(gains[best]), float(shifts[best])
    on = np.zeros(seen.size, bool)
    for _ in range(3):
        on = np.abs(gain * seen + shift - expected) < TOLERANCE * expected
        if np.count_nonzero(on) < max(MIN_FLOOR, MIN_SHARE * seen.size):
            return None
        # Weighted by 1 / expected: relative errors count, near and far floor alike.
        x, y = seen[on] / expected[on], 1 / expected[on]
        if shifted:
            (gain, shift), *_ = np.linalg.lstsq(np.stack([x, y], -1), np.ones(x.size), rcond=None)
        else:
            gain = float(x.sum() / (x @ x))
    low, high = np.quantile(expected[on], [0.05, 0.95])
    if gain <= 0 or (shifted and high < MIN_SPAN * low):
        return None
    return float(gain), float(shift)
