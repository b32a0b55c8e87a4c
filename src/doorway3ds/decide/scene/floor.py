"""The floor: a robust plane through what is floor, and the scene as it stands on that plane.

With true depth, or where the pose is unknown, it is fitted. A plane that does not pass through the
lens is q . m = 1 for points q counted from the lens. Along one ray the residual q . m - 1 is the
relative error of the depth, so the fit weighs near and far floor as a depth network errs.

Where the pose is known and the depth is a network's, the pose alone tells the floor: networks bend
it by more than a robot errs about its head.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Array, grid_pixels, grid_rays, rotation
from doorway3ds.types import Frame, Perception

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class FloorParams:
    """How a floor is found and believed.

    max_columns: a wider depth map is thinned to about this many columns.
    floor_probability: from which on a pixel counts as floor.
    min_share: of all pixels that must be floor before a plane is fitted.
    inlier: relative depth error within which a point lies on a plane (true depth); grows by
        inlier_gain times the network's depth error.
    max_tilt_deg, max_height_error: how far a fit to true depth may disagree with a known pose.
    max_scale_error: how far a network's metres may disagree with a known height, twice the depth
        error added, and still be halfway corrected by it.
    free_tilt_deg: how far it may lean where the pose is unknown (a hand-held camera).
    """

    max_columns: int = 320
    floor_probability: float = 0.5
    min_share: float = 0.002
    inlier: float = 0.02
    inlier_gain: float = 0.5
    max_tilt_deg: float = 6.0
    max_height_error: float = 0.12
    max_scale_error: float = 0.12
    free_tilt_deg: float = 35.0


@dataclass(frozen=True)
class FloorPlane:
    """The floor under the camera.

    normal: unit vector up, in the axes of the robot frame as the pose gives them.
    height_m: of the lens above it. tilt_deg: between the normal and the pose's z axis.
    fitted: False if the pose alone gives it. share: of the floor pixels that lie on it.
    """

    normal: tuple[float, float, float]
    height_m: float
    tilt_deg: float
    fitted: bool
    share: float


@dataclass(frozen=True)
class Scene:
    """Depth as points in the floor frame: x forward, y left, z up from the floor, metres.

    The origin lies under the turning axis. Arrays are (h, w) unless told otherwise, on a thinned
    grid of the depth map; its rows and columns stand in the image at rows_px, columns_px.
    directions: (3, h, w) rays in the floor frame with unit step along the optical axis.
    plane: None if the floor is unknown; z then counts from the lens. height_known: whether the
    lens's height is known from the pose, rather than from the fit alone.
    turn: (3, 3) camera frame -> floor frame. lens: its position in the floor frame.
    """

    x: Array
    y: Array
    z: Array
    directions: Array
    floor: Mask | None
    rows_px: Array
    columns_px: Array
    turn: Array
    lens: Array
    plane: FloorPlane | None
    height_known: bool
    depth_error: float


def build_scene(
    perception: Perception, frame: Frame, params: FloorParams | None = None
) -> Scene | None:
    """The scene of a perception with depth, standing on its floor; None without depth.

    Where the camera's height is known and the depth comes from a network, depth is scaled halfway
    to where its floor would lie at that height: either alone errs more.
    """
    if perception.depth_m is None:
        return None
    params = params or FloorParams()
    height, width = perception.depth_m.shape
    step = max(1, round(width / params.max_columns))
    rows, columns = grid_pixels(width, height, step)
    depth = perception.depth_m[rows[0] :: step, columns[0] :: step].astype(np.float64)
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, np.nan)
    rays = grid_rays(frame.camera.stretched_to(width, height), step)
    floor = None
    if perception.floor is not None:
        floor = floor_mask(perception.floor, rows, columns, (height, width), params)

    turn, height_m, error = rotation(frame.pose), frame.pose.height_m, perception.depth_error
    plane: FloorPlane | None = None
    scale = 1.0
    q = _floor_points(rays, depth, floor, turn, height_m, error, params)
    if q is not None and height_m is not None and error > 0:
        scale = _scale(q, height_m, error, params)
    elif q is not None:
        plane = _fit(q, height_m, error, params)
    if plane is None and height_m is not None:
        plane = FloorPlane((0.0, 0.0, 1.0), height_m, 0.0, False, 0.0)
    if plane is not None:
        turn = _upright(np.array(plane.normal)) @ turn
    lens_height = 0.0 if plane is None else plane.height_m
    lens = np.array([frame.pose.forward_m, frame.pose.left_m, lens_height])
    # Planes of x, y, z rather than rows of points: numpy works along memory.
    directions = (turn @ rays.reshape(-1, 3).T).reshape(3, *depth.shape)
    x, y, z = directions * (depth * scale) + lens[:, None, None]
    camera = frame.camera
    return Scene(
        x=x,
        y=y,
        z=z,
        directions=directions,
        floor=floor,
        rows_px=(rows + 0.5) * camera.height / height - 0.5,
        columns_px=(columns + 0.5) * camera.width / width - 0.5,
        turn=turn,
        lens=lens,
        plane=plane,
        height_known=height_m is not None,
        depth_error=error,
    )


def floor_mask(
    floor: NDArray[np.float32],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    size: tuple[int, int],
    params: FloorParams,
) -> Mask:
    """The floor mask at the depth grid's pixels, by the nearest pixel of its own size.

    rows, columns: of a depth map of `size` (h, w), as `camera.model.grid_pixels` gives them.
    """
    r = np.minimum((rows + 0.5) * floor.shape[0] / size[0], floor.shape[0] - 1).astype(np.intp)
    c = np.minimum((columns + 0.5) * floor.shape[1] / size[1], floor.shape[1] - 1).astype(np.intp)
    # Rows are copied whole, and single bytes are then picked: a third of the time of np.ix_.
    return np.asarray((floor >= params.floor_probability).take(r, axis=0).take(c, axis=1))


def _upright(normal: Array) -> Array:
    """The smallest rotation that takes `normal` to z."""
    x, y, z = normal
    k = 1 / (1 + z)
    return np.array([[1 - k * x * x, -k * x * y, -x], [-k * x * y, 1 - k * y * y, -y], [x, y, z]])


def _floor_points(
    rays: Array,
    depth: Array,
    floor: Mask | None,
    turn: Array,
    height_m: float | None,
    depth_error: float,
    params: FloorParams,
) -> Array | None:
    """(n, 3) points of the floor, counted from the lens in the pose's axes; None if too few."""
    seen = np.isfinite(depth)
    if floor is not None:
        seen &= floor
    elif height_m is not None:
        # Without a mask only what lies near the known floor can be floor.
        above = (rays @ turn[2]) * np.where(seen, depth, 0.0) + height_m
        seen &= np.abs(above) < (0.1 + 2 * depth_error) * height_m
    else:
        return None
    if np.count_nonzero(seen) < max(12, params.min_share * seen.size):
        return None
    rows, columns = np.nonzero(seen)
    thin = slice(None, None, max(1, rows.size // 800))
    rows, columns = rows[thin], columns[thin]
    return np.asarray((rays[rows, columns] * depth[rows, columns, None]) @ turn.T)


def _scale(q: Array, height_m: float, depth_error: float, params: FloorParams) -> float:
    """What to multiply a network's depth by, from its floor points (n, 3)."""
    found = float(np.median(-q[:, 2])) / height_m
    most = 1 + params.max_scale_error + 2 * depth_error
    return 1 / math.sqrt(found) if 1 / most <= found <= most else 1.0


def _fit(
    q: Array, height_m: float | None, depth_error: float, params: FloorParams
) -> FloorPlane | None:
    """Plane through most of the points q (n, 3), which count from the lens in robot axes."""
    tolerance = params.inlier + params.inlier_gain * depth_error
    max_tilt = params.free_tilt_deg if height_m is None else params.max_tilt_deg

    rng = np.random.default_rng(0)  # fixed: the same image gives the same plane
    triples = q[rng.integers(0, len(q), (48, 3))]
    guesses = _cofactor_solve(triples)
    norm = np.linalg.norm(guesses, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        usable = (-guesses[:, 2] / norm > math.cos(math.radians(max_tilt))) & (norm < 100)
        if height_m is not None:
            too_far = np.abs(1 / (norm * height_m) - 1)
            usable &= too_far < params.max_height_error
    if height_m is not None:
        guesses = np.vstack([guesses[usable], [[0.0, 0.0, -1 / height_m]]])
    else:
        guesses = guesses[usable]
    if len(guesses) == 0:
        return None
    off = guesses @ q.T
    off -= 1
    near = np.abs(off, out=off) < tolerance
    votes = [np.count_nonzero(row) for row in near]  # by axis it takes five times as long
    m = guesses[np.argmax(votes)]

    # Few or bunched points leave the tilt open: a weak pull towards the pose, worth about 20
    # points, decides it then and is nothing beside a floor that is seen well.
    spread = math.radians(max_tilt / 2)
    inliers = np.zeros(len(q), dtype=bool)
    for _ in range(3):
        inliers = np.abs(q @ m - 1) < tolerance
        if np.count_nonzero(inliers) < 12:
            return None
        points = q[inliers]
        pull = 20 * (tolerance / 2 / spread) ** 2 / float(m @ m)
        weights = np.diag([pull, pull, 0.0])
        m = np.linalg.solve(points.T @ points + weights, points.sum(axis=0))
    height = float(1 / np.linalg.norm(m))
    normal = -m * height
    tilt = math.degrees(math.acos(min(1.0, float(normal[2]))))
    share = float(np.count_nonzero(inliers) / len(q))
    if normal[2] <= 0 or tilt > max_tilt or share < 0.3:
        return None
    if height_m is not None and abs(height / height_m - 1) > params.max_height_error:
        return None
    nx, ny, nz = (float(v) for v in normal)
    return FloorPlane((nx, ny, nz), height, tilt, True, share)


def _cofactor_solve(triples: Array) -> Array:
    """m with triple @ m = 1 for (n, 3, 3) triples of points; inf or nan where they align."""
    a, b, c = triples[:, 0], triples[:, 1], triples[:, 2]
    spanned = _cross(b, c)
    normal = _cross(a, b) + spanned + _cross(c, a)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(normal / np.einsum("ij,ij->i", a, spanned)[:, None])


def _cross(a: Array, b: Array) -> Array:
    """Row by row of (n, 3); np.cross spends most of its time on axes."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
