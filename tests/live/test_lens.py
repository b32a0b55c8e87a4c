"""A wrong focal length noticed while a camera is watched."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.images.codec import read_image
from doorway3ds.live.lens import LensWatch
from doorway3ds.types import Frame

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize(("fov_deg", "lines"), [(75.0, 1), (56.3, 0)])  # 56.3: the true one
def test_it_tells_once_of_a_wrong_field_of_view(fov_deg, lines):
    told: list[str] = []
    watch = LensWatch(told.append, every_s=0)
    image = read_image(EXAMPLES / "doorway.jpg").image
    while not watch.done:
        watch.offer(Frame(image, Camera.from_fov(640, 480, fov_deg)))
        time.sleep(0.01)
    assert len(told) == lines
