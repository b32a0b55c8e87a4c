"""A wrong focal length noticed while a camera is watched."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.images.codec import read_image
from doorway3ds.live.lens import LensWatch
from doorway3ds.live.session import Session
from doorway3ds.sources import Source
from doorway3ds.types import Frame
from tests.live.test_session import Door

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


def test_each_camera_of_a_source_is_checked_once_and_an_assumed_one_never():
    told: list[str] = []
    watch = LensWatch(told.append, every_s=0)
    image = read_image(EXAMPLES / "doorway.jpg").image
    assumed = Camera.from_fov(640, 480, 75)
    watch.offer(Frame(image, replace(assumed, assumed=True)))
    assert not watch.done and watch.doubt is None
    for fov_deg in (75.0, 80.0, 75.0):
        frame = Frame(image, Camera.from_fov(640, 480, fov_deg, name=f"{fov_deg:g}"))
        watch.offer(frame)
        while not watch.done:
            watch.offer(frame)
            time.sleep(0.01)
        assert watch.doubt is not None and watch.doubt.startswith(f"{fov_deg:g} has")
    assert [line.split()[0] for line in told] == ["75", "80"]


def test_a_session_tells_its_source_whoever_reads_it():
    """`3ds live`, `run`, `serve` and the ROS node all read a session."""
    image = read_image(EXAMPLES / "doorway.jpg").image
    for fov_deg, lines in ((75.0, 1), (56.3, 0)):
        source = Endless(image, Camera.from_fov(640, 480, fov_deg))
        told: list[str] = []
        source.notice = told.append
        with Session(source, Pipeline(Door()), ahead=0) as session:
            session._lens._every_s = 0  # type: ignore[union-attr]
            while not session._lens.done:  # type: ignore[union-attr]
                session.read(1)
                time.sleep(0.01)  # a loop that never rests would keep Python's lock from the check
            assert (session.doubt is not None) == bool(lines)
        assert len(told) == lines


class Endless(Source):
    """One image for ever."""

    def __init__(self, image: np.ndarray, camera: Camera) -> None:
        super().__init__("endless")
        self.image, self.camera, self.count = image, camera, 0

    def read(self, timeout_s: float | None = None) -> Frame | None:
        self.count += 1
        return Frame(self.image, self.camera, stamp_s=self.count / 10)

    def close(self) -> None:
        self.ended = True
