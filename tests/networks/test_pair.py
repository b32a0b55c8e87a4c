"""The paper's pair of networks, alone and joined."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.networks import Joined
from doorway3ds.networks.cnn_srin import CnnSrin
from doorway3ds.networks.densedepth import PUBLISHED_ERROR, DenseDepth
from doorway3ds.networks.doornet import DoorNet
from tests import factories

CAMERA = Camera("test", 640, 480, 500.0, 500.0, 319.5, 239.5)


def picture(red: int) -> np.ndarray:
    image = np.zeros((480, 640, 3), np.uint8)
    image[..., 0] = red
    return image


@pytest.mark.parametrize("channels_last", [True, False])
def test_cnn_srin_gets_rgb_0_to_255(tmp_path: Path, channels_last: bool) -> None:
    net = CnnSrin(factories.cnn_srin(tmp_path / "n.onnx", channels_last=channels_last), threads=1)
    perception = net(picture(51), CAMERA)
    assert perception.p_open == pytest.approx(0.2)
    assert perception.depth_m is None
    assert perception.columns is None


def test_cnn_srin_without_its_logistic_unit_is_refused(tmp_path: Path) -> None:
    net = CnnSrin(factories.cnn_srin(tmp_path / "n.onnx", scale=1.0), threads=1)
    with pytest.raises(UserError, match="expected 'p_open' to be one probability"):
        net(picture(51), CAMERA)


@pytest.mark.parametrize("channels_last", [True, False])
@pytest.mark.parametrize(
    ("red", "metres"),
    [(255, 1.0), (102, 2.5), (51, 5.0), (0, 10.0)],  # raw = 10 * red / 255 = 10 m / depth
)
def test_densedepth_in_metres(tmp_path: Path, channels_last: bool, red: int, metres: float) -> None:
    path = factories.densedepth(tmp_path / "n.onnx", channels_last=channels_last)
    perception = DenseDepth(path, threads=1)(picture(red), CAMERA)
    depth = perception.depth_m
    assert depth is not None
    assert depth.shape == (240, 320)
    assert depth.dtype == np.float32
    assert depth == pytest.approx(metres, rel=1e-5)
    assert math.isnan(perception.p_open)
    assert perception.depth_error == PUBLISHED_ERROR


@pytest.mark.parametrize(("gain", "metres"), [(1000.0, 0.1), (-5.0, 10.0), (0.5, 10.0)])
def test_densedepth_is_clipped(tmp_path: Path, gain: float, metres: float) -> None:
    depth = DenseDepth(factories.densedepth(tmp_path / "n.onnx", gain=gain), threads=1)(
        picture(255), CAMERA
    ).depth_m
    assert depth == pytest.approx(metres)


def test_signatures_are_not_mixed_up(tmp_path: Path) -> None:
    path = factories.densedepth(tmp_path / "n.onnx")
    with pytest.raises(UserError, match="another signature: expected one float32 input"):
        CnnSrin(path, threads=1)


def test_joined_takes_each_from_the_last_that_gives_it(tmp_path: Path) -> None:
    classifier = CnnSrin(factories.cnn_srin(tmp_path / "c.onnx"), threads=1)
    depth = DenseDepth(factories.densedepth(tmp_path / "d.onnx"), threads=1)
    door = DoorNet(factories.doornet(tmp_path / "n.onnx"), threads=1)
    pair = Joined([classifier, depth])
    assert pair.name == "cnn-srin+densedepth"
    assert pair.gives == {"p_open", "depth"}
    perception = pair(picture(51), CAMERA)
    assert perception.p_open == pytest.approx(0.2)
    assert perception.depth_m == pytest.approx(5.0, rel=1e-5)
    assert perception.columns is None
    assert set(perception.timings_ms) == {"prepare", "network"}

    mixed = Joined([door, depth])(picture(51), CAMERA)
    assert mixed.p_open == pytest.approx(1 / (1 + math.exp(-3)))
    assert mixed.columns is not None
    assert mixed.depth_m == pytest.approx(5.0, rel=1e-5)
    assert mixed.depth_error == PUBLISHED_ERROR
    assert mixed.floor is not None


def test_joining_nothing_is_a_programming_error() -> None:
    with pytest.raises(ValueError, match="at least one network"):
        Joined([])
