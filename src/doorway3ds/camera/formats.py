"""The camera files of other tools, brought into the form of a ROS `camera_info` file.

OpenCV's FileStorage (YAML, JSON, XML, also gzipped), the output of `rostopic echo` and `ros2 topic
echo`, ROS's ost.txt, Kalibr's camchain, and the settings of ORB-SLAM and VINS hold the same numbers
under other names.
"""

from __future__ import annotations

import codecs
import gzip
import io
import re
from collections.abc import Mapping
from typing import Any

Info = dict[str, Any]

_NAMES = {
    "image_width": ("image_width", "width", "Camera.width"),
    "image_height": ("image_height", "height", "Camera.height"),
    "camera_matrix": ("camera_matrix", "cameraMatrix", "intrinsic_matrix", "mtx", "k", "M1"),
    "distortion_coefficients": (
        *("distortion_coefficients", "distCoeffs", "dist_coeffs", "distortion_coeffs"),
        *("distortion_vector", "distortion", "dist", "d", "D1"),
    ),
    "distortion_model": ("distortion_model", "model_type", "Camera.type"),
    "camera_name": ("camera_name",),
}
_SIZES = ("image_size", "imageSize", "resolution")
# The matrix and the coefficients one by one, and what stands before their names.
_PREFIXES = ("Camera1.", "Camera.", "")
_MATRIX = (("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy"))
_COEFFICIENTS = {"plumb_bob": "k1 k2 p1 p2 k3", "equidistant": "k1 k2 k3 k4"}
_MODELS = {
    **dict.fromkeys(("plumb bob", "radtan", "brown conrady", "pinhole", "none"), "plumb_bob"),
    **dict.fromkeys(
        ("fisheye", "kannala brandt", "kannala brandt4", "kannalabrandt8"), "equidistant"
    ),
}
_BOMS = (
    *((mark, "utf-32") for mark in (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)),
    *((mark, "utf-16") for mark in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)),
)
_LARGEST = 1 << 20


def parse(data: bytes) -> Info:
    """The first document of a camera file by the names of `camera_info`; lists become `data`.

    Raises ValueError if it is no such text, a chain of several cameras, or of a part of an image.
    """
    text = _text(data)
    if text.lstrip().startswith("<"):
        found = _xml(text)
    elif re.search(r"^camera matrix\s*$", text, re.MULTILINE):
        found = _ost(text)
    else:
        found = _yaml(text)
    if not isinstance(found, dict):
        raise ValueError("expected image_width, image_height, camera_matrix and more by name")
    return _renamed(_of_chain(found))


