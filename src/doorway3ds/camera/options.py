"""What a user may say of a camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from doorway3ds.errors import CallError
from doorway3ds.options import Options, setting


@dataclass(frozen=True)
class LensOptions(Options):
    """Which camera took the images."""

    panel: ClassVar[str] = "Camera"

    camera: str | None = setting(
        None,
        "nao-v5-top, nao-v6-top, pepper-top, or a ROS camera_info YAML file.",
        metavar="PRESET|FILE",
    )
    fov_deg: float | None = setting(
        None, "Horizontal field of view, instead of a camera.", low=1, high=179
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.camera is not None and self.fov_deg is not None:
            raise CallError("--camera and --fov-deg both set the field of view; give one of them")


@dataclass(frozen=True)
class CameraOptions(LensOptions):
    """Which camera took the images, and where it sits on the robot."""

    height_m: float | None = setting(None, "Height of the lens above the floor.", low=0.01, high=10)
    pitch_deg: float | None = setting(None, "Pitch of the camera, + up.", low=-90, high=90)
    roll_deg: float | None = setting(
        None, "Roll of the camera, + right side down.", low=-180, high=180
    )
