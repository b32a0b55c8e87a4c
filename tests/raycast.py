"""A small analytic ray caster: rooms with doorways, boxes and steps, and the truth about them.

It has its own pinhole arithmetic, so that it checks the package instead of repeating it. The
world is the robot frame: x forward, y left, z up, origin on the floor under the turning axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.types import Frame, Perception


@dataclass(frozen=True)
class Box:
    """A box that stands at z0..z1, `size` deep (x) and wide (y) before it turns by turn_deg."""

    x: float
    y: float
    size: tuple[float, float]
    z0: float
    z1: float
    turn_deg: float = 0.0


@dataclass(frozen=True)
class Room:
    """A wall across the robot's way with one doorway, and what stands in front of it.

    The wall's near face passes through `distance` ahead, its normal turned by turn_deg; the
    doorway's middle lies `aside` metres to the left along it.
    step: (distance, drop) of an edge in the floor where it goes down, or None.
    """

    distance: float = 3.0
    aside: float = 0.0
    width: float = 0.9
    turn_deg: float = 0.0
    thickness: float = 0.1
    beyond: float = 3.0
    boxes: tuple[Box, ...] = ()
    step: tuple[float, float] | None = None

    @property
    def along(self) -> np.ndarray:
        a = math.radians(self.turn_deg)
        return np.array([-math.sin(a), math.cos(a)])

    @property
    def ahead(self) -> np.ndarray:
        a = math.radians(self.turn_deg)
        return np.array([math.cos(a), math.sin(a)])

    @property
    def middle(self) -> np.ndarray:
        """Floor position of the middle of the threshold, on the wall's near face."""
        return np.array([self.distance, 0.0]) + self.aside * self.along

    def solids(self) -> list[Box]:
        wall_x = self.thickness / 2
        far = self.width / 2
        reach = 6.0

        def piece(off: float, span: float, z0: float, z1: float, depth: float, back: float) -> Box:
            place = self.middle + off * self.along + back * self.ahead
            return Box(place[0], place[1], (depth, span), z0, z1, self.turn_deg)

        return [
            piece(far + reach / 2, reach, 0.0, 2.6, self.thickness, wall_x),
            piece(-far - reach / 2, reach, 0.0, 2.6, self.thickness, wall_x),
            piece(0.0, self.width, 2.0, 2.6, self.thickness, wall_x),
            piece(0.0, 20.0, 0.0, 2.6, 0.1, self.beyond),
            piece(-self.aside - 4.5, 0.1, 0.0, 2.6, 12.0, 0.0),
            piece(-self.aside + 4.5, 0.1, 0.0, 2.6, 12.0, 0.0),
            *self.boxes,
        ]

    def mirrored(self) -> Room:
        boxes = tuple(replace(b, y=-b.y, turn_deg=-b.turn_deg) for b in self.boxes)
        return replace(self, aside=-self.aside, turn_deg=-self.turn_deg, boxes=boxes)


@dataclass(frozen=True)
class View:
    """What a camera sees of a room, all of it true.

    depth: (h, w). floor: (h, w) bool. ids: (h, w) index of the box in room.boxes, -1 elsewhere.
    points: (h, w, 3). span: the free opening's columns at mid-height, unclipped.
    """

    room: Room
    camera: Camera
    pose: Pose
    depth: np.ndarray
    floor: np.ndarray
    ids: np.ndarray
    points: np.ndarray
    span: tuple[float, float]
    rays: np.ndarray = field(repr=False)

    @property
    def clipped(self) -> tuple[float, float]:
        left, right = (float(np.clip(c, -0.5, self.camera.width - 0.5)) for c in self.span)
        return left, right

    def perception(self, n: int = 64, **changes: object) -> Perception:
        votes = columns_from_spans([self.clipped], self.camera.width, n)
        truth = Perception(
            p_open=1.0,
            columns=votes,
            depth_m=self.depth.astype(np.float32),
            floor=self.floor.astype(np.float32),
        )
        return replace(truth, **changes)

    def frame(self) -> Frame:
        image = np.zeros((self.camera.height, self.camera.width, 3), np.uint8)
        return Frame(image, self.camera, self.pose)

    def middle_bearing(self) -> float:
        """Bearing about the turning axis of what stands in the doorway at its middle column."""
        c, row = sum(self.clipped) / 2, (self.camera.height - 1) / 2
        ray = pixel_rays(self.camera, self.pose, np.array([c]), np.array([row]))[0]
        start = np.array([self.pose.forward_m, self.pose.left_m])
        normal = self.room.ahead
        t = (self.room.distance * normal[0] - start @ normal) / (ray[:2] @ normal)
        x, y = start + t * ray[:2]
        return math.degrees(math.atan2(y, x))


