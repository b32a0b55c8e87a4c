"""Cameras: intrinsics, distortion, pose on the robot, and pixel <-> ray <-> bearing.

Pixels count from the centre of the top-left pixel. The camera frame is x right, y down,
z forward; the robot frame is x forward, y left, z up, with its origin on the floor under the
turning axis. Bearings are + left, elevations and camera pitch + up, all in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from doorway3ds.arguments import require, require_number
from doorway3ds.camera.lens import MODELS, Lens
from doorway3ds.errors import CallError, UserError

Array = NDArray[np.float64]

_FOV_DEG = (0.01, 179.99)

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Takes vectors of a camera's frame into its body's: x forward, y left, z up."""


@dataclass(frozen=True)
class Camera:
    """Intrinsics and lens distortion of a camera, for one image size.

    >>> camera = Camera.from_fov(640, 480, hfov_deg=60.9)
    >>> round(camera.fx, 1), camera.scaled_to(320, 240).width
    (544.3, 320)

    fx, fy, cx, cy: pixels. distortion: as many coefficients as `lens.MODELS` says of
    `distortion_model`, in OpenCV's order; the last of plumb_bob may be left out.
    assumed: nobody gave this camera; it was guessed from EXIF or a default.

    Raises UserError for values that describe no camera.
    """

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    assumed: bool = False
    distortion_model: str = "plumb_bob"

    def __post_init__(self) -> None:
        require("name", self.name, str, "text")
        for name in ("width", "height"):
            require_number(name, getattr(self, name), 1, whole=True)
        if self.distortion_model not in list(MODELS):
            raise CallError(
                f"distortion_model must be one of {', '.join(MODELS)}, "
                f"got {self.distortion_model!r}"
            )
        for name in ("fx", "fy", "cx", "cy"):
            require_number(name, getattr(self, name))
        if self.fx <= 0 or self.fy <= 0:
            raise CallError(f"focal lengths must be positive, got fx={self.fx}, fy={self.fy}")
        count = MODELS[self.distortion_model]
        require("distortion", self.distortion, Iterable, "a sequence of coefficients")
        for value in self.distortion:
            require_number("distortion", value)
        coefficients = tuple(float(v) for v in self.distortion)
        if self.distortion_model == "plumb_bob" and len(coefficients) in (0, 4):
            coefficients += (0.0,) * (count - len(coefficients))
        object.__setattr__(self, "distortion", coefficients)
        if len(coefficients) != count:
            raise CallError(
                f"distortion must have the {count} coefficients of {self.distortion_model}, got "
                f"{len(coefficients)}"
            )

    @classmethod
    def from_fov(
        cls,
        width: int,
        height: int,
        hfov_deg: float,
        vfov_deg: float | None = None,
        name: str = "field of view",
        assumed: bool = False,
    ) -> Camera:
        """A centred camera without distortion; square pixels unless `vfov_deg` is given."""
        require_number("hfov_deg", hfov_deg, *_FOV_DEG)
        require_number("vfov_deg", vfov_deg, *_FOV_DEG, optional=True)
        require_number("width", width, 1, whole=True)
        require_number("height", height, 1, whole=True)
        fx = width / 2 / math.tan(math.radians(hfov_deg) / 2)
        fy = fx if vfov_deg is None else height / 2 / math.tan(math.radians(vfov_deg) / 2)
        return cls(name, width, height, fx, fy, (width - 1) / 2, (height - 1) / 2, assumed=assumed)

    @property
    def hfov_deg(self) -> float:
        """Horizontal angle between the image's left and right edge through (cx, cy)."""
        rays = pixel_to_ray(self, [(-0.5, self.cy), (self.width - 0.5, self.cy)])
        left, right = np.degrees(np.arctan(rays[:, 0]))
        return float(right - left)

    @property
    def vfov_deg(self) -> float:
        """Vertical angle between the image's upper and lower edge through (cx, cy)."""
        rays = pixel_to_ray(self, [(self.cx, -0.5), (self.cx, self.height - 0.5)])
        top, bottom = np.degrees(np.arctan(rays[:, 1]))
        return float(bottom - top)

    def scaled_to(self, width: int, height: int) -> Camera:
        """The same camera for its image resized to another size of the same aspect.

        Raises UserError if the aspects differ by more than the rounding of one side.
        """
        require_number("width", width, 1, whole=True)
        require_number("height", height, 1, whole=True)
        off_width = abs(width - self.width * height / self.height)
        off_height = abs(height - self.height * width / self.width)
        if min(off_width, off_height) >= 1:
            raise UserError(
                f"camera '{self.name}' is for {self.width}x{self.height} images and the image "
                f"is {width}x{height}, another aspect; give a camera calibrated at this aspect"
            )
        return self.stretched_to(width, height)

    def stretched_to(self, width: int, height: int) -> Camera:
        """The same camera for its image resized to any size, each axis by its own factor."""
        if (width, height) == (self.width, self.height):
            return self
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )

    def mirrored(self) -> Camera:
        """The camera whose image is this one's, flipped left to right."""
        return self._flipped(sideways=True)

    def turned(self, orientation: int) -> Camera:
        """The camera of the upright image, this one being that of the image as stored.

        orientation: EXIF 1 to 8 (TIFF 6.0, tag 274); see `images.codec`.
        """
        require_number("orientation", orientation, 1, 8, whole=True)
        camera = self._transposed() if orientation in (5, 6, 7, 8) else self
        if orientation in (3, 4, 7, 8):
            camera = camera._flipped(sideways=False)
        return camera._flipped(sideways=True) if orientation in (2, 3, 6, 7) else camera

    @cached_property
    def lens(self) -> Lens:
        """The distortion, up to the corners of this camera's image."""
        x = max(self.cx + 0.5, self.width - 0.5 - self.cx) / self.fx
        y = max(self.cy + 0.5, self.height - 0.5 - self.cy) / self.fy
        return Lens(self.distortion_model, self.distortion, math.hypot(x, y))

    @property
    def untrusted(self) -> float:
        """Share of the image, 0 to 1, where the distortion cannot be undone and is continued."""
        if math.isinf(self.lens.trusted):
            return 0.0
        x = (np.linspace(0, self.width - 1, 129) - self.cx) / self.fx
        y = (np.linspace(0, self.height - 1, 97) - self.cy) / self.fy
        return float(np.mean(np.hypot(x, y[:, None]) > self.lens.trusted))

    def _tangential(self, p1: float, p2: float) -> tuple[float, ...]:
        """The coefficients with others for p1 and p2, which equidistant lenses have not."""
        k1, k2, _, _, *others = self.distortion
        return (k1, k2, p1, p2, *others)

    def _flipped(self, sideways: bool) -> Camera:
        changed: dict[str, Any] = (
            {"cx": self.width - 1 - self.cx} if sideways else {"cy": self.height - 1 - self.cy}
        )
        if self.distortion_model != "equidistant":
            p1, p2 = self.distortion[2:4]
            changed["distortion"] = self._tangential(*((p1, -p2) if sideways else (-p1, p2)))
        return replace(self, **changed)

    def _transposed(self) -> Camera:
        distortion = self.distortion
        if self.distortion_model != "equidistant":
            distortion = self._tangential(distortion[3], distortion[2])
        return replace(
            self,
            width=self.height,
            height=self.width,
            fx=self.fy,
            fy=self.fx,
            cx=self.cy,
            cy=self.cx,
            distortion=distortion,
        )


