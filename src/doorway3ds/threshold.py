"""How far a doorway's threshold is: from its jambs, not from what is seen through it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from doorway3ds.camera import Array
from doorway3ds.floor import Scene


@dataclass(frozen=True)
class ThresholdParams:
    """Where the jambs are looked for and what is believed of them.

    gap: columns of the depth grid left out beside the edge, where depth mixes wall and opening;
        gap_gain is added per unit of the network's depth error.
    band: width of the strip outside an edge, as a fraction of the picture's width.
    rows: half-height of the strip around mid-height, as a fraction of the picture's height.
    max_ratio: of the two jambs' distances; beyond it one of them is furniture or a door leaf.
    min_width_m, max_width_m: of a believable doorway.
    """

    gap: float = 0.75
    gap_gain: float = 4.0
    band: float = 0.05
    rows: float = 0.2
    max_ratio: float = 1.8
    min_width_m: float = 0.35
    max_width_m: float = 4.0


def locate_threshold(
    scene: Scene,
    edges_px: tuple[float | None, float | None],
    edge_rays: Array,
    params: ThresholdParams,
) -> Array | None:
    """(2,) floor position of the middle of the threshold, None where no jamb tells it.

    edges_px: the opening's left and right column, None where the picture's edge cuts it.
    edge_rays: (3, 3) rays in the floor frame through left edge, middle and right edge.
    """
    ways = edge_rays[:, :2] / np.linalg.norm(edge_rays[:, :2], axis=1, keepdims=True)
    lens = scene.lens[:2]
    reach: list[float | None] = [None, None]
    for side, edge in enumerate(edges_px):
        if edge is not None:
            near, far = (
                _jamb_reach(scene, edge, side, params),
                _floor_reach(scene, edge, side, params),
            )
            reach[side] = _agree(near, far, scene.depth_error)
    left, right = reach
    if left is not None and right is not None:
        jambs = lens + np.array([[left], [right]]) * ways[[0, 2]]
        width = float(np.linalg.norm(jambs[0] - jambs[1]))
        even = max(left, right) <= params.max_ratio * min(left, right)
        if even and params.min_width_m <= width <= params.max_width_m:
            return np.asarray(jambs.mean(axis=0))
        # Furniture in front of one edge is nearer than the wall: believe the farther jamb.
        left, right = (left, None) if left > right else (None, right)
    known = left if left is not None else right
    if known is None:
        return None
    # One jamb: the wall is taken to stand across the camera's axis.
    edge_way = ways[0] if left is not None else ways[2]
    axis = scene.turn[:2, 2] / np.linalg.norm(scene.turn[:2, 2])
    across = float(np.clip((edge_way @ axis) / (ways[1] @ axis), 0.5, 2.0))
    return np.asarray(lens + known * across * ways[1])


def _band(scene: Scene, edge: float, side: int, gap: float, band: float) -> slice:
    """The grid's columns just outside an edge (side 0: left of it, 1: right of it)."""
    columns = scene.columns_px
    pitch = columns[1] - columns[0] if columns.size > 1 else 1.0
    near, reach = gap * pitch, max(3.0 * pitch, band * (columns[-1] - columns[0]))
    low, high = (
        (edge - near - reach, edge - near) if side == 0 else (edge + near, edge + near + reach)
    )
    return slice(int(np.searchsorted(columns, low)), int(np.searchsorted(columns, high, "right")))


def _jamb_reach(scene: Scene, edge: float, side: int, params: ThresholdParams) -> float | None:
    """Horizontal distance from the lens to the jamb, from the depth outside an edge.

    A wall's inverse distance is straight along a row, so a line through the strip's columns is
    drawn on to the edge.
    """
    gap = params.gap + params.gap_gain * scene.depth_error
    band = _band(scene, edge, side, gap, params.band)
    middle = (scene.rows_px[0] + scene.rows_px[-1]) / 2
    reach = params.rows * (scene.rows_px[-1] - scene.rows_px[0] + 1)
    low, high = np.searchsorted(scene.rows_px, [middle - reach, middle + reach])
    x, y = scene.x[low:high, band] - scene.lens[0], scene.y[low:high, band] - scene.lens[1]
    if x.size == 0:
        return None
    axis = scene.turn[:2, 2] / np.linalg.norm(scene.turn[:2, 2])
    ahead = x * axis[0] + y * axis[1]
    known = np.count_nonzero(np.isfinite(ahead), axis=0) >= max(2, ahead.shape[0] // 3)
    if not known.any():
        return None
    inverse = 1 / np.nanmedian(ahead[:, known], axis=0)
    columns = scene.columns_px[band][known]
    typical = float(np.median(inverse))
    if columns.size >= 3 and typical > 0:
        offset = columns - columns.mean()
        slope = float(offset @ inverse) / float(offset @ offset)
        value = float(inverse.mean()) + slope * (edge - float(columns.mean()))
        typical = float(np.clip(value, 0.85 * typical, 1.15 * typical))
    if not typical > 0:
        return None
    row = int(np.argmin(np.abs(scene.rows_px - middle)))
    way = scene.directions[row, int(np.argmin(np.abs(scene.columns_px - edge))), :2]
    return float(np.hypot(*way) / (way @ axis) / typical)


def _floor_reach(scene: Scene, edge: float, side: int, params: ThresholdParams) -> float | None:
    """Horizontal distance from the lens to where the floor ends outside an edge."""
    if scene.floor is None or scene.plane is None:
        return None
    band = _band(scene, edge, side, params.gap, params.band)
    floor = scene.floor[:, band]
    # The floor must reach the picture's lower edge, else furniture hides where it begins.
    whole = floor[-1]
    if np.count_nonzero(whole) < max(1, floor.shape[1] // 2):
        return None
    run = np.cumprod(floor[::-1, whole], axis=0).sum(axis=0)
    top = np.clip(floor.shape[0] - run, 0, floor.shape[0] - 1)
    columns = np.arange(scene.columns_px.size)[band][whole]
    way = scene.directions[top, columns]
    falling = way[:, 2] < -0.02
    if np.count_nonzero(falling) * 2 < falling.size:
        return None
    way = way[falling]
    return float(np.median(np.hypot(way[:, 0], way[:, 1]) * scene.lens[2] / -way[:, 2]))


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
