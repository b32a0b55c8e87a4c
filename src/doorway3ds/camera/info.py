"""ROS `camera_info` files: intrinsics and distortion of one camera."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

from doorway3ds.arguments import require
from doorway3ds.camera.formats import parse
from doorway3ds.camera.lens import MODELS, WIDEST_DEG
from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes

MOST_UNTRUSTED = 0.25
"""Share of the image in which the distortion may be a continuation, with a warning."""

_MOST_SKEW = 0.01  # of the focal length: more than a fit's noise
_SHORTEST = 0.1  # of the longer side: a field of view of 157 deg, of a lens without distortion
_BY_COUNT = {0: "plumb_bob", 5: "plumb_bob", 8: "rational_polynomial"}


class LensWarning(UserWarning):
    """Part of an image has bearings that its camera file does not know."""


def read_camera_info(path: str | os.PathLike[str]) -> Camera:
    """Reads a camera file: a ROS `camera_info` YAML or one of those that `camera.formats` knows.

    Rectification and projection matrices are not needed.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "front.yaml")
    >>> write_camera_info(Camera.from_fov(640, 480, 70, name="front"), path)
    >>> read_camera_info(path).name
    'front'

    Args:
        path: as ROS's camera_calibration or `3ds calibrate` writes it.

    Returns:
        The camera, for the image size in the file. Warns (LensWarning) if the distortion cannot be
        undone in some of the image.

    Raises:
        UserError: if the file is missing, damaged, of another distortion model, or of a lens that
            cannot be undone in over a quarter of the image.
    """

    require("path", path, (str, os.PathLike), "a path")

    def wrong(what: str) -> UserError:
        return UserError(f"{path} is not a usable camera_info file: {what}")

    try:
        info = parse(Path(path).read_bytes())
    except OSError as error:
        raise UserError(f"cannot read the camera file {path}: {error.strerror}") from error
    except ValueError as error:
        raise wrong(str(error)) from error
    except (KeyError, TypeError, IndexError) as error:
        raise wrong(f"a value is missing or of another kind ({error})") from error
    try:
        width, height = int(info["image_width"]), int(info["image_height"])
        matrix = [float(v) for v in info["camera_matrix"]["data"]]
        coefficients = [float(v) for v in info["distortion_coefficients"]["data"]]
    except KeyError as error:
        raise wrong(f"{error.args[0]} is missing") from error
    except (TypeError, ValueError) as error:
        raise wrong(f"expected numbers ({error})") from error
    try:
        check_matrix(matrix, width, height)
        model, coefficients = distortion(info.get("distortion_model"), coefficients)
        camera = Camera(
            name=str(info.get("camera_name") or Path(path).stem),
            width=width,
            height=height,
            fx=matrix[0],
            fy=matrix[4],
            cx=matrix[2],
            cy=matrix[5],
            distortion=tuple(coefficients),
            distortion_model=model,
        )
    except ValueError as error:
        raise wrong(str(error)) from error
    check_lens(camera, str(path))
    return camera


def check_matrix(matrix: list[float], width: int, height: int) -> None:
    """ValueError for what is no camera matrix, row by row and in pixels, of an image of this size.

    Transposed, normalised or of another size it would be read without complaint, and be wrong.
    """
    if len(matrix) != 9:
        raise ValueError(f"camera_matrix must have 9 numbers, got {len(matrix)}")
    if not any(matrix):
        raise ValueError("camera_matrix is all zero: the camera has not been calibrated")
    fx, skew, cx, _, fy, cy, *last = matrix
    if matrix[3] != 0 or last != [0, 0, 1] or abs(skew) > _MOST_SKEW * abs(fx):
        raise ValueError(f"camera_matrix must be fx 0 cx, 0 fy cy, 0 0 1, got {matrix}")
    if not (0 <= cx <= width and 0 <= cy <= height):
        raise ValueError(
            f"its principal point {cx:g}, {cy:g} lies outside its image of {width}x{height}; "
            "is it of another size?"
        )
    if 0 < min(fx, fy) < _SHORTEST * max(width, height):
        raise ValueError(
            f"its focal lengths {fx:g}, {fy:g} are too short for {width}x{height}; are they in "
            "pixels?"
        )


def distortion(model: str | None, coefficients: list[float]) -> tuple[str, list[float]]:
    """The distortion model's name and its own number of coefficients, from what a file holds.

    Raises ValueError for another model or number, or four coefficients of no named model: they are
    those of plumb_bob and of equidistant, and mean different things.
    """
    count = len(coefficients)
    if model is None or model == "":
        if count == 4:
            raise ValueError(
                "distortion_model is missing, and four coefficients may be of plumb_bob or of "
                "equidistant (fisheye); add the line that holds"
            )
        model = "rational_polynomial" if count > 8 else _BY_COUNT.get(count)
    if model not in MODELS:
        raise ValueError(
            f"distortion_model must be one of {', '.join(MODELS)}, got {model!r} with {count} "
            "coefficients"
        )
    wanted = MODELS[model]
    # Drivers pad with zeros: OpenCV knows 12 and 14 coefficients, ROS's plumb_bob has 5.
    if any(coefficients[wanted:]):
        raise ValueError(f"{model} needs {wanted} coefficients, got {count}")
    if count < wanted and count not in ((0, 4) if model == "plumb_bob" else (0,)):
        raise ValueError(f"{model} needs {wanted} coefficients, got {count}")
    return model, (coefficients + [0.0] * wanted)[:wanted]


def check_lens(camera: Camera, name: str) -> None:
    """Warns (LensWarning) or refuses if the distortion cannot be undone in some of the image."""
    share = camera.untrusted
    if share == 0:
        return
    if camera.distortion_model == "equidistant" and camera.lens.widest:
        why = f"looks more than {WIDEST_DEG:g} deg away from its axis"
        advice = "crop the images"
    else:
        why = f"has {camera.distortion_model} distortion that cannot be undone"
        advice = "calibrate again with the board there, or with --model rational_polynomial|fisheye"
    what = f"{name}: the lens {why} in {share:.1%} of the image, at the edges"
    if share > MOST_UNTRUSTED:
        raise UserError(f"{what}; {advice}")
    warnings.warn(f"{what}: bearings are a guess there; {advice}", LensWarning, stacklevel=3)


def write_camera_info(camera: Camera, path: str | Path) -> None:
    """Writes a ROS `camera_info` YAML that `read_camera_info` and ROS's camera drivers read."""
    write_bytes(path, camera_info_of(camera).encode())


def camera_info_of(camera: Camera) -> str:
    """The text of a camera's `camera_info` YAML."""
    import yaml

    def matrix(rows: int, data: list[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": len(data) // rows, "data": [float(v) for v in data]}

    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    info = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": camera.name,
        "camera_matrix": matrix(3, [fx, 0, cx, 0, fy, cy, 0, 0, 1]),
        "distortion_model": camera.distortion_model,
        "distortion_coefficients": matrix(1, list(camera.distortion)),
        "rectification_matrix": matrix(3, [1, 0, 0, 0, 1, 0, 0, 0, 1]),
        "projection_matrix": matrix(3, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]),
    }
    text: str = yaml.safe_dump(info, sort_keys=False, default_flow_style=None)
    return text
