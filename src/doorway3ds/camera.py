"""Camera intrinsics and pose (skeleton: the geometry helper owns and completes this file)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a pinhole camera with OpenCV plumb_bob distortion, for one picture size."""

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    assumed: bool = False


@dataclass(frozen=True)
class Pose:
    """Where the camera sits on the robot; height None = unknown (hand-held)."""

    height_m: float | None = None
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    roll_deg: float = 0.0
    forward_m: float = 0.0
    left_m: float = 0.0
