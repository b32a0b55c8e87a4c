"""What tests make: images, films, ONNX files of the networks' signatures, data sets."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from PIL import Image

# Images and films

FORMATS = ("JPEG", "PNG", "TIFF", "BMP", "WEBP")


def scene(width: int = 64, height: int = 48) -> NDArray[np.uint8]:
    """A grey ramp with a red square in the top-left corner and a blue one at the top right."""
    image = np.empty((height, width, 3), np.uint8)
    image[:] = np.linspace(20, 235, width)[None, :, None]
    image[: height // 3, : width // 4] = (230, 20, 20)
    image[: height // 3, -(width // 4) :] = (20, 20, 230)
    return image


def encode(
    image: NDArray[np.uint8] | Image.Image,
    kind: str = "JPEG",
    *,
    orientation: int | None = None,
    focal_35mm: int | None = None,
    **options: object,
) -> bytes:
    """`image` as a file of `kind` (a Pillow format name), with EXIF where asked for."""
    if not isinstance(image, Image.Image):
        image = Image.fromarray(image)
    exif = Image.Exif()
    if orientation is not None or focal_35mm is not None:
        exif[0x0112] = orientation or 1
        options["exif"] = exif
    if focal_35mm is not None:
        exif.get_ifd(0x8769)[0xA405] = focal_35mm
    if kind == "JPEG":
        options.setdefault("quality", 95)
        options.setdefault("subsampling", 0)
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


STEP = 4  # grey levels between two frames of a film


def film(
    path: Path, count: int = 30, fps: float = 20.0, fourcc: str = "MJPG", width: int = 64
) -> Path:
    """Grey frames, STEP levels brighter each time; `number` reads them back."""
    size = (width, width * 3 // 4)
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*fourcc), fps, size, []
    )
    assert writer.isOpened()
    for index in range(count):
        writer.write(np.full((size[1], size[0], 3), index * STEP % 256, np.uint8))
    writer.release()
    return path


def patched(path: Path, boxes: str, edit: Callable[[bytes], bytes]) -> None:
    """Edits the body of one box of an MP4's video track, which may grow: the index stands last."""
    data = path.read_bytes()
    at, parents = 0, []
    for name in boxes.split("/"):
        at = data.index(name.encode(), at) - 4
        parents.append(at)
        at += 8
    size = int.from_bytes(data[parents[-1] : parents[-1] + 4], "big")
    body = data[at : parents[-1] + size]
    new = edit(body)
    out = bytearray(data[:at] + new + data[parents[-1] + size :])
    for place in parents:
        grown = int.from_bytes(out[place : place + 4], "big") + len(new) - len(body)
        out[place : place + 4] = grown.to_bytes(4, "big")
    path.write_bytes(bytes(out))


def number(image: NDArray[np.uint8]) -> int:
    return round(float(image.mean()) / STEP)


# Networks: ONNX files that compute something simple and known

STRIPS = 16
METADATA = {"name": "doornet", "version": "test", "canonical_f_px": 200.0, "depth_error": 0.1}


def _save(
    path: Path,
    shape: list[Any],
    nodes: list[onnx.NodeProto],
    outputs: dict[str, list[Any]],
    constants: dict[str, np.ndarray],
    metadata: dict[str, Any] | None = None,
    input_name: str = "image",
) -> Path:
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info(input_name, TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in outputs.items()],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    if metadata is not None:
        helper.set_model_props(model, {"doorway3ds": json.dumps(metadata)})
    path.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, path)
    return path


