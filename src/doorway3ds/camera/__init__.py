"""Cameras: intrinsics, lens distortion, pose on the robot, and pixel <-> ray <-> bearing."""

from doorway3ds.camera.info import read_camera_info, write_camera_info
from doorway3ds.camera.model import (
    Camera,
    Pose,
    back_project,
    bearing_elevation,
    bearing_of_pixel,
    pixel_to_ray,
    ray_to_pixel,
    rotation,
)

__all__ = [
    "Camera",
    "Pose",
    "back_project",
    "bearing_elevation",
    "bearing_of_pixel",
    "pixel_to_ray",
    "ray_to_pixel",
    "read_camera_info",
    "rotation",
    "write_camera_info",
]
