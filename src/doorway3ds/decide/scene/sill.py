"""How far a doorway's threshold is: from its jambs, not from what is seen through it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from doorway3ds.camera.model import Array
from doorway3ds.decide.scene.floor import Mask, Scene


@dataclass(frozen=True)
class ThresholdParams:
    """Where the jambs are looked for and what is believed of them.

    gap: columns of the depth grid left out beside the edge, where depth mixes wall and opening;
        gap_gain is added per unit of the network's depth error.
    band: width of the strip outside an edge, as a fraction of the image's width.
    low_m, high_m: height above the floor between which a jamb is looked for.
    same: relative difference within which points belong to one wall.
    beyond: a jamb is not farther than what is seen through the opening times this.
    max_ratio: of the two jambs' distances; beyond it one of them is furniture or a door leaf.
    min_width_m, max_width_m: of a believable doorway.
    """

    gap: float = 0.75
    gap_gain: float = 4.0
    band: float = 0.05
    low_m: float = 0.2
    high_m: float = 1.9
    same: float = 0.15
    beyond: float = 1.1
    max_ratio: float = 1.8
    min_width_m: float = 0.35
    max_width_m: float = 4.0


@dataclass(frozen=True)
class Walls:
    """The scene by vertical planes through the lens, (h, w) each.

    slope: tangent of a ray's bearing against the camera's axis, + left. ahead: horizontal
    distance along that axis. A wall is a straight line in 1 / ahead over slope.
    wall: may belong to a jamb. ground: `ahead` where the ray meets the floor's plane, nan for
    pixels that are not floor; None if no floor is known. pitch: slope from one column of
    the grid to the next. axis: (2,) unit vector of the camera's axis on the floor.
    least, most: (w,) of the slopes in each column.
    """

    slope: Array
    ahead: Array
    wall: Mask
    ground: Array | None
    pitch: float
    axis: Array
    least: Array
    most: Array

    def columns(self, low: float, high: float) -> slice:
        """The columns that hold every slope from low to high, so that others need no look."""
        found = np.flatnonzero((self.most >= low - 1e-9) & (self.least <= high + 1e-9))
        return slice(int(found[0]), int(found[-1]) + 1) if found.size else slice(0, 0)


def locate_threshold(
    scene: Scene,
    walls: Walls,
    edges: Array,
    seen: tuple[bool, bool],
    params: ThresholdParams,
) -> Array | None:
    """(2,) floor position of the middle of the threshold, None if no jamb tells it.

    edges: (3, 3) rays in the floor frame through the opening's left edge, middle, right edge.
    seen: whether its left and right edge are jambs, and not the image's own edge.
    """
    axis = walls.axis
    aside = np.array([-axis[1], axis[0]])
    slopes = (edges[:, :2] @ aside) / (edges[:, :2] @ axis)
    found = [
        _jamb(scene, walls, float(slopes[edge]), outward, params) if seen[side] else None
        for side, (edge, outward) in enumerate(((0, 1), (2, -1)))
    ]

    def place(ahead: float, slope: float) -> Array:
        return np.asarray(scene.lens[:2] + ahead * (axis + slope * aside))

    left, right = _within(walls, slopes, found, params)
    if left is not None and right is not None:
        one, two = place(left, slopes[0]), place(right, slopes[2])
        width = float(np.linalg.norm(one - two))
        even = max(left, right) <= params.max_ratio * min(left, right)
        if even and params.min_width_m <= width <= params.max_width_m:
            return (one + two) / 2
        # Furniture in front of one edge is nearer than the wall: believe the farther jamb.
        left, right = (left, None) if left > right else (None, right)
    known = left if left is not None else right
    # With one jamb, the wall is taken to stand across the camera's axis.
    return None if known is None else place(known, float(slopes[1]))


def _within(
    walls: Walls, slopes: Array, jambs: list[float | None], params: ThresholdParams
) -> tuple[float | None, float | None]:
    """The jambs less one that lies beyond what is seen through the opening: not of its wall."""
    left, right = jambs
    at = walls.columns(float(slopes[2]), float(slopes[0]))
    slope = walls.slope[:, at]
    inside = walls.wall[:, at] & (slope < slopes[0]) & (slope > slopes[2])
    through = walls.ahead[:, at][inside]
    if left is not None and right is not None and through.size >= 5:
        limit = params.beyond * float(np.quantile(through, 0.8))
        if max(left, right) > limit:
            return (left, None) if left < right else (None, right)
    return left, right


def see_walls(scene: Scene, params: ThresholdParams) -> Walls:
    """The scene seen along the camera's horizontal axis."""
    axis = scene.turn[:2, 2] / np.linalg.norm(scene.turn[:2, 2])
    way_x, way_y, way_z = scene.directions
    forward = way_x * axis[0] + way_y * axis[1]
    slope = (way_y * axis[0] - way_x * axis[1]) / forward
    ahead = (scene.x - scene.lens[0]) * axis[0] + (scene.y - scene.lens[1]) * axis[1]
    wall = ahead > 0.05  # nan is not
    ground: Array | None = None
    if scene.plane is None:
        rows = np.abs(np.linspace(-1, 1, ahead.shape[0])) < 0.4
        wall &= rows[:, None]
    else:
        wall &= (scene.z > params.low_m) & (scene.z < params.high_m)
        if scene.floor is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                fall = scene.lens[2] / -way_z
            ground = np.where(scene.floor & (fall > 0), fall * forward, np.nan)
    middle = slope[slope.shape[0] // 2]
    pitch = float(abs(middle[0] - middle[-1])) / max(1, middle.size - 1)
    least, most = np.fmin.reduce(slope), np.fmax.reduce(slope)
    return Walls(slope, ahead, wall, ground, pitch, axis, least, most)


def _jamb(
    scene: Scene, walls: Walls, edge: float, outward: int, params: ThresholdParams
) -> float | None:
    """Distance of a jamb along the camera's axis; `outward` is 1 at the left edge, -1 right."""
    gap = (params.gap + params.gap_gain * scene.depth_error) * walls.pitch
    reach = max(3.0, params.band * walls.slope.shape[1]) * walls.pitch
    ends = (edge + outward * gap, edge + outward * (gap + reach))
    at = walls.columns(min(ends), max(ends))
    slopes, wall = walls.slope[:, at], walls.wall[:, at]
    off = (slopes - edge) * outward
    strip = (off >= gap) & (off <= gap + reach)
    wall = strip & wall
    inverse = 1 / walls.ahead[:, at][wall]
    jamb: float | None = None
    if inverse.size >= 5:
        slope = slopes[wall]
        typical = float(np.median(inverse))
        same = np.abs(inverse - typical) <= params.same * typical
        if np.count_nonzero(same) < 3:
            same[:] = True
        offset, value = slope[same] - edge, inverse[same]
        spread = offset - offset.mean()
        tilt = float(spread @ value) / max(float(spread @ spread), 1e-12)
        drawn_on = float(value.mean()) - tilt * float(offset.mean())
        jamb = 1 / float(np.clip(drawn_on, 0.8 * typical, 1.2 * typical))
    floor: float | None = None
    if walls.ground is not None and (jamb is None or scene.depth_error > 0):
        ground = walls.ground[:, at]
        with np.errstate(invalid="ignore"):
            farthest = np.where(strip & (ground > 0), ground, 0.0).max(axis=0)
        if np.count_nonzero(farthest) >= 2:
            floor = float(np.median(farthest[farthest > 0]))
    return _agree(jamb, floor, scene.depth_error)


def _agree(jamb: float | None, floor: float | None, depth_error: float) -> float | None:
    """One distance from the jamb's depth and the floor's end, each weighed by its error.

    True depth needs no second opinion. The floor's end errs by about 1.5 deg, so the more the
    farther it is; where the two contradict each other, the jamb stands.
    """
    if jamb is None or floor is None or depth_error == 0:
        return jamb if jamb is not None else floor
    jamb_error, floor_error = max(depth_error, 0.02), 0.05 + 0.04 * floor
    difference = math.log(floor / jamb)
    if abs(difference) > 2.5 * math.hypot(jamb_error, floor_error):
        return jamb
    share = jamb_error**2 / (jamb_error**2 + floor_error**2)
    return jamb * math.exp(share * difference)
