"""ROS `camera_info` files: intrinsics and distortion of one camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError


def read_camera_info(path: str | Path) -> Camera:
    """Read a ROS `camera_info` YAML; rectification and projection matrices are not needed.

    Raises UserError where the file is missing, damaged or of another distortion model.
    """
    import yaml

    def wrong(what: str) -> UserError:
        return UserError(f"{path} is no usable camera_info file: {what}")

    try:
        info = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"cannot read the camera file {path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise wrong("it is not YAML text") from error
    if not isinstance(info, dict):
        raise wrong("expected image_width, image_height, camera_matrix and more by name")
    model = info.get("distortion_model", "plumb_bob")
    if model != "plumb_bob":
        raise wrong(f"distortion_model must be plumb_bob, got {model!r}")
    try:
        width, height = int(info["image_width"]), int(info["image_height"])
        matrix = [float(v) for v in info["camera_matrix"]["data"]]
        coefficients = [float(v) for v in info["distortion_coefficients"]["data"]]
    except KeyError as error:
        raise wrong(f"{error.args[0]} is missing") from error
    except (TypeError, ValueError) as error:
        raise wrong(f"expected numbers ({error})") from error
    if len(matrix) != 9:
        raise wrong(f"camera_matrix has 9 numbers, got {len(matrix)}")
    if len(coefficients) not in (0, 4, 5):
        raise wrong(f"plumb_bob has 4 or 5 coefficients, got {len(coefficients)}")
    k1, k2, p1, p2, k3 = (*coefficients, *[0.0] * (5 - len(coefficients)))
    name = str(info.get("camera_name") or Path(path).stem)
    try:
        return Camera(
            name, width, height, matrix[0], matrix[4], matrix[2], matrix[5], (k1, k2, p1, p2, k3)
        )
    except ValueError as error:
        raise wrong(str(error)) from error


def write_camera_info(camera: Camera, path: str | Path) -> None:
    """Write a ROS `camera_info` YAML that `read_camera_info` and ROS's camera drivers read."""
    import yaml

    def matrix(rows: int, data: list[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": len(data) // rows, "data": [float(v) for v in data]}

    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    info = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": camera.name,
        "camera_matrix": matrix(3, [fx, 0, cx, 0, fy, cy, 0, 0, 1]),
        "distortion_model": "plumb_bob",
        "distortion_coefficients": matrix(1, list(camera.distortion)),
        "rectification_matrix": matrix(3, [1, 0, 0, 0, 1, 0, 0, 0, 1]),
        "projection_matrix": matrix(3, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]),
    }
    text = yaml.safe_dump(info, sort_keys=False, default_flow_style=None)
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write the camera file {path}: {error.strerror}") from error