def doornet(
    path: Path,
    *,
    p_open: float = 3.0,
    left: float = 0.4,
    right: float = 0.6,
    nearest: float = 1.0,
    metadata: dict[str, Any] | None = None,
    drop: str | None = None,
    input_name: str = "image",
) -> Path:
    """A door from `left` to `right` (fractions of the input's width) in every picture.

    p_open: the logit. depth: `nearest` + red / 100 metres at a quarter of the input's size, for the
    canonical camera. floor: logit 4 on the lower half, -4 on the upper. drop: an output left out.
    """
    centre = (np.arange(STRIPS, dtype=np.float32)[None] + 0.5) / STRIPS
    inside = (centre > left) & (centre < right)
    constants = {
        "p": np.array([p_open], np.float32),
        "s": np.where(inside, 4.0, -6.0).astype(np.float32),
        "l": np.maximum(centre - left, 0).astype(np.float32),
        "r": np.maximum(right - centre, 0).astype(np.float32),
        "axis": np.array([1], np.int64),
        "from": np.array([0], np.int64),
        "to": np.array([1], np.int64),
        "hundred": np.array(100, np.float32),
        "nearest": np.array(nearest, np.float32),
        "zero": np.array(0, np.float32),
        "rows": np.linspace(-4, 4, 48, dtype=np.float32).reshape(1, 48, 1),
    }
    node = helper.make_node
    nodes = [
        node("Slice", [input_name, "from", "to", "axis"], ["red4"]),
        node("AveragePool", ["red4"], ["small"], kernel_shape=[4, 4], strides=[4, 4]),
        node("Squeeze", ["small", "axis"], ["red"]),
        node("Div", ["red", "hundred"], ["d1"]),
        node("Add", ["d1", "nearest"], ["depth"]),
        # Red falls out of the sum but keeps the map as wide as the input.
        node("ReduceMean", ["small"], ["row4"], axes=[2], keepdims=0),
        node("Mul", ["row4", "zero"], ["blank"]),
        node("Add", ["rows", "blank"], ["floor"]),
        node("Identity", ["p"], ["p_open"]),
        node("Identity", ["s"], ["score"]),
        node("Identity", ["l"], ["left"]),
        node("Identity", ["r"], ["right"]),
    ]
    outputs: dict[str, list[Any]] = {
        "p_open": [1],
        "score": [1, STRIPS],
        "left": [1, STRIPS],
        "right": [1, STRIPS],
        "depth": [1, "dh", "dw"],
        "floor": [1, 48, "fw"],
    }
    if drop:
        del outputs[drop]
    return _save(
        path,
        [1, 3, "h", "w"],
        nodes,
        outputs,
        constants,
        METADATA if metadata is None else metadata,
        input_name,
    )


def cnn_srin(path: Path, *, channels_last: bool = True, scale: float = 1 / 255) -> Path:
    """p_open is the mean of red times `scale`."""
    shape = [1, 224, 224, 3] if channels_last else [1, 3, 224, 224]
    axis = 3 if channels_last else 1
    constants = {
        "axis": np.array([axis], np.int64),
        "from": np.array([0], np.int64),
        "to": np.array([1], np.int64),
        "scale": np.array(scale, np.float32),
    }
    nodes = [
        helper.make_node("Slice", ["image", "from", "to", "axis"], ["red"]),
        helper.make_node("ReduceMean", ["red"], ["mean"], axes=[0, 1, 2, 3], keepdims=0),
        helper.make_node("Mul", ["mean", "scale"], ["scaled"]),
        helper.make_node("Unsqueeze", ["scaled", "from"], ["p_open"]),
    ]
    return _save(path, shape, nodes, {"p_open": [1]}, constants)


def densedepth(path: Path, *, channels_last: bool = True, gain: float = 10.0) -> Path:
    """The raw output (10 m / depth) is red (0..1) times `gain`."""
    shape = [1, 480, 640, 3] if channels_last else [1, 3, 480, 640]
    constants = {
        "axis": np.array([1], np.int64),
        "from": np.array([0], np.int64),
        "to": np.array([1], np.int64),
        "gain": np.array(gain, np.float32),
    }
    nodes = [
        helper.make_node("Transpose", ["image"], ["nchw"], perm=[0, 3, 1, 2])
        if channels_last
        else helper.make_node("Identity", ["image"], ["nchw"]),
        helper.make_node("Slice", ["nchw", "from", "to", "axis"], ["red"]),
        helper.make_node("AveragePool", ["red"], ["small"], kernel_shape=[2, 2], strides=[2, 2]),
        helper.make_node("Mul", ["small", "gain"], ["depth"]),
    ]
    return _save(path, shape, nodes, {"depth": [1, 1, 240, 320]}, constants)


