"""doornet's answers lie where the picture's pixels are, in the camera's metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.networks.doornet import DoorNet, place, prepare
from tests import factories


def camera(width: int, height: int, fx: float = 500.0) -> Camera:
    return Camera("test", width, height, fx, fx, (width - 1) / 2, (height - 1) / 2)


@pytest.fixture(scope="module")
def net(tmp_path_factory: pytest.TempPathFactory) -> DoorNet:
    return DoorNet(factories.doornet(tmp_path_factory.mktemp("net") / "net.onnx"), threads=1)


@pytest.mark.parametrize(
    ("size", "expected"),
    [
        ((640, 480), (256, 192)),
        ((480, 640), (192, 256)),
        ((1920, 1080), (288, 160)),
        ((416, 416), (224, 224)),
        ((2000, 1000), (320, 160)),
    ],
)
def test_input_size_follows_the_aspect(size: tuple[int, int], expected: tuple[int, int]) -> None:
    at = place(*size)
    assert (at.width, at.height) == expected
    assert (at.content_width, at.content_height, at.left, at.top) == (*expected, 0, 0)


@given(width=st.integers(1, 20000), height=st.integers(1, 20000))
def test_placement_is_sound_for_any_picture(width: int, height: int) -> None:
    at = place(width, height)
    assert at.width % 32 == at.height % 32 == 0
    assert 0.8 < at.width * at.height / (192 * 256) < 1.25
    assert 0 <= at.left <= at.left + at.content_width <= at.width
    assert 0 <= at.top <= at.top + at.content_height <= at.height
    assert at.content_width >= 1
    assert at.content_height >= 1
    mirrored = place(height, width)
    assert (mirrored.width, mirrored.height) == (at.height, at.width)


def test_padding_repeats_the_edge() -> None:
    image = np.zeros((10, 100, 3), np.uint8)
    image[:5] = (10, 20, 30)
    at = place(100, 10)
    tensor = prepare(image, at)
    assert tensor.shape == (1, 3, 160, 320)
    assert tensor[0, :, 0, 0].tolist() == [10, 20, 30]
    assert tensor[0, :, -1, 0].tolist() == [0, 0, 0]
    assert at.content_height == 32


def test_perception_of_a_4_to_3_picture(net: DoorNet) -> None:
    perception = net(np.zeros((480, 640, 3), np.uint8), camera(640, 480))
    assert perception.p_open == pytest.approx(1 / (1 + np.exp(-3.0)))
    assert perception.network == "doornet"
    assert perception.depth_error == 0.1
    assert set(perception.timings_ms) == {"prepare", "network"}
    votes = perception.columns
    assert votes is not None
    best = int(np.argmax(votes.score))
    assert votes.score[best] == pytest.approx(1 / (1 + np.exp(-4.0)))
    assert votes.left_px[best] == pytest.approx(0.4 * 640 - 0.5, abs=1e-3)
    assert votes.right_px[best] == pytest.approx(0.6 * 640 - 0.5, abs=1e-3)
    floor = perception.floor
    assert floor is not None
    assert floor[0].max() < 0.02
    assert floor[-1].min() > 0.98


@pytest.mark.parametrize("fx", [250.0, 500.0, 1000.0])
@pytest.mark.parametrize("scale", [1, 2])
def test_depth_follows_the_focal_length_not_the_size(net: DoorNet, fx: float, scale: int) -> None:
    image = np.full((480 * scale, 640 * scale, 3), 200, np.uint8)
    depth = net(image, camera(640 * scale, 480 * scale, fx * scale)).depth_m
    assert depth is not None
    # 1 + 200 / 100 m for a focal length of 200 px at 256 columns
    assert depth == pytest.approx(3.0 * fx * (256 / 640) / 200.0, rel=1e-5)


def test_wide_pictures_lose_only_the_padding(net: DoorNet) -> None:
    image = np.zeros((100, 1000, 3), np.uint8)
    image[:50] = 100
    perception = net(image, camera(1000, 100))
    assert perception.depth_m is not None
    assert perception.depth_m.shape == (8, 80)  # 32 of 160 rows at a quarter of the size
    assert perception.depth_m[0, 0] == pytest.approx(2 * perception.depth_m[-1, 0])
    assert perception.columns is not None
    assert perception.columns.left_px.max() == pytest.approx(399.5)


def test_tall_pictures_keep_columns_in_the_picture(net: DoorNet) -> None:
    # The tiny network answers for the padded input of 160 columns, 32 of which are the picture:
    # its door from 40 % to 60 % is then the whole picture's width.
    votes = net(np.zeros((1000, 100, 3), np.uint8), camera(100, 1000)).columns
    assert votes is not None
    assert votes.score.min() > 0.5
    assert votes.left_px == pytest.approx(-0.5, abs=1e-3)
    assert votes.right_px == pytest.approx(99.5, abs=1e-3)


@pytest.mark.parametrize("size", [(1, 1), (1, 900), (900, 1), (33, 47)])
def test_any_size(net: DoorNet, size: tuple[int, int]) -> None:
    width, height = size
    perception = net(np.zeros((height, width, 3), np.uint8), camera(width, height))
    assert perception.depth_m is not None
    assert min(perception.depth_m.shape) >= 1


def test_same_picture_same_answer(net: DoorNet) -> None:
    image = np.random.default_rng(3).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    first, second = (net(image, camera(640, 480)).depth_m for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.tobytes() == second.tobytes()


def test_depth_that_cannot_be_is_unknown(tmp_path: Path) -> None:
    net = DoorNet(factories.doornet(tmp_path / "net.onnx", nearest=-1.0), threads=1)
    image = np.zeros((480, 640, 3), np.uint8)
    image[240:] = 200
    depth = net(image, camera(640, 480)).depth_m
    assert depth is not None
    assert np.isnan(depth[0]).all()
    assert (depth[-1] > 0).all()


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"drop": "floor"}, "expected one float32 input"),
        ({"input_name": "x"}, 'got input "x"'),
        ({"metadata": {}}, "canonical_f_px > 0"),
        ({"metadata": {"canonical_f_px": 0, "depth_error": 0}}, "canonical_f_px > 0"),
        ({"metadata": {"canonical_f_px": "a", "depth_error": 0}}, "canonical_f_px > 0"),
    ],
)
def test_another_signature_is_refused(tmp_path: Path, change: dict[str, object], part: str) -> None:
    path = factories.doornet(tmp_path / "net.onnx", **change)
    with pytest.raises(UserError, match="has another signature") as caught:
        DoorNet(path, threads=1)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_values_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    net = DoorNet(factories.doornet(tmp_path / "net.onnx", p_open=float("nan")), threads=1)
    with pytest.raises(UserError, match="not finite in 'p_open'"):
        net(np.zeros((48, 64, 3), np.uint8), camera(64, 48))


def test_p_open_is_weighed_by_the_costs_of_its_file(tmp_path: Path, net: DoorNet) -> None:
    image, lens = np.full((48, 64, 3), 90, np.uint8), camera(64, 48)
    costs = {"missed": 1.5, "false_near": 4.0, "near_m": 1e6, "far_m": 2e6}  # all is near
    told = factories.METADATA | {"costs": costs}
    other = DoorNet(factories.doornet(tmp_path / "costs.onnx", metadata=told), threads=1)
    plain, weighed = net(image, lens).p_open, other(image, lens).p_open
    assert 0.001 < plain < 0.999
    assert weighed / (1 - weighed) == pytest.approx(plain / (1 - plain) / 4)


@pytest.mark.parametrize(
    ("costs", "message"),
    [
        ({"bumped": 2.0}, "no limit 'bumped'"),
        ({"missed": None}, "costs must be above 0"),
        ({"missed": "much"}, "limit 'missed' must be a number"),
        ([1.5, 3.0], "Costs must be an object of limits"),
    ],
)
def test_costs_that_make_no_sense_are_named(tmp_path: Path, costs: object, message: str) -> None:
    told = factories.METADATA | {"costs": costs}
    with pytest.raises(UserError, match=message):
        DoorNet(factories.doornet(tmp_path / "costs.onnx", metadata=told), threads=1)
