"""From ROS messages to images, cameras and poses.

Messages are read by their fields alone, so those of rclpy, of `rosbags` and of ROS 1 all serve.
Frames are those of REP 103 and 105: a camera's frame is its optical one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.info import check_lens, distortion
from doorway3ds.camera.model import OPTICAL, Array, Camera, Pose
from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image

_Decode = Callable[[NDArray[np.uint8]], Any]

# Encoding -> channels of 8 bits, and how they become RGB.
_EIGHT_BIT: dict[str, tuple[int, _Decode]] = {
    "rgb8": (3, lambda raw: raw),
    "8UC3": (3, lambda raw: cv2.cvtColor(raw, cv2.COLOR_BGR2RGB)),
    "bgr8": (3, lambda raw: cv2.cvtColor(raw, cv2.COLOR_BGR2RGB)),
    "rgba8": (4, lambda raw: raw[..., :3]),
    "bgra8": (4, lambda raw: cv2.cvtColor(raw, cv2.COLOR_BGRA2RGB)),
    "8UC4": (4, lambda raw: cv2.cvtColor(raw, cv2.COLOR_BGRA2RGB)),
    "mono8": (1, lambda raw: cv2.cvtColor(raw, cv2.COLOR_GRAY2RGB)),
    "8UC1": (1, lambda raw: cv2.cvtColor(raw, cv2.COLOR_GRAY2RGB)),
    "yuv422": (2, lambda raw: cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_UYVY)),
    "uyvy": (2, lambda raw: cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_UYVY)),
    "yuv422_yuy2": (2, lambda raw: cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_YUY2)),
    "yuyv": (2, lambda raw: cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_YUY2)),
}
_SIXTEEN_BIT = ("mono16", "16UC1")
ENCODINGS = (*_EIGHT_BIT, *_SIXTEEN_BIT)


def image_of(message: Any, name: str = "image") -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of a sensor_msgs/Image or CompressedImage.

    16 bits of grey become the upper 8. Rows may be longer than their pixels (`step`).

    Raises UserError, its line beginning with `name`: another encoding, too little data, damage.
    """
    if hasattr(message, "format"):
        if "compressedDepth" in message.format:
            raise UserError(f"{name} holds depth; expected a colour or grey image")
        return read_image(bytes(message.data), name=name).image
    encoding = message.encoding
    if encoding not in ENCODINGS:
        raise UserError(f"{name} has encoding {encoding!r}; expected {', '.join(ENCODINGS)}")
    sixteen = encoding in _SIXTEEN_BIT
    channels, decode = (2, None) if sixteen else _EIGHT_BIT[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1 or step < width * channels:
        raise UserError(
            f"{name} is {width}x{height} with rows of {step} bytes; expected at least one pixel "
            f"and rows of {width * channels} bytes or more"
        )
    data = np.frombuffer(message.data, np.uint8)
    needed = step * (height - 1) + width * channels  # the last row may end with its pixels
    if data.size < needed:
        raise UserError(f"{name} holds {data.size} bytes; expected {needed} or more")
    rows = np.lib.stride_tricks.as_strided(data, (height, width * channels), (step, 1))
    raw = np.ascontiguousarray(rows).reshape(height, width, channels)
    if sixteen:
        raw = raw[..., :1] if message.is_bigendian else raw[..., 1:]
        return np.repeat(raw, 3, axis=2)
    if channels == 2 and width % 2:
        raise UserError(f"{name} is {width} pixels wide; expected an even width with {encoding}")
    assert decode is not None
    return np.ascontiguousarray(decode(raw))


def camera_of(message: Any, name: str = "camera_info", *, rectified: bool = False) -> Camera | None:
    """The camera of the images beside a sensor_msgs/CameraInfo; None if it is not calibrated.

    The intrinsic matrix is that of the full sensor; binning and the region of interest are
    taken off. rectified: the images are undistorted already, and P describes them, not K and D.

    Warns (LensWarning) if the distortion cannot be undone in some of the image.

    Raises UserError for another distortion model, or numbers that describe no camera.
    """
    k, d, p = (_field(message, letter) for letter in "kdp")
    if k[0] == 0:
        return None
    model: str | None = message.distortion_model
    fx, fy, cx, cy = k[0], k[4], k[2], k[5]
    if rectified and p[0] != 0:
        fx, fy, cx, cy, model, d = p[0], p[5], p[2], p[6], "plumb_bob", []
    roi = message.roi
    cut = roi.width > 0 and roi.height > 0
    left, top = (roi.x_offset, roi.y_offset) if cut else (0, 0)
    width, height = (roi.width, roi.height) if cut else (message.width, message.height)
    across, down = max(1, message.binning_x), max(1, message.binning_y)
    try:
        model, d = distortion(model, d)
        camera = Camera(
            name=name,
            width=int(width // across),
            height=int(height // down),
            fx=fx / across,
            fy=fy / down,
            cx=(cx - left + 0.5) / across - 0.5,
            cy=(cy - top + 0.5) / down - 0.5,
            distortion=tuple(d),
            distortion_model=model,
        )
    except ValueError as error:
        raise UserError(f"{name} describes no camera: {error}") from error
    check_lens(camera, name)
    return camera


class Calibration:
    """The camera of one topic, worked out again only if its `camera_info` changes."""

    def __init__(self, name: str, *, rectified: bool = False) -> None:
        self._name, self._rectified = name, rectified
        self._key: tuple[Any, ...] | None = None
        self._camera: Camera | None = None

    def camera(self, message: Any) -> Camera | None:
        """As `camera_of`."""
        roi = message.roi
        key = (
            message.width, message.height, message.distortion_model,
            *(tuple(_field(message, letter)) for letter in "kdp"),
            message.binning_x, message.binning_y,
            roi.x_offset, roi.y_offset, roi.width, roi.height,
        )  # fmt: skip
        if key != self._key:
            self._camera = camera_of(message, self._name, rectified=self._rectified)
            self._key = key
        return self._camera


def _field(message: Any, letter: str) -> list[float]:
    """A matrix by its name in ROS 2, or in ROS 1, which has capitals."""
    values = getattr(message, letter, None)
    return [float(v) for v in (getattr(message, letter.upper()) if values is None else values)]


def stamp_of(message: Any) -> float:
    """Seconds of the message's header; 0 where nobody set it."""
    stamp = message.header.stamp
    fraction = stamp.nanosec if hasattr(stamp, "nanosec") else stamp.nsec
    return int(stamp.sec) + int(fraction) * 1e-9


def heading_of(orientation: Any) -> float:
    """Heading in degrees, + left, of a geometry_msgs/Quaternion."""
    turn = matrix(orientation)
    return math.degrees(math.atan2(turn[1, 0], turn[0, 0]))


def matrix(q: Any) -> Array:
    """(3, 3) rotation of a geometry_msgs/Quaternion; ValueError if it has no direction."""
    values = np.array([q.x, q.y, q.z, q.w], np.float64)
    size = float(np.linalg.norm(values))
    if not math.isfinite(size) or size < 1e-6:
        raise ValueError(f"expected a quaternion of length 1, got {values.tolist()}")
    x, y, z, w = values / size
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def transform_of(transform: Any) -> Array:
    """(4, 4) of a geometry_msgs/Transform, from the child frame into the parent frame."""
    whole = np.eye(4)
    whole[:3, :3] = matrix(transform.rotation)
    moved = transform.translation
    whole[:3, 3] = moved.x, moved.y, moved.z
    return whole


def pose_of(transform: Array) -> Pose:
    """The camera's pose by the (4, 4) transform from its optical frame into the robot's frame.

    The robot's frame counts as on the floor, under the turning axis.
    """
    body = transform.copy()
    body[:3, :3] = transform[:3, :3] @ OPTICAL.T
    return Pose.from_transform(body)


ROBOT_FRAMES = ("base_footprint", "base_link")
"""Usual names of a robot's own frame, the one on the floor first (REP 105, REP 120)."""

_DEEPEST = 100


class Transforms:
    """The newest transform of every frame into its parent's."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Array]] = {}

    def add(self, message: Any) -> None:
        """Takes in a tf2_msgs/TFMessage; transforms that are no rotation are left out."""
        for one in message.transforms:
            try:
                transform = transform_of(one.transform)
            except ValueError:
                continue
            child, parent = bare(one.child_frame_id), bare(one.header.frame_id)
            self._parents[child] = (parent, transform)

    def lookup(self, target: str, source: str) -> Array | None:
        """(4, 4) from the source frame into the target frame; None if they are not connected."""
        up, down = self._to_root(bare(source)), self._to_root(bare(target))
        for frame, from_source in up.items():
            if frame in down:
                return np.asarray(np.linalg.inv(down[frame]) @ from_source)
        return None

    def pose(self, camera: str, robot: str | None = None) -> Pose | None:
        """The camera's pose on the robot; robot: its frame, default: the usual ones."""
        for frame in ROBOT_FRAMES if robot is None else (robot,):
            transform = self.lookup(frame, camera)
            if transform is not None:
                return pose_of(transform)
        return None

    def _to_root(self, frame: str) -> dict[str, Array]:
        """The frame and its ancestors, each with the transform from the frame into it."""
        found, transform = {frame: np.eye(4)}, np.eye(4)
        while frame in self._parents and len(found) < _DEEPEST:
            frame, step = self._parents[frame]
            transform = step @ transform
            found[frame] = transform
        return found


def bare(frame: str) -> str:
    """The frame's name as tf2 has it; those of ROS 1 may begin with a slash."""
    return frame.lstrip("/")
