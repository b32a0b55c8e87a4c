"""Small files of the kinds that training reads: teacher networks, data sets."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest

from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera

# kernels of MobileNetV2 to its last stage, and of FastDepth, with few channels
_STAGES = ((4, 1, 1), (4, 2, 2), (8, 3, 2), (8, 4, 2), (8, 3, 1), (8, 3, 2), (8, 1, 1))


def _save_convolutions(path: Path, kernels: list[tuple[int, int, int, int]]) -> None:
    """An ONNX file with convolutions of these (out, in, size, groups).

    The first sees the input and gives, made positive, the output; the others see nothing.
    """
    rng = np.random.default_rng(3)
    nodes, weights = [], []
    for index, (out, inside, size, groups) in enumerate(kernels):
        kernel = rng.normal(0, (2 / (inside * size**2)) ** 0.5, (out, inside // groups, size, size))
        weights.append(onnx.numpy_helper.from_array(kernel.astype(np.float32), f"w{index}"))
        weights.append(onnx.numpy_helper.from_array(np.full(out, 0.1, np.float32), f"b{index}"))
        seen = "x"
        if index:
            seen = f"zeros{index}"
            zeros = np.zeros((1, inside, size, size), np.float32)
            constant = onnx.numpy_helper.from_array(zeros, seen)
            nodes.append(onnx.helper.make_node("Constant", [], [seen], value=constant))
        nodes.append(
            onnx.helper.make_node(
                "Conv", [seen, f"w{index}", f"b{index}"], [f"y{index}"], group=groups
            )
        )
    nodes.append(onnx.helper.make_node("Abs", ["y0"], ["y"]))
    picture = onnx.helper.make_tensor_value_info("x", 1, [1, 3, None, None])
    graph = onnx.helper.make_graph(
        nodes, "few", [picture], [onnx.helper.make_tensor_value_info("y", 1, None)], weights
    )
    opset = onnx.helper.make_opsetid("", 17)
    onnx.save(onnx.helper.make_model(graph, opset_imports=[opset], ir_version=8), str(path))


@pytest.fixture(scope="session")
def teachers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the three teacher files, random and small."""
    folder = tmp_path_factory.mktemp("teachers")
    kernels = [(4, 3, 3, 1)]
    width = 4
    for stage, (out, repeats, _) in enumerate(_STAGES):
        for _ in range(repeats):
            inner = width
            if stage:
                inner = 2 * width
                kernels.append((inner, width, 1, 1))
            kernels += [(inner, inner, 3, inner), (out, inner, 1, 1)]
            width = out
    _save_convolutions(folder / "deeplabv3_mnv2_ade20k_512.onnx", kernels)

    kernels = [(8, 3, 3, 1)]
    for _ in range(13):
        kernels += [(8, 8, 3, 8), (8, 8, 1, 1)]
    for _ in range(5):
        kernels += [(8, 8, 5, 8), (8, 8, 1, 1)]
    kernels.append((1, 8, 1, 1))
    _save_convolutions(folder / "fastdepth_nyu_224.onnx", kernels)
    _save_convolutions(folder / "mobilenet_v2_imagenet_224.onnx", [(4, 3, 3, 1)])
    return folder


@pytest.fixture
def rendered(tmp_path: Path) -> Path:
    """Twelve rendered pictures of six homes: a bright opening in a dark wall, or none."""
    folder = tmp_path / "rendered"
    for part in ("images", "depth", "floor"):
        (folder / part).mkdir(parents=True)
    rows = []
    rng = np.random.default_rng(5)
    for index in range(12):
        has_opening = index % 2 == 0
        image = rng.integers(40, 60, (120, 160, 3), dtype=np.uint8)
        depth = np.full((120, 160), 2000, np.uint16)
        floor = np.zeros((120, 160), np.uint8)
        floor[90:] = 255
        left, right = 40 + 4 * index, 70 + 4 * index
        if has_opening:
            image[20:90, left:right] = 220
            depth[20:90, left:right] = 4000
        name = f"{index:06d}"
        cv2.imwrite(str(folder / "images" / f"{name}.png"), image)
        cv2.imwrite(str(folder / "depth" / f"{name}.png"), depth)
        cv2.imwrite(str(folder / "floor" / f"{name}.png"), floor)
        edges = {"left_px": left - 0.5, "right_px": right - 0.5} if has_opening else {}
        rows.append(
            {
                "image": f"{name}.png",
                "open": int(has_opening),
                "left_px": "",
                "right_px": "",
                "clear": int(has_opening) if has_opening else "",
                "confidence": 3,
                "second": 0,
                "home": index // 2,
                "fx_px": 140.0,
                **edges,
            }
        )
    with (folder / "doorways.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return folder


@pytest.fixture
def marked(tmp_path: Path) -> Path:
    """Eight photographs of two sizes marked by hand, of four rooms; a camera file, no depth."""
    folder = tmp_path / "site"
    rng = np.random.default_rng(8)
    rows = ["image,open,left_px,right_px,clear,confidence,second,state,place"]
    for index in range(8):
        width, height = ((160, 120), (320, 240))[index % 2]
        name = f"room{index // 2}/{index}.png"
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        image = rng.integers(40, 60, (height, width, 3), dtype=np.uint8)
        image[:, width // 2 : width * 3 // 4] = 220
        cv2.imwrite(str(folder / name), image)
        span = f"{width / 2 - 0.5},{width * 3 / 4 - 0.5}"
        rows.append(
            (
                f"{name},1,{span},1,3,0,open,room{index // 2}",
                f"{name},0,,,,2,0,closed,room{index // 2}",
                f"{name},1,{span},,1,0,half,room{index // 2}",
            )[index % 3]
        )
    (folder / "doorways.csv").write_text("\n".join(rows) + "\n")
    write_camera_info(Camera("lens", 640, 480, 600, 610, 320, 240), folder / "camera.yaml")
    return folder
