"""Which camera took an image: by preset, file, field of view, EXIF, or assumption."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from doorway3ds.camera.info import read_camera_info
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.camera.options import LensOptions
from doorway3ds.camera.presets import PRESETS
from doorway3ds.errors import CallError, UserError

ASSUMED_FOV_DEG = 60.9
"""Field of view across the longer side of an image whose camera is unknown (NAO's)."""

_POSED = ("height_m", "pitch_deg", "roll_deg")


@dataclass(frozen=True)
class CameraChoice:
    """A camera that is still to be fitted to each image, and where it sits.

    camera: a preset's or a file's, to be scaled; fov_deg: instead of it. Without either, EXIF or
        the assumed field of view answers.
    pose: that goes with the camera, unless a robot measured one. posed: fields of the pose that
        the user gave by themselves; they outrank both.
    """

    camera: Camera | None = None
    fov_deg: float | None = None
    pose: Pose = field(default_factory=Pose)
    posed: Mapping[str, float] = field(default_factory=dict)

    @property
    def given(self) -> bool:
        """Whether the user named a camera or a field of view."""
        return self.camera is not None or self.fov_deg is not None

    def fit(self, width: int, height: int, focal_35mm: float | None = None) -> Camera:
        """The camera for an image of this size; UserError if it has another aspect."""
        if self.camera is not None:
            return self.camera.scaled_to(width, height)
        if self.fov_deg is not None:
            return Camera.from_fov(width, height, self.fov_deg, name=f"fov {self.fov_deg:g} deg")
        return default_camera(width, height, focal_35mm)

    def pose_of(self, measured: Pose | None = None) -> Pose:
        """The camera's pose; measured: by the robot itself, for this image."""
        return replace(measured or self.pose, **self.posed)


def choose_camera(options: LensOptions) -> CameraChoice:
    """The camera that options name.

    Raises CallError for a name that is neither a preset nor a usable file.
    """
    given = {name: value for name in _POSED if (value := getattr(options, name, None)) is not None}
    choice = CameraChoice(fov_deg=options.fov_deg, posed=given)
    name = options.camera
    if name is None:
        return choice
    if name in PRESETS:
        camera, pose = PRESETS[name]
        return replace(choice, camera=camera, pose=pose)
    if not Path(name).is_file():
        raise CallError(
            f"--camera {name} is neither a preset ({', '.join(sorted(PRESETS))}) "
            f"nor a camera_info file"
        )
    try:
        return replace(choice, camera=read_camera_info(name))
    except UserError as error:
        raise CallError(str(error)) from error


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
    """A guess for an image whose camera is unknown; its name says where it comes from.

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
