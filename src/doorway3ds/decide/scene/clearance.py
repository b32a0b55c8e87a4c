"""Is the way to a doorway free over the robot's whole width?

The robot's footprint is swept from the turning axis to the threshold. Points that stand above
the floor inside it block, and so does a place where the camera looks through the floor's plane
and sees something lower: a step down. What the camera cannot see is unknown, never free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Array, Camera, ray_to_pixel
from doorway3ds.decide.scene.floor import FloorPlane, Mask, Scene


@dataclass(frozen=True)
class ClearanceParams:
    """What blocks the way.

    width_m: of the swept footprint (NAO: 0.275 m over its shoulders).
    start_m: the sweep begins this far from the turning axis, at the robot's own front.
    headroom_m: what hangs higher does not block (Pepper is 1.21 m tall).
    max_range_m: how far to sweep where the threshold's distance is unknown.
    min_height_m: with true depth, what rises less above the floor can be walked over; the same
        limit holds for a step down.
    height_gain: added to it per metre of distance and unit of the network's depth error.
    max_height_limit_m: the limit never exceeds this.
    min_group: points of a connected group on the depth grid that block, with true depth.
    group_gain: added to it per unit of depth error, as a fraction of the grid's points.
    floor_veto: with a network's depth, a group blocks only if at most this fraction of its
        points is called floor by the floor mask (1: the mask has no say).
    mask_blocks: with a network's depth and a camera of known height, this fraction of the way
        called not floor blocks, whatever depth and vote say (above 1: never). Of a hand-held
        camera the way's place in the image hangs on the depth, and the mask has no say.
    mask_down: the same where the camera looks down along the way (`look_down`).
    mask_margin_m, mask_reach: that way is wider than the robot, since a network's doorway is off
        by a few centimetres, and ends at this fraction of the range, before the threshold.
    vote_blocks: with a network's depth, the network's own probability that the way is free
        blocks below this even where the depth sees nothing (0: never).
    vote_alone: the same limit where the depth shows no floor on the way, so that nothing but
        the vote speaks.
    vote_frees: from this on it overrules what the depth calls an obstacle (above 1: never).
    """

    width_m: float = 0.28
    start_m: float = 0.15
    headroom_m: float = 1.3
    max_range_m: float = 3.0
    min_height_m: float = 0.04
    height_gain: float = 0.3
    max_height_limit_m: float = 0.35
    min_group: float = 3.0
    group_gain: float = 0.02
    floor_veto: float = 0.5
    mask_blocks: float = 0.1
    mask_down: float = 0.3
    mask_margin_m: float = 0.06
    mask_reach: float = 0.93
    vote_blocks: float = 0.0
    vote_alone: float = 0.0
    vote_frees: float = 1.1


@dataclass(frozen=True)
class Clearance:
    """What the sweep found.

    clear: True if floor was seen and nothing blocks, False if something does, None if
        no floor was seen in the footprint.
    floor_from_m: distance from the turning axis at which floor comes into view in the swept
        direction, None if it never does.
    corridor_m: (4, 2) corners of the footprint on the floor, robot frame.
    corridor_px: (n, 2) the same outline in the image (x, y), from where it can be seen.
    obstacle_px: (n, 2) image points of what blocks, None if nothing does.
    obstacle_m: distance of its nearest point along the way, None if nothing does.
    """

    clear: bool | None
    floor_from_m: float | None
    corridor_m: Array
    corridor_px: Array
    obstacle_px: Array | None
    obstacle_m: float | None
    floor_plane: FloorPlane | None

    def evidence(self) -> dict[str, Any]:
        """As `Selection.evidence` carries it to whoever draws or logs."""
        return {
            "corridor_m": self.corridor_m,
            "corridor_px": [(float(x), float(y)) for x, y in self.corridor_px],
            "obstacle_px": self.obstacle_px,
            "obstacle_m": self.obstacle_m,
            "floor_plane": self.floor_plane,
        }


def sweep(
    scene: Scene,
    camera: Camera,
    bearing_deg: float,
    range_m: float | None,
    params: ClearanceParams,
    vote: float | None = None,
) -> Clearance:
    """Sweep the footprint from the turning axis along a bearing up to the threshold.

    vote: the network's own probability that the way is free, if it gives one.
    """
    reach = params.max_range_m if range_m is None else range_m
    way = np.array([math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))])
    corridor = _corridor(way, params.start_m, max(reach, params.start_m), params.width_m)
    if scene.depth_error == 0:
        vote = None  # true depth needs no second opinion
    if scene.plane is None:
        clear = False if vote is not None and vote < params.vote_alone else None
        return Clearance(clear, None, corridor, np.empty((0, 2)), None, None, None)

    x, y, z, floor = scene.x, scene.y, scene.z, scene.floor
    way_x, way_y, way_z = scene.directions
    half = params.width_m / 2

    def place(px: Array, py: Array) -> tuple[Array, Array]:
        return px * way[0] + py * way[1], np.abs(py * way[0] - px * way[1])

    with np.errstate(invalid="ignore", divide="ignore"):
        fall = scene.lens[2] / -way_z
        ground_x = scene.lens[0] + way_x * fall
        ground_y = scene.lens[1] + way_y * fall
        ground_along, ground_aside = place(ground_x, ground_y)
        ahead = (fall > 0) & (ground_along >= params.start_m)
        on_ground = ahead & (ground_aside <= half)
        along, aside = place(x, y)
        in_way = (aside <= half) & (along >= params.start_m)
        limit = np.minimum(
            params.min_height_m + params.height_gain * scene.depth_error * along,
            params.max_height_limit_m,
        )
        high = in_way & (along <= reach) & (z > limit) & (z < params.headroom_m)
        # Below the floor: what matters is where the ray went through the floor's plane.
        low = on_ground & (ground_along <= reach) & (z < -limit)
        flat = np.abs(z) <= limit

    size = params.min_group + params.group_gain * scene.depth_error * z.size
    veto = params.floor_veto if scene.depth_error > 0 and floor is not None else 1.0
    block = _largest_group(high, floor, size, veto)
    if block is None:
        block = _largest_group(low, floor, size, veto)
    if vote is not None and vote >= params.vote_frees:
        block = None

    seen = on_ground & (flat if scene.depth_error == 0 or floor is None else floor)
    distances = np.sort(ground_along[seen])
    # The third nearest pixel: one stray pixel is no floor.
    floor_from = float(distances[min(2, distances.size - 1)]) if distances.size else None
    if block is None and scene.depth_error > 0 and scene.height_known and floor is not None:
        wide = ahead & (ground_aside <= half + params.mask_margin_m / 2)
        wide &= ground_along <= params.mask_reach * reach
        bare = wide & ~floor
        least_bare = params.mask_blocks * np.count_nonzero(wide)
        if np.count_nonzero(bare) > max(params.min_group, least_bare):
            block, along = bare, ground_along

    seen_floor = floor_from is not None and floor_from < reach
    least = params.vote_blocks if seen_floor else params.vote_alone
    clear = None
    obstacle_px, obstacle_m = None, None
    if block is None and vote is not None and vote < least:
        clear = False
    elif block is not None:
        clear = False
        rows, columns = np.nonzero(block)
        obstacle_px = np.stack([scene.columns_px[columns], scene.rows_px[rows]], axis=-1)
        obstacle_m = float(np.nanmin(np.where(z[block] < 0, ground_along[block], along[block])))
    elif seen_floor:
        clear = True
    start = params.start_m if floor_from is None else floor_from
    return Clearance(
        clear=clear,
        floor_from_m=floor_from,
        corridor_m=corridor,
        corridor_px=_outline(scene, camera, way, min(start, reach), reach, params.width_m),
        obstacle_px=obstacle_px,
        obstacle_m=obstacle_m,
        floor_plane=scene.plane,
    )


def look_down(
    scene: Scene, camera: Camera, bearing_deg: float, range_m: float | None, params: ClearanceParams
) -> Clearance:
    """The sweep for an image that is taken with the head down, along a way that was found free.

    Of a network only its floor mask counts: steep views are where its depth and vote are worst.
    """
    params = replace(params, mask_blocks=params.mask_down, vote_frees=0.0)
    return sweep(scene, camera, bearing_deg, range_m, params, vote=1.0)


def _corridor(way: Array, near: float, far: float, width: float) -> Array:
    left = np.array([-way[1], way[0]]) * width / 2
    return np.array([near * way + left, far * way + left, far * way - left, near * way - left])


def _outline(
    scene: Scene, camera: Camera, way: Array, near: float, far: float, width: float
) -> Array:
    """The footprint's outline on the floor in the image, in drawing order."""
    side = np.linspace(near, max(far, near), 12)
    left = np.array([-way[1], way[0]]) * width / 2
    ground = np.concatenate([side[:, None] * way + left, side[::-1, None] * way - left])
    points = np.column_stack([ground, np.zeros(len(ground))]) - scene.lens
    pixels = ray_to_pixel(camera, points @ scene.turn)
    return np.asarray(pixels[np.isfinite(pixels).all(axis=1)])


def _largest_group(mask: Mask, floor: Mask | None, size: float, veto: float) -> Mask | None:
    """The largest 8-connected group of at least `size` points that the floor mask allows."""
    if np.count_nonzero(mask) < size:
        return None
    labels, sizes = label_groups(mask)
    for label in np.argsort(sizes)[::-1]:
        if sizes[label] < size:
            return None
        group = labels == label
        if floor is None or veto >= 1 or np.mean(floor[group]) <= veto:
            return np.asarray(group)
    return None


def label_groups(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Labels (h, w) of the 8-connected groups of a mask, -1 outside, and their sizes."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    sizes = stats[1:, cv2.CC_STAT_AREA]
    return np.asarray(labels - 1, np.int32), np.asarray(sizes, np.int32)
