"""The camera options that several commands share, and what they mean for one picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from doorway3ds.errors import CallError, UserError

if TYPE_CHECKING:
    from doorway3ds.camera.model import Camera, Pose


@dataclass(frozen=True)
class CameraOptions:
    """--camera, --fov-deg, --height-m, --pitch-deg, --roll-deg as they were given."""

    camera: str | None = None
    fov_deg: float | None = None
    height_m: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None

    def resolve(self) -> CameraChoice:
        """Checks the options and reads the camera file, if there is one.

        Raises CallError for options that contradict each other, are out of range, or name no
        camera.
        """
        from doorway3ds.camera.info import read_camera_info
        from doorway3ds.camera.model import Pose
        from doorway3ds.camera.presets import PRESETS

        require_range("--fov-deg", self.fov_deg, 1, 179)
        require_range("--height-m", self.height_m, 0.01, 10)
        require_range("--pitch-deg", self.pitch_deg, -90, 90)
        require_range("--roll-deg", self.roll_deg, -180, 180)
        if self.camera is not None and self.fov_deg is not None:
            raise CallError("--camera and --fov-deg both say the field of view; give one of them")
        pose, file = Pose(), None
        if self.camera in PRESETS:
            pose = PRESETS[self.camera][1]
        elif self.camera is not None:
            if not Path(self.camera).is_file():
                raise CallError(
                    f"--camera {self.camera} is neither a preset ({', '.join(sorted(PRESETS))}) "
                    f"nor a camera_info file"
                )
            try:
                file = read_camera_info(self.camera)
            except UserError as error:
                raise CallError(str(error)) from error
        given = {
            name: value
            for name in ("height_m", "pitch_deg", "roll_deg")
            if (value := getattr(self, name)) is not None
        }
        return CameraChoice(self.camera, file, self.fov_deg, replace(pose, **given))


@dataclass(frozen=True)
class CameraChoice:
    """A camera that is still to be fitted to each picture's size."""

    preset: str | None
    file: Camera | None
    fov_deg: float | None
    pose: Pose

    def fit(self, width: int, height: int, focal_35mm: float | None) -> Camera:
        """The camera for a picture; UserError where it has another aspect."""
        from doorway3ds.camera.choice import default_camera
        from doorway3ds.camera.model import Camera
        from doorway3ds.camera.presets import preset

        if self.file is not None:
            return self.file.scaled_to(width, height)
        if self.preset is not None:
            return preset(self.preset, width, height)[0]
        if self.fov_deg is not None:
            return Camera.from_fov(width, height, self.fov_deg, name=f"fov {self.fov_deg:g} deg")
        return default_camera(width, height, focal_35mm)


def require_range(option: str, value: float | None, low: float, high: float) -> None:
    """CallError where a value is given and not between low and high (so nan is refused, too)."""
    if value is not None and not (math.isfinite(value) and low <= value <= high):
        raise CallError(f"{option} must be a number from {low:g} to {high:g}, got {value:g}")