@dataclass(frozen=True)
class Pose:
    """Where the camera sits on the robot.

    >>> Pose(height_m=0.9, pitch_deg=-4).pitch_deg  # 4 degrees down
    -4

    height_m: of the lens above the floor, None = unknown (hand-held).
    pitch_deg: + up. yaw_deg: + left. roll_deg: + right side down.
    forward_m, left_m: of the lens from the turning axis.

    Raises UserError for what is no finite number.
    """

    height_m: float | None = None
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    roll_deg: float = 0.0
    forward_m: float = 0.0
    left_m: float = 0.0

    def __post_init__(self) -> None:
        require_number("height_m", self.height_m, optional=True)
        for name in ("pitch_deg", "yaw_deg", "roll_deg", "forward_m", "left_m"):
            require_number(name, getattr(self, name))

    @classmethod
    def from_transform(cls, transform: Array) -> Pose:
        """By the (4, 4) from the camera's body frame into the robot's frame.

        Both are x forward, y left, z up. A lens not above the robot's origin has no known height.
        """
        forward, left, up = (float(v) for v in transform[:3, 3])
        return cls(
            height_m=up if up > 0 else None,
            pitch_deg=math.degrees(math.asin(min(1.0, max(-1.0, transform[2, 0])))),
            yaw_deg=math.degrees(math.atan2(transform[1, 0], transform[0, 0])),
            roll_deg=math.degrees(math.atan2(transform[2, 1], transform[2, 2])),
            forward_m=forward,
            left_m=left,
        )

    def mirrored(self) -> Pose:
        """The pose that goes with an image flipped left to right."""
        return replace(self, yaw_deg=-self.yaw_deg, roll_deg=-self.roll_deg, left_m=-self.left_m)


