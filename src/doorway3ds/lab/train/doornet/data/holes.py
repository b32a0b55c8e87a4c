"""Rectangular holes in the walls of a photographed room, in true perspective.

Depth and classes of a room tell the planes of its walls and its floor; a hole of so many metres
stands upright on the floor and is seen as its four corners. Inverse depth is linear in the pixel
on a plane, so planes are least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.train.doornet.data.samples import UNKNOWN, Sample

Array = NDArray[Any]

WALL, FLOOR, DOOR, WINDOW, OTHER = 1, 2, 3, 4, 0  # classes of Sample.segments
_HELD_M = (1.1, 1.5)  # height of a camera held in the hand, where no floor tells
_FAR_M = 12.0  # stands for what is too far to be measured


@dataclass(frozen=True)
class Plane:
    """normal . point = 1 for the points of the plane; camera axes, metres."""

    normal: Array

    @property
    def unit(self) -> Array:
        """Away from the camera."""
        return np.asarray(self.normal / np.linalg.norm(self.normal))

    def depth(self, rays: Array) -> Array:
        """(..., 3) rays with z = 1 to metres along the optical axis; inf where none is met."""
        inverse = rays @ self.normal
        return np.asarray(np.where(inverse > 1e-3, 1 / np.maximum(inverse, 1e-3), np.inf))


@dataclass(frozen=True)
class Size:
    """Of a hole in metres: its lower and upper edge are heights above the floor."""

    width: float
    sill: float
    top: float


@dataclass(frozen=True)
class Hole:
    """Quadrilaterals (4, 2) in pixels: corners at left bottom, left top, right top, right bottom.

    front: where it opens in the wall; back: at the wall's other face; casing: around its frame.
    """

    front: Array
    back: Array
    casing: Array
    wall: Plane


def cut(host: Sample, size: Size, rng: np.random.Generator) -> Hole | None:
    """A hole somewhere in a wall of the room; None where none is found that stands on the floor."""
    classes, depth = classes_of(host), depth_of(host)
    known = (depth > 0.5) & (depth < _FAR_M)
    rows, columns = np.nonzero((classes == WALL) & (depth > 1.2) & (depth < 7))
    if len(rows) < 500:
        return None
    at = rng.integers(len(rows))
    u, v = int(columns[at]), int(rows[at])
    reach = max(12, int(0.5 * host.camera[0] / depth[v, u]))
    near = np.zeros_like(known)
    near[:, max(0, u - reach) : u + reach] = True
    wall = fit_plane(host, (classes == WALL) & known & near, rng)
    if wall is None:
        return None
    floor = fit_plane(host, (classes == FLOOR) & known, rng)
    up, height = np.array([0, -1.0, 0]), float(rng.uniform(*_HELD_M))
    if floor is not None and floor.unit[1] > 0.8:
        up, height = -floor.unit, float(1 / np.linalg.norm(floor.normal))
        if not 0.6 < height < 2.2:
            return None
    upright = up - (up @ wall.unit) * wall.unit
    if np.linalg.norm(upright) < 0.8:
        return None  # a ceiling or a table that is called wall
    upright /= np.linalg.norm(upright)
    along = np.cross(upright, wall.unit)
    ray = _rays_at(host, v, u)
    point = ray * wall.depth(ray)
    foot = point - upright * ((height + point @ up) / (upright @ up))
    if floor is None and size.sill == 0 and _project(host, foot[None])[0, 1] < len(classes):
        return None  # where the wall meets the floor is anybody's guess

    def corners(grow: float, low: float, back: float) -> Array:
        half, high = size.width / 2 + grow, size.top + grow
        ends = [(-half, low), (-half, high), (half, high), (half, low)]
        on_wall = np.array([a * along + b * upright for a, b in ends])
        return _project(host, foot + on_wall + back * wall.unit)

    thickness, casing = rng.uniform(0.0, 0.22), rng.uniform(0.03, 0.12)
    front = corners(0, size.sill, 0)
    if not np.isfinite(front).all() or np.abs(front).max() > 4000:
        return None
    if front[0, 0] > front[3, 0]:
        along = -along
        front = corners(0, size.sill, 0)
    frame = corners(casing, size.sill - (casing if size.sill else 0), 0)
    return Hole(front, corners(0, size.sill, thickness), frame, wall)


def fit_plane(sample: Sample, mask: Array, rng: np.random.Generator) -> Plane | None:
    """The plane of a region's points, where most of them lie on one; trimmed twice."""
    rows, columns = np.nonzero(mask)
    if len(rows) < 200:
        return None
    pick = rng.integers(len(rows), size=400)
    rows, columns = rows[pick], columns[pick]
    rays, depth = _rays_at(sample, rows, columns), depth_of(sample)[rows, columns]
    near = np.ones(len(depth), bool)
    normal: Array = np.zeros(3)
    for limit in (0.15, 0.06, 0.04):
        normal = np.linalg.lstsq(rays[near], 1 / depth[near], rcond=None)[0]
        near = np.abs(depth * (rays @ normal) - 1) < limit
        if near.sum() < 0.5 * len(depth):
            return None
    return Plane(normal)


