"""The camera of an image about which little or nothing is known."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError

ASSUMED_FOV_DEG = 60.9
"""Field of view across the longer side of a picture whose camera is unknown (NAO's)."""


FitCamera = Callable[[int, int, "float | None"], Camera]
"""The camera for an image's width, height and EXIF focal length (35 mm) or None."""


def turned_camera(
    fit: FitCamera, width: int, height: int, focal_35mm: float | None, orientation: int
) -> Camera:
    """The camera of an upright image (width, height) that its EXIF orientation turned.

    A camera file is of the sensor, so it turns with the image: upside down it is turned, too;
    with sides swapped it is taken for the image as stored unless it is of the upright aspect.
    """
    if orientation < 5:
        return fit(width, height, focal_35mm).turned(orientation)
    if width != height:
        with contextlib.suppress(UserError):
            return fit(width, height, focal_35mm)
    return fit(height, width, focal_35mm).turned(orientation)


def default_camera(width: int, height: int, focal_35mm: float | None = None) -> Camera:
    """A guess for a picture whose camera is unknown; its name says where it comes from.

    focal_35mm: EXIF's 35 mm equivalent focal length, taken over the longer side of 36 mm.
    """
    longer = max(width, height)
    if focal_35mm is not None and math.isfinite(focal_35mm) and focal_35mm > 0:
        focal, name = longer * focal_35mm / 36, f"EXIF {focal_35mm:g} mm"
    else:
        focal = longer / 2 / math.tan(math.radians(ASSUMED_FOV_DEG) / 2)
        name = f"assumed {ASSUMED_FOV_DEG} deg"
    return Camera(
        name, width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, assumed=True
    )