def _text(data: bytes) -> str:
    """A file's text: UTF-8, what its mark or its zero bytes say, or at last Latin-1."""
    if data.startswith(b"\x1f\x8b"):
        try:
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(_LARGEST)
        except (OSError, EOFError) as error:
            raise ValueError(f"its gzip is damaged ({error})") from error
    marked = next((name for mark, name in _BOMS if data.startswith(mark)), None)
    bare = {b"\0": "utf-16-be"}.get(data[:1]) or {b"\0": "utf-16-le"}.get(data[1:2])
    try:
        return data.decode(marked or bare or "utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # of which only names and comments can be misread


def _yaml(text: str) -> Any:
    import yaml

    class Loader(yaml.SafeLoader):
        """Takes FileStorage's matrices for the mappings that they are."""

    def matrix(loader: Any, node: Any) -> Any:
        return loader.construct_mapping(node, deep=True)

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", matrix)
    # FileStorage's first line is no directive of YAML's; tabs are no space of its.
    text = re.sub(r"\A%YAML:.*\n", "", text).expandtabs(2)
    try:
        return next(iter(yaml.load_all(text, Loader)), None)  # a SafeLoader
    except yaml.YAMLError as error:
        raise ValueError("it is not YAML, JSON or XML text") from error


def _xml(text: str) -> Info:
    """An XML file of OpenCV's."""
    import cv2

    def value(node: Any) -> Any:
        if node.isMap():
            return {"data": node.mat().ravel().tolist()}
        if node.isSeq():
            return [value(node.at(i)) for i in range(node.size())]
        return node.string() if node.isString() else node.real()

    text = re.sub(r"\A\s*<\?xml[^>]*>", '<?xml version="1.0"?>', text)  # whatever encoding it says
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        return {name: value(root.getNode(name)) for name in root.keys()}  # noqa: SIM118
    except (cv2.error, SystemError, AttributeError) as error:
        raise ValueError("it is XML, but not of OpenCV's FileStorage") from error


def _ost(text: str) -> Info:
    """The ost.txt that ROS's camera_calibration writes beside ost.yaml."""
    numbers = r"^{}\s*\n((?:[-+.\deE]+\s+)+)"
    found: Info = {
        name.replace(" ", "_"): [float(v) for v in match[1].split()]
        for name in ("width", "height", "camera matrix", "distortion")
        if (match := re.search(numbers.format(name), text + "\n", re.MULTILINE))
    }
    for side in ("width", "height"):
        found[side] = found[side][0]
    return found


def _of_chain(found: Info) -> Info:
    """The one camera of a Kalibr camchain; anything else as it is."""
    cameras = {name: it for name, it in found.items() if re.fullmatch(r"cam\d+", str(name))}
    if not cameras:
        return found
    if len(cameras) > 1:
        raise ValueError(f"it holds {', '.join(cameras)}; keep only the one that you mean")
    ((name, camera),) = cameras.items()
    kind, model = camera.get("camera_model"), camera.get("distortion_model")
    if kind != "pinhole":
        raise ValueError(f"expected Kalibr's pinhole camera, got {kind} with {model}")
    own = dict(zip(("fx", "fy", "cx", "cy"), camera["intrinsics"], strict=True))
    coefficients = [] if model == "none" else camera["distortion_coeffs"]
    return {"camera_name": name, **camera, **own, "distortion_coeffs": coefficients}


def _renamed(found: Info) -> Info:
    """The same by the names of `camera_info`, whose other spellings differ in case alone."""
    for part in ("projection_parameters", "distortion_parameters"):
        found = {**found, **(found.get(part) or {})}
    lower = {str(name).lower(): value for name, value in found.items()}
    info: Info = {}
    for name, others in _NAMES.items():
        given = [lower[other.lower()] for other in others if other.lower() in lower]
        if given:
            info[name] = given[0]
    size = next((lower[name.lower()] for name in _SIZES if name.lower() in lower), None)
    if size is not None:
        size = size.get("data", size) if isinstance(size, Mapping) else size
        info.setdefault("image_width", size[0])
        info.setdefault("image_height", size[1])
    said = re.sub(r"[\s_-]+", " ", str(info.get("distortion_model") or "").lower())
    if said in _MODELS:
        info["distortion_model"] = _MODELS[said]
    _one_by_one(found, info)
    for name in ("camera_matrix", "distortion_coefficients"):
        value = info.get(name)
        rows = value["data"] if isinstance(value, Mapping) else value
        if isinstance(rows, list):
            info[name] = {"data": [v for row in rows for v in _row(row)]}
    if "fisheye_model" in found:
        info["distortion_model"] = "equidistant" if int(found["fisheye_model"]) else None
        if not info["distortion_model"] and len(info["distortion_coefficients"]["data"]) == 4:
            info["distortion_model"] = "plumb_bob"
    _check_whole(found.get("roi"), info)
    return info


def _row(row: Any) -> list[Any]:
    return row if isinstance(row, list) else [row]


def _one_by_one(found: Info, info: Info) -> None:
    """Adds the matrix and the coefficients of a file that names each number by itself."""

    def one(names: tuple[str, ...]) -> Any:
        named = [found[p + name] for p in _PREFIXES for name in names if p + name in found]
        return named[0] if named else None

    focal = [one(names) for names in _MATRIX]
    if "camera_matrix" in info or None in focal:
        return
    fx, fy, cx, cy = focal
    info["camera_matrix"] = [fx, 0, cx, 0, fy, cy, 0, 0, 1]
    model = info.setdefault("distortion_model", "plumb_bob")
    if "distortion_coefficients" not in info and model in _COEFFICIENTS:
        values = [one((name,)) for name in _COEFFICIENTS[model].split()]
        info["distortion_coefficients"] = [v or 0.0 for v in values]


def _check_whole(roi: Any, info: Info) -> None:
    """ValueError for a message whose images are cut out of the sensor's."""
    if not isinstance(roi, Mapping):
        return
    part = [int(roi.get(side) or 0) for side in ("width", "height")]
    if all(part) and part != [int(info["image_width"]), int(info["image_height"])]:
        raise ValueError(
            f"it is of images cut to a region of {part[0]}x{part[1]}; expected one of whole images"
        )