def pixel_rays(camera: Camera, pose: Pose, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """World rays (..., 3) with unit step along the optical axis; undistorted cameras only."""
    assert not any(camera.distortion)
    yaw, pitch, roll = (math.radians(a) for a in (pose.yaw_deg, pose.pitch_deg, pose.roll_deg))
    forward = np.array(
        [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    flat_right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    flat_up = np.cross(flat_right, forward)
    right = flat_right * math.cos(roll) - flat_up * math.sin(roll)
    up = flat_up * math.cos(roll) + flat_right * math.sin(roll)
    u, v = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy
    return forward + u[..., None] * right - v[..., None] * up


def _hit(box: Box, start: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Distance along each ray to a box, inf where it misses (slab method)."""
    a = math.radians(box.turn_deg)
    turn = np.array([[math.cos(a), math.sin(a), 0], [-math.sin(a), math.cos(a), 0], [0, 0, 1]])
    centre = np.array([box.x, box.y, (box.z0 + box.z1) / 2])
    half = np.array([box.size[0], box.size[1], box.z1 - box.z0]) / 2
    o, d = turn @ (start - centre), rays @ turn.T
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (-half - o) / d, (half - o) / d
    enter = np.minimum(one, two).max(axis=-1)
    leave = np.maximum(one, two).min(axis=-1)
    return np.where((enter <= leave) & (leave > 0) & (enter > 0), enter, np.inf)


def render(room: Room, camera: Camera, pose: Pose, size: tuple[int, int] | None = None) -> View:
    """The room as depth, floor and truth; `size` (h, w) of the maps, the camera's by default."""
    height, width = size or (camera.height, camera.width)
    sx, sy = camera.width / width, camera.height / height
    x, y = np.meshgrid((np.arange(width) + 0.5) * sx - 0.5, (np.arange(height) + 0.5) * sy - 0.5)
    rays = pixel_rays(camera, pose, x, y)
    start = np.array([pose.forward_m, pose.left_m, pose.height_m])

    solids = room.solids()
    hits = np.stack([_hit(box, start, rays) for box in solids])
    nearest, depth = hits.argmin(axis=0), hits.min(axis=0)
    first_box = len(solids) - len(room.boxes)
    ids = np.where(nearest >= first_box, nearest - first_box, -1)

    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(rays[..., 2] < 0, -start[2] / rays[..., 2], np.inf)
        if room.step is not None:
            edge, drop = room.step
            gone = (start[0] + ground * rays[..., 0]) > edge
            lower = np.where(rays[..., 2] < 0, -(start[2] + drop) / rays[..., 2], np.inf)
            riser = (edge - start[0]) / rays[..., 0]
            ground = np.where(gone, lower, ground)
            del riser  # the riser faces away from the robot and is never seen
    floor = ground < depth
    depth = np.minimum(depth, ground)
    ids = np.where(floor, -1, ids)
    depth = np.where(np.isfinite(depth), depth, np.nan)
    points = start + depth[..., None] * rays
    return View(room, camera, pose, depth, floor, ids, points, _span(room, camera, pose), rays)


def _span(room: Room, camera: Camera, pose: Pose) -> tuple[float, float]:
    """Columns at mid-height where the free opening begins and ends, beyond the picture too."""
    columns = np.linspace(-2.0 * camera.width, 3.0 * camera.width, 20001)
    rays = pixel_rays(camera, pose, columns, np.full_like(columns, (camera.height - 1) / 2))
    start = np.array([pose.forward_m, pose.left_m])
    axis = np.array([math.cos(math.radians(pose.yaw_deg)), math.sin(math.radians(pose.yaw_deg))])

    def column(corner: np.ndarray) -> float:
        ahead, aside = rays[:, :2] @ axis, rays[:, 0] * -axis[1] + rays[:, 1] * axis[0]
        way = corner - start
        slope = (way[1] * axis[0] - way[0] * axis[1]) / (way @ axis)
        return float(np.interp(-slope, -aside / ahead, columns))

    corners = [
        [
            room.middle + side * room.width / 2 * room.along + back * room.ahead
            for back in (0.0, room.thickness)
        ]
        for side in (1, -1)
    ]
    return max(column(c) for c in corners[0]), min(column(c) for c in corners[1])
