"""NAOqi's image container, colour spaces and transforms, as values of ours.

The container has 12 fields: width, height, layers, colour space, seconds, microseconds, the
pixels, camera, and the field of view's left, top, right and bottom angle in radians.
http://doc.aldebaran.com/2-8/naoqi/vision/alvideodevice-api.html
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import UserError

RESOLUTIONS = {"qqvga": 0, "qvga": 1, "vga": 2, "4vga": 3}
COLOURS = {"rgb": 11, "bgr": 13, "yuv422": 9, "grey": 0}
BYTES = {11: 3, 13: 3, 9: 2, 0: 1}
FRAME_ROBOT = 2
FIELDS = 12
ROTATION = 0.01
"""By which a transform's rotation may fail to be one."""


def numbers(what: str, values: Any, size: int) -> list[float]:
    """`size` finite numbers of a robot's answer; UserError for anything else."""
    if not isinstance(values, list | tuple):
        got = "nothing" if values is None else type(values).__name__
        raise UserError(f"{what}: expected {size} numbers, got {got}")
    if len(values) != size:
        raise UserError(f"{what}: expected {size} numbers, got {len(values)}")
    for value in values:
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise UserError(f"{what}: expected {size} numbers, got {value!r} among them")
    return [float(v) for v in values]


def fields_of(container: Any) -> Sequence[Any]:
    """The image container's fields; UserError if it is none."""
    if container is None:
        raise UserError("the robot answers null instead of an image")
    if not isinstance(container, list | tuple) or len(container) < FIELDS:
        size = len(container) if isinstance(container, list | tuple) else type(container).__name__
        raise UserError(f"expected an image container of {FIELDS} fields, got {size}")
    numbers("an image's size, colour space and stamp", container[:6], 6)
    return container


def to_rgb(fields: Sequence[Any]) -> NDArray[np.uint8]:
    """(H, W, 3) RGB of a container; UserError if its pixels are not what its fields say."""
    width, height, colour = int(fields[0]), int(fields[1]), int(fields[3])
    if colour not in BYTES:
        known = ", ".join(f"{name} ({number})" for name, number in COLOURS.items())
        raise UserError(f"expected an image in {known}, got colour space {colour}")
    if not isinstance(fields[6], bytes | bytearray | memoryview):
        raise UserError(f"expected an image's bytes, got {type(fields[6]).__name__}")
    pixels = np.frombuffer(fields[6], np.uint8)
    wanted = width * height * BYTES[colour]
    if wanted <= 0 or pixels.size != wanted:
        raise UserError(f"expected {wanted} bytes for a {width}x{height} image, got {pixels.size}")
    shaped = pixels.reshape(height, width, BYTES[colour])
    if colour == COLOURS["rgb"]:
        return shaped.copy()
    code = {
        COLOURS["bgr"]: cv2.COLOR_BGR2RGB,
        COLOURS["yuv422"]: cv2.COLOR_YUV2RGB_YUY2,
        COLOURS["grey"]: cv2.COLOR_GRAY2RGB,
    }[colour]
    return np.asarray(cv2.cvtColor(shaped, code), np.uint8)


def camera_of(fields: Sequence[Any]) -> Camera | None:
    """Intrinsics by the container's own angles, None if they make no sense."""
    try:
        left, top, right, bottom = numbers("field of view", fields[8:12], 4)
    except UserError:
        return None
    across, down = math.tan(left) - math.tan(right), math.tan(top) - math.tan(bottom)
    if not all(0.05 < abs(v) < 1.4 for v in (left, top, right, bottom)):
        return None
    if across <= 0 or down <= 0:
        return None
    width, height = int(fields[0]), int(fields[1])
    fx, fy = width / across, height / down
    return Camera(
        "NAOqi", width, height, fx, fy, fx * math.tan(left) - 0.5, fy * math.tan(top) - 0.5
    )


def pose_of(transform: Any) -> Pose:
    """The pose of a camera from its 4x4 transform in FRAME_ROBOT, row by row.

    Raises UserError for what is none.
    """
    m = np.asarray(numbers("a camera's transform", transform, 16)).reshape(4, 4)
    if not np.allclose(m[:3, :3] @ m[:3, :3].T, np.eye(3), atol=ROTATION):
        raise UserError("a camera's transform: expected a rotation, got numbers that are none")
    return Pose.from_transform(m)
