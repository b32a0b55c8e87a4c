"""The camera files of other tools, brought into the form of a ROS `camera_info` file.

OpenCV's FileStorage (its calibration samples' names), the output of `rostopic echo` and `ros2 topic
echo`, and Kalibr's camchain hold the same numbers under other names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

Info = dict[str, Any]

_NAMES = {
    "image_width": ("image_width", "image_Width", "width"),
    "image_height": ("image_height", "image_Height", "height"),
    "camera_matrix": ("camera_matrix", "cameraMatrix", "Camera_Matrix", "k", "K", "M1"),
    "distortion_coefficients": (
        "distortion_coefficients",
        "Distortion_Coefficients",
        "distCoeffs",
        "dist_coeffs",
        "distortion_coeffs",
        "d",
        "D",
        "D1",
    ),
    "distortion_model": ("distortion_model",),
    "camera_name": ("camera_name",),
}
_SIZES = ("image_size", "imageSize", "image_Size", "resolution")
_KALIBR = {"radtan": "plumb_bob", "equidistant": "equidistant", "none": "plumb_bob"}


def parse(data: bytes) -> Info:
    """The first document of a camera file by the names of `camera_info`; lists become `data`.

    Raises ValueError if it is no such text, or a chain of several cameras.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        """Takes FileStorage's matrices for the mappings that they are."""

    def matrix(loader: Any, node: Any) -> Any:
        return loader.construct_mapping(node, deep=True)

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", matrix)
    wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
        # FileStorage's first line is no directive of YAML's.
        text = re.sub(r"\A%YAML:.*\n", "", text)
        found = next(iter(yaml.load_all(text, Loader)), None)  # a SafeLoader
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError("it is not YAML text") from error
    if not isinstance(found, dict):
        raise ValueError("expected image_width, image_height, camera_matrix and more by name")
    return _renamed(_of_chain(found))


def _of_chain(found: Info) -> Info:
    """The one camera of a Kalibr camchain; anything else as it is."""
    cameras = {name: it for name, it in found.items() if re.fullmatch(r"cam\d+", str(name))}
    if not cameras:
        return found
    if len(cameras) > 1:
        raise ValueError(f"it holds {', '.join(cameras)}; keep the one camera that is meant")
    ((name, camera),) = cameras.items()
    kind, model = camera.get("camera_model"), camera.get("distortion_model")
    if kind != "pinhole" or model not in _KALIBR:
        raise ValueError(
            f"expected Kalibr's pinhole with {', '.join(_KALIBR)}, got {kind} with {model}"
        )
    fx, fy, cx, cy = camera["intrinsics"]
    return {
        "camera_name": camera.get("camera_name", name),
        "resolution": camera["resolution"],
        "camera_matrix": [fx, 0, cx, 0, fy, cy, 0, 0, 1],
        "distortion_model": _KALIBR[model],
        "distortion_coefficients": [] if model == "none" else camera["distortion_coeffs"],
    }


def _renamed(found: Info) -> Info:
    info: Info = {}
    for name, others in _NAMES.items():
        given = [found[other] for other in others if other in found]
        if given:
            info[name] = given[0]
    size = next((found[name] for name in _SIZES if name in found), None)
    if size is not None:
        size = size.get("data", size) if isinstance(size, Mapping) else size
        info.setdefault("image_width", size[0])
        info.setdefault("image_height", size[1])
    for name in ("camera_matrix", "distortion_coefficients"):
        if isinstance(info.get(name), list):
            rows = info[name]
            flat = [v for row in rows for v in row] if rows and isinstance(rows[0], list) else rows
            info[name] = {"data": flat}
    if "fisheye_model" in found:
        info["distortion_model"] = "equidistant" if int(found["fisheye_model"]) else None
        if not info["distortion_model"] and len(info["distortion_coefficients"]["data"]) == 4:
            info["distortion_model"] = "plumb_bob"
    return info
