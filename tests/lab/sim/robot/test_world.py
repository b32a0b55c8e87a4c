"""A robot in a drawn home: what it sees indoors, outdoors and by depth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Pose
from doorway3ds.lab.sim.render.renderer import Eye
from doorway3ds.lab.sim.robot.body import FastClock, Gait
from doorway3ds.lab.sim.stages.scenarios import Stage
from tests.lab.sim.conftest import doorway, two_rooms

pytestmark = pytest.mark.sim
SIZE = (160, 120)


@pytest.fixture
def studio(gl: Any) -> Iterator[Any]:
    from doorway3ds.lab.sim.robot.world import Studio

    with Studio(SIZE, plain=True) as made:
        yield made


def world(studio: Any, x: float, y: float, heading_deg: float, model: str = "nao") -> Any:
    from doorway3ds.lab.sim.robot.world import World

    stage = Stage("doorway", 0, two_rooms(doorway()), Eye(x, y, heading_deg, Pose(height_m=0.5)))
    return World(
        studio, stage, model=model, clock=FastClock(), gait=Gait(slip=0, slip_deg=0), noise=False
    )


def test_outdoors_there_is_an_image_without_doorways(studio: Any) -> None:
    robot = world(studio, -3.0, 2.5, 0.0)
    shot = robot.shot(*SIZE)
    assert (shot.rgb.shape, shot.truth.openings) == ((120, 160, 3), ())
    assert 2.5 < np.nanmin(shot.depth) < 3.1  # the house's wall
    assert robot.picture("CameraTop", *SIZE).std() > 1


def test_it_sees_the_doorway_walks_through_and_is_stopped_by_the_far_wall(studio: Any) -> None:
    robot = world(studio, 2.5, 2.5, 0.0)
    assert len(robot.shot(*SIZE).truth.openings) == 1
    body = robot.body
    assert not body.wait(body.begin(9.0, 0.0, 0.0))
    assert 4.5 < body.place()[0] < 8.0
    assert body.touch_deg is not None
    assert body.sonar("Sonar/Left", 2.55) < 0.5
    assert robot.shot(*SIZE).rgb.shape == (120, 160, 3)


def test_peppers_depth_agrees_with_its_picture(studio: Any) -> None:
    robot = world(studio, 1.0, 1.0, 0.0, "pepper")
    depth = robot.depth("CameraDepth", *SIZE)
    assert depth.shape == (120, 160)
    lens = robot.eye("CameraDepth").lens()
    ahead = float(depth[depth.shape[0] // 2, depth.shape[1] // 2])
    assert ahead <= 4.0 - 0.06 - lens[0] + 0.01
    assert math.isfinite(ahead)