def depth_file(
    path: Path,
    *,
    input_name: str = "pixel_values",
    outputs: tuple[str, ...] = ("predicted_depth",),
    shape: tuple[Any, ...] = ("batch_size", "num_channels", "height", "width"),
    channel: int = 0,
    gain: float = 1.0,
    offset: float = 0.0,
    axes: int = 3,
) -> Path:
    """One channel of the prepared input times `gain` plus `offset`, at the input's size.

    The defaults are the signature that Depth Anything V2 has on the hub, every size left open.
    axes: of the outputs. A shape with 3 in its last place takes channels last.
    """
    axis = 3 if shape[3] == 3 else 1
    constants = {
        "axis": np.array([axis], np.int64),
        "from": np.array([channel], np.int64),
        "to": np.array([channel + 1], np.int64),
        "gain": np.array(gain, np.float32),
        "offset": np.array(offset, np.float32),
    }
    nodes = [
        helper.make_node("Slice", [input_name, "from", "to", "axis"], ["one"]),
        helper.make_node("Squeeze", ["one", "axis"], ["map"])
        if axes == 3
        else helper.make_node("Identity", ["one"], ["map"]),
        helper.make_node("Mul", ["map", "gain"], ["scaled"]),
        *(helper.make_node("Add", ["scaled", "offset"], [name]) for name in outputs),
    ]
    sizes = {name: [None] * axes for name in outputs}
    return _save(path, list(shape), nodes, sizes, constants, input_name=input_name)


# Data sets

HEADER = "image,open,left_px,right_px,clear,confidence,second"


def write_picture(path: Path, width: int, height: int, value: int = 128) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((height, width, 3), value, np.uint8))


def room(
    rng: np.random.Generator, *, is_open: bool, width: int = 96, height: int = 72
) -> np.ndarray:
    """(H, W, 3) uint8 RGB: blurred colours, and a bright door where it is open."""
    coarse = rng.integers(20, 180, (6, 8, 3), dtype=np.uint8)
    image = np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC))
    if is_open:
        left = int(rng.integers(width // 8, width // 2))
        image[height // 6 :, left : left + width // 4] = 250
    return image


def save(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image[..., ::-1] if image.ndim == 3 else image)
    return path


def classes(folder: Path, count: int, seed: int = 0) -> Path:
    """`count` pictures in each of no-door/ and open-door/."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        for name, is_open in (("no-door", False), ("open-door", True)):
            save(folder / name / f"{index:02d}.png", room(rng, is_open=is_open))
    return folder


def depth_pairs(folder: Path, count: int, scale: float = 1000.0, seed: int = 0) -> Path:
    """images/ and depth/ with 16-bit depth of 1 to 4 m, `scale` counts per metre."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        image = room(rng, is_open=index % 2 == 0)
        depth = np.linspace(1, 4, image.shape[1])[None] * np.ones((image.shape[0], 1)) * scale
        save(folder / "images" / f"{index:02d}.png", image)
        save(folder / "depth" / f"{index:02d}.png", np.round(depth).astype(np.uint16))
    return folder


ROOMS = 16


def write_site(folder: Path, marked: bool = True, rooms: int = ROOMS, each: int = 4) -> Path:
    """Half of each room's pictures show the opening; marked in doorways.csv, or by folders."""
    rows = ["image,open,left_px,right_px,clear,confidence,second,state,place"]
    for room in range(rooms):
        rng = np.random.default_rng(room)
        wall = rng.integers(30, 90, 3)
        for number in range(each):
            is_open = number % 2 == 0
            image = np.clip(wall + rng.normal(0, 6, (120, 160, 3)), 0, 255).astype(np.uint8)
            image[90:] //= 2
            left = int(rng.integers(5, 85))
            right = left + int(rng.integers(50, 70))
            if is_open:
                image[20:105, left:right] = rng.integers(200, 250, 3)
            name = f"room{room:02d}/{number}.png"
            if not marked:
                name = f"{'open-door' if is_open else 'no-door'}/{name}"
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / name), image)
            span = f"{left - 0.5},{right - 0.5},1,3,0,open" if is_open else ",,,3,0,none"
            rows.append(f"{name},{int(is_open)},{span},room{room:02d}")
    if marked:
        (folder / "doorways.csv").write_text("\n".join(rows) + "\n")
    return folder