def pixel_to_ray(camera: Camera, xy: ArrayLike) -> Array:
    """Camera-frame rays with z = 1 through pixels `xy` (..., 2), as (..., 3)."""
    xy = np.asarray(xy, dtype=np.float64)
    xd = (xy[..., 0] - camera.cx) / camera.fx
    yd = (xy[..., 1] - camera.cy) / camera.fy
    x, y = camera.lens.undistort(xd, yd)
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def ray_to_pixel(camera: Camera, rays: ArrayLike) -> Array:
    """Pixels (..., 2) where camera-frame rays (..., 3) fall; nan behind the camera."""
    rays = np.asarray(rays, dtype=np.float64)
    z = np.where(rays[..., 2] > 0, rays[..., 2], np.nan)
    x, y = rays[..., 0] / z, rays[..., 1] / z
    x, y = camera.lens.distort(x, y)
    return np.stack([x * camera.fx + camera.cx, y * camera.fy + camera.cy], axis=-1)


@lru_cache(maxsize=8)
def rotation(pose: Pose) -> Array:
    """(3, 3) matrix that takes camera-frame vectors into the robot frame, cached and read-only."""
    yaw, pitch, roll = np.radians([pose.yaw_deg, pose.pitch_deg, pose.roll_deg])
    cy, sy = np.cos(yaw), np.sin(yaw)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    turn = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    nod = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])  # + up: REP-103's turn about y, negated
    tilt = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    matrix = np.asarray(turn @ nod @ tilt @ OPTICAL, dtype=np.float64)
    matrix.flags.writeable = False
    return matrix


def bearing_elevation(vectors_robot: ArrayLike) -> tuple[Array, Array]:
    """Bearing (+ left) and elevation (+ up) in degrees of robot-frame vectors (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(vectors_robot, dtype=np.float64), -1, 0)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def bearing_of_pixel(
    camera: Camera, pose: Pose, xy: ArrayLike, range_m: ArrayLike | None = None
) -> Array:
    """Bearing in degrees about the turning axis of what pixels `xy` (..., 2) show.

    range_m: horizontal distance from the turning axis to what is seen. Without it (None, nan,
    or nearer than the ray ever comes) it counts as far away: the ray's own direction.
    """
    direction = pixel_to_ray(camera, xy) @ rotation(pose).T
    bearing = bearing_elevation(direction)[0]
    if range_m is None or (pose.forward_m == 0 and pose.left_m == 0):
        return bearing
    offset = np.array([pose.forward_m, pose.left_m])
    flat = direction[..., :2] / np.linalg.norm(direction[..., :2], axis=-1, keepdims=True)
    along = flat @ offset
    square = along**2 - offset @ offset + np.asarray(range_m, dtype=np.float64) ** 2
    reach = -along + np.sqrt(np.where(square > 0, square, np.nan))
    point = offset + reach[..., None] * flat
    seen = np.degrees(np.arctan2(point[..., 1], point[..., 0]))
    return np.where(reach > 0, seen, bearing)


def wrapped_deg(angle_deg: float) -> float:
    """The same direction as an angle from -180 up to 180 degrees."""
    return (angle_deg + 180) % 360 - 180


@lru_cache(maxsize=8)
def grid_rays(camera: Camera, step: int = 1) -> Array:
    """(h, w, 3) camera-frame rays of every `step`-th row and column, the last row included.

    Cached and read-only, as a robot's camera stays the same from image to image.
    """
    rows, columns = grid_pixels(camera.width, camera.height, step)
    x, y = np.meshgrid(columns, rows)
    rays = pixel_to_ray(camera, np.stack([x, y], -1))
    rays.flags.writeable = False
    return rays


def grid_pixels(width: int, height: int, step: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of a thinned pixel grid that keeps the last row, where the floor is near."""
    return np.arange((height - 1) % step, height, step), np.arange(step // 2, width, step)


def back_project(camera: Camera, pose: Pose, depth: ArrayLike) -> Array:
    """Points (h, w, 3) in the robot frame from depth (h, w) in metres along the optical axis.

    The map covers the camera's whole image at any size. Where the pose's height is unknown, z
    counts from the lens instead of the floor. nan stays nan.
    """
    depth = np.asarray(depth, dtype=np.float64)
    height, width = depth.shape
    rays = grid_rays(camera.stretched_to(width, height))
    lens = np.array([pose.forward_m, pose.left_m, pose.height_m or 0.0])
    return np.asarray((rays * depth[..., None]) @ rotation(pose).T + lens)
