"""Any ONNX depth file by its sidecar: what it is fed, what its numbers mean, what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from doorway3ds.camera.model import Camera
from doorway3ds.errors import CallError, UserError
from doorway3ds.files import digest
from doorway3ds.networks import load
from doorway3ds.networks.depth.file import DepthFile
from doorway3ds.networks.depth.presets import METRIC, PRESETS, RELATIVE
from doorway3ds.networks.depth.spec import MAX_ASPECT, DepthSpec, parse
from tests import factories

CAMERA = Camera("test", 640, 480, 500.0, 520.0, 319.5, 239.5)
SPEC: dict[str, Any] = {"unit": "m", "width": 32, "height": 24}


def picture(red: int, green: int = 0, blue: int = 0, size: tuple[int, int] = (480, 640)):
    return np.full((*size, 3), (red, green, blue), np.uint8)


def with_sidecar(path: Path, fields: object, ending: str = ".yaml", **card: object) -> Path:
    text = {**card, "depth": fields}
    dump = yaml.safe_dump(text) if ending != ".json" else json.dumps(text)
    path.with_suffix(ending).write_text(dump)
    return path


def metres(path: Path, image: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    depth = load(str(path), threads=1)(image, camera).depth_m
    assert depth is not None
    return depth


@pytest.mark.parametrize("ending", [".yaml", ".yml", ".json"])
@pytest.mark.parametrize(
    ("unit", "factor", "raw", "expected"),
    [
        ("m", 1.0, 2.5, 2.5),
        ("cm", 1.0, 250.0, 2.5),
        ("mm", 0.5, 5000.0, 2.5),
        ("1/m", 1.0, 0.4, 2.5),
        ("1/m", 0.1, 4.0, 2.5),  # 10 m / depth, as DenseDepth gives it
    ],
)
def test_units(
    tmp_path: Path, ending: str, unit: str, factor: float, raw: float, expected: float
) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", gain=0.0, offset=raw)
    with_sidecar(path, {**SPEC, "unit": unit, "factor": factor}, ending)
    depth = metres(path, picture(0))
    assert depth.shape == (24, 32)
    assert depth.dtype == np.float32
    assert depth == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("channel", [0, 1, 2])
@pytest.mark.parametrize("channels", ["rgb", "bgr"])
@pytest.mark.parametrize("last", [False, True])
def test_the_network_is_fed_as_the_sidecar_says(
    tmp_path: Path, channel: int, channels: str, last: bool
) -> None:
    colour, mean, std = (51, 102, 204), [0.1, 0.2, 0.3], [0.5, 0.25, 0.2]
    shape = (1, 24, 32, 3) if last else (1, 3, 24, 32)
    path = factories.depth_file(tmp_path / "n.onnx", channel=channel, offset=5.0, shape=shape)
    with_sidecar(path, {"unit": "m", "mean": mean, "std": std, "channels": channels})
    seen = channel if channels == "rgb" else 2 - channel
    expected = 5 + (colour[seen] / 255 - mean[seen]) / std[seen]
    assert metres(path, picture(*colour)) == pytest.approx(expected, rel=1e-5)


def test_white_is_the_value_of_a_white_pixel(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", gain=0.01)
    with_sidecar(path, {**SPEC, "white": 255, "mean": 5, "std": 2})
    assert metres(path, picture(205)) == pytest.approx(1.0)


@pytest.mark.parametrize("axes", [3, 4])
def test_a_map_lies_over_the_whole_picture(tmp_path: Path, axes: int) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", offset=1.0, axes=axes)
    with_sidecar(path, SPEC)
    image = picture(0)
    image[:, 320:] = 255
    depth = metres(path, image)
    assert depth[:, :16] == pytest.approx(1.0)
    assert depth[:, 16:] == pytest.approx(2.0)


@pytest.mark.parametrize("zoom", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("size", [(32, 24), (24, 24), (64, 16)])
def test_metres_follow_the_camera_s_focal_length(
    tmp_path: Path, zoom: float, size: tuple[int, int]
) -> None:
    width, height = size
    path = factories.depth_file(tmp_path / "n.onnx", gain=0.0, offset=3.0)
    with_sidecar(path, {"unit": "m", "width": width, "height": height, "focal_px": 40.0})
    camera = Camera("zoomed", 640, 480, 500 * zoom, 520 * zoom, 319.5, 239.5)
    focal = zoom * math.sqrt(500 * width / 640 * 520 * height / 480)
    assert metres(path, picture(0), camera) == pytest.approx(3 * focal / 40, rel=1e-5)
    # The same view in more pixels is as far away.
    larger = metres(path, picture(0, size=(960, 1280)), camera.scaled_to(1280, 960))
    assert larger == pytest.approx(3 * focal / 40, rel=1e-5)


@pytest.mark.parametrize(
    ("size", "expected"),
    [((640, 480), (686, 518)), ((480, 640), (518, 686)), ((1920, 1080), (924, 518))],
)
def test_the_presets_input_is_its_authors(size: tuple[int, int], expected: tuple[int, int]) -> None:
    for spec in PRESETS.values():
        assert spec.size_for(*size) == expected


@given(width=st.integers(1, 20000), height=st.integers(1, 20000))
def test_any_picture_has_a_size_without_running_away(width: int, height: int) -> None:
    for spec in PRESETS.values():
        across, down = spec.size_for(width, height)
        assert across % 14 == down % 14 == 0
        assert min(across, down) == 518
        assert max(across, down) <= 518 * MAX_ASPECT
        assert spec.size_for(height, width) == (down, across)


def test_the_metric_preset_reads_hypersim_as_hypersim(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", gain=0.0, offset=4.0)
    net = DepthFile(path, PRESETS[METRIC], threads=1)
    hypersim = Camera("hypersim", 1024, 768, 886.81, 886.81, 511.5, 383.5)
    depth = net(picture(0, size=(768, 1024)), hypersim).depth_m
    assert depth is not None
    assert depth == pytest.approx(4.0, rel=1e-5)
    assert net.gives == {"depth"}


def test_a_preset_takes_a_file_that_fixes_its_size(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", gain=0.0, offset=4.0, shape=(1, 3, 28, 42))
    seen = DepthFile(path, PRESETS[RELATIVE], threads=1)(picture(0), CAMERA)
    assert seen.relative is not None
    assert seen.relative.inverse.shape == (28, 42)


def test_relative_depth_has_no_metres_of_its_own(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", gain=0.0, offset=7.0)
    net = DepthFile(path, PRESETS[RELATIVE], threads=1)
    seen = net(picture(0), CAMERA)
    assert net.gives == {"relative"}
    assert seen.depth_m is None
    assert seen.relative is not None
    assert seen.relative.shifted
    assert seen.relative.inverse == pytest.approx(7.0)
    scaled = DepthFile(path, DepthSpec("relative", short_side=28), threads=1)
    seen = scaled(picture(0), CAMERA)
    assert seen.relative is not None
    assert not seen.relative.shifted
    assert seen.relative.inverse == pytest.approx(1 / 7)


def test_values_that_are_no_distance_are_unknown(tmp_path: Path) -> None:
    for unit in ("m", "1/m"):
        path = factories.depth_file(tmp_path / f"{unit[0]}.onnx", gain=2.0, offset=-1.0)
        with_sidecar(path, {**SPEC, "unit": unit})
        image = picture(0)
        image[:, 320:] = 255
        depth = metres(path, image)
        assert np.isnan(depth[:, :16]).all()
        assert depth[:, 16:] == pytest.approx(1.0)


def test_a_wrong_unit_is_found_at_the_first_picture(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", gain=0.0, offset=250.0)
    with_sidecar(path, SPEC)
    with pytest.raises(UserError, match=r"sees a median depth of 250 m, expected 0\.02 to 60"):
        metres(path, picture(0))


def test_one_of_several_outputs(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", offset=2.0, outputs=("depth", "normal"))
    with pytest.raises(UserError, match="has the outputs depth, normal; expected one, or its name"):
        load(str(with_sidecar(path, SPEC)))
    with pytest.raises(UserError, match="has no output 'far'; it has depth, normal"):
        load(str(with_sidecar(path, {**SPEC, "output": "far"})))
    assert metres(with_sidecar(path, {**SPEC, "output": "depth"}), picture(0)) == pytest.approx(2)


@pytest.mark.parametrize(
    ("shape", "fields", "part"),
    [
        (("n", 3, "h", "w"), {}, "expected a fixed size, or width and height (or short_side)"),
        ((1, 3, 24, "w"), {"short_side": 24}, "expected a fixed size, or width and height"),
        ((1, 3, 24, 32), {"width": 24, "height": 24}, "expected 24x24 pixels as its sidecar says"),
        ((1, 4, 24, 32), {}, "expected 3 colour channels in layout nchw"),
        ((1, 3, 24, 32), {"layout": "nhwc"}, "expected 3 colour channels in layout nhwc"),
        ((2, 3, 24, 32), {}, "expected one image of shape (1, 3, h, w)"),
        ((1, 3, 24, 32), {"input": "image"}, "has no input 'image'; it has pixel_values"),
    ],
)
def test_files_that_do_not_fit_are_refused(
    tmp_path: Path, shape: tuple[Any, ...], fields: dict[str, Any], part: str
) -> None:
    path = with_sidecar(
        factories.depth_file(tmp_path / "n.onnx", shape=shape), {"unit": "m"} | fields
    )
    with pytest.raises(UserError) as caught:
        load(str(path))
    message = str(caught.value)
    assert part in message
    assert str(path) in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("fields", "part"),
    [
        (["m"], "expects a mapping of fields, at least unit"),
        ({}, "expects unit: one of m, cm, mm, 1/m, relative, relative-inverse"),
        ({"unit": "feet"}, "expects unit to be one of m, cm"),
        ({"unit": "m", "size": 3}, "expects only the fields unit, factor, width"),
        ({"unit": "m", "factor": 0}, "expects factor to be a number above 0, got 0"),
        ({"unit": "m", "factor": True}, "expects factor to be a number above 0, got True"),
        ({"unit": "m", "focal_px": float("nan")}, "expects focal_px to be a number above 0"),
        ({"unit": "m", "depth_error": 2}, "depth_error to be a number above 0 and at most 1"),
        ({"unit": "m", "width": 32}, "expects width and height together"),
        ({"unit": "m", "short_side": 1.5}, "short_side to be a whole number from 1 to 4096"),
        ({**SPEC, "short_side": 5}, "expects either width and height or short_side"),
        ({"unit": "m", "short_side": 4000}, "expects an input of at most 4194304 pixels"),
        ({"unit": "m", "mean": [1, 2]}, "expects mean to be one number or three, in RGB"),
        ({"unit": "m", "std": [1, 0, 1]}, "expects std to be one number above 0 or three"),
        ({"unit": "m", "output": 3}, "expects output to be a name, got 3"),
        ({"unit": "relative", "focal_px": 3}, "expects no focal_px with unit relative"),
    ],
)
def test_sidecars_that_say_nothing_usable_are_refused(fields: object, part: str) -> None:
    with pytest.raises(UserError) as caught:
        parse(fields, Path("n.yaml"))
    message = str(caught.value)
    assert message.startswith("n.yaml: depth expects")
    assert part in message
    assert "\n" not in message


def test_damaged_and_doubled_sidecars_are_named(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx")
    with pytest.raises(UserError, match=r"expected outputs of one of .*, or n\.yaml beside it"):
        load(str(path))
    path.with_suffix(".yaml").write_text("depth: {unit: [m\n")
    with pytest.raises(UserError, match=r"model card .*n\.yaml cannot be read") as caught:
        load(str(path))
    assert "\n" not in str(caught.value)
    path.with_suffix(".yaml").write_text("- depth\n")
    with pytest.raises(UserError, match="must be a YAML mapping, got list"):
        load(str(path))
    with_sidecar(path, SPEC)
    with_sidecar(path, SPEC, ".json")
    with pytest.raises(UserError, match=r"has n\.json and n\.yaml beside it; keep one"):
        load(str(path))


def test_a_sidecar_s_checksum_holds(tmp_path: Path) -> None:
    path = factories.depth_file(tmp_path / "n.onnx", offset=1.0)
    with_sidecar(path, SPEC, sha256=digest(path))
    assert metres(path, picture(0)) == pytest.approx(1.0)
    with_sidecar(path, SPEC, sha256="0" * 64)
    with pytest.raises(UserError, match="is damaged: its SHA-256 begins"):
        load(str(path))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(UserError, match="it is damaged or not an ONNX file"):
        load(str(with_sidecar(path, SPEC)))


def test_joined_with_a_floor_relative_depth_counts_as_depth(tmp_path: Path) -> None:
    door = factories.doornet(tmp_path / "door.onnx")
    srin = factories.cnn_srin(tmp_path / "srin.onnx")
    path = factories.depth_file(tmp_path / "n.onnx", offset=7.0)
    with_sidecar(path, {**SPEC, "unit": "relative-inverse"})
    joined = load(f"{door}+{path}", threads=1, needs=("p_open", "columns", "depth"))
    assert joined.gives == {"p_open", "columns", "depth", "floor"}
    seen = joined(picture(0), CAMERA)
    assert seen.depth_m is None  # doornet's is replaced
    assert seen.relative is not None
    assert seen.floor is not None
    # The other way round doornet's depth replaces it.
    other = load(f"{path}+{door}", threads=1)(picture(0), CAMERA)
    assert other.relative is None
    assert other.depth_m is not None
    with pytest.raises(CallError, match="returns depth without metres, which are needed here"):
        load(f"{srin}+{path}", threads=1, needs=("p_open", "depth"))