def horizon(sample: Sample) -> float:
    """Row of the horizon in the image's middle, by its floor; else that of the optical axis."""
    _, fy, _, cy = sample.camera
    depth = depth_of(sample)
    known = (depth > 0.5) & (depth < _FAR_M)
    seen = (classes_of(sample) == FLOOR) & known
    floor = fit_plane(sample, seen, np.random.default_rng(0))
    if floor is None or floor.unit[1] < 0.8:
        return cy
    return float(np.clip(cy - fy * floor.normal[2] / floor.normal[1], 0, len(sample.image)))


def depth_of(sample: Sample) -> Array:
    """(H, W) metres; what is unknown is very far."""
    assert sample.depth_m is not None
    return np.asarray(np.nan_to_num(sample.depth_m, nan=_FAR_M))


def classes_of(sample: Sample) -> Array:
    """(H, W) uint8, see `Sample.segments`."""
    assert sample.segments is not None
    return sample.segments


def rays_of(sample: Sample) -> Array:
    """(H, W, 3), z = 1."""
    rows, columns = sample.image.shape[:2]
    return _rays_at(sample, *np.mgrid[0:rows, 0:columns])


def _rays_at(sample: Sample, rows: Any, columns: Any) -> Array:
    """(..., 3) through pixels, z = 1."""
    fx, fy, cx, cy = sample.camera
    return np.stack([(columns - cx) / fx, (rows - cy) / fy, np.ones(np.shape(rows))], axis=-1)


def _project(sample: Sample, points: Array) -> Array:
    """(N, 3) to (N, 2) pixels; nan behind or next to the camera."""
    fx, fy, cx, cy = sample.camera
    z = np.where(points[:, 2] > 0.2, points[:, 2], np.nan)
    return np.stack([fx * points[:, 0] / z + cx, fy * points[:, 1] / z + cy], axis=-1)


def filled(corners: Array, shape: tuple[int, ...], smooth: bool = False) -> Array:
    """The polygon as booleans, or as float32 shares with smooth sides."""
    mask = np.zeros(shape, np.uint8)
    fixed = np.round(np.nan_to_num(corners) * 16).astype(np.int32)
    cv2.fillConvexPoly(mask, fixed, 255, cv2.LINE_AA if smooth else cv2.LINE_8, shift=4)
    return mask.astype(np.float32) / 255 if smooth else mask > 0


def column_at(edge: Array, rows: int) -> float:
    """Column of a line through two points at the image's mid-height."""
    (x0, y0), (x1, y1) = edge
    share = ((rows - 1) / 2 - y0) / (y1 - y0) if abs(y1 - y0) > 1e-6 else 0.5
    return float(x0 + share * (x1 - x0))


def free_edges(hole: Hole, rows: int) -> tuple[float, float]:
    """Columns at mid-height between which one looks through both faces of the wall."""
    left = max(column_at(quad[[0, 1]], rows) for quad in (hole.front, hole.back))
    right = min(column_at(quad[[3, 2]], rows) for quad in (hole.front, hole.back))
    return left, right


def sill_seen(hole: Hole, region: Array) -> bool:
    """Whether the middle of the lower edge is seen: only it tells a window from a doorway."""
    rows, columns = region.shape
    x, y = (hole.front[0] + hole.front[3]) / 2
    return bool(0 <= x < columns and 4 <= y < rows and region[int(y) - 4 : int(y), int(x)].any())


def way_to(hole: Hole, left: float, right: float, host: Sample) -> int | None:
    """1 where only floor is seen below the opening, 0 where hardly any, None between."""
    columns = host.image.shape[1]
    middle, quarter = (left + right) / 2, (right - left) / 4
    low, high = max(0, round(middle - quarter)), min(columns, round(middle + quarter) + 1)
    foot = max(0, round((hole.front[0, 1] + hole.front[3, 1]) / 2) + 2)
    before = classes_of(host)[foot:, low:high] if high > low else np.zeros(0)
    before = before[before != UNKNOWN]
    if before.size < 30:
        return None
    share = float((before == FLOOR).mean())
    return 1 if share > 0.93 else 0 if share < 0.5 else None
