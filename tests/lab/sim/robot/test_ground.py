"""Walls that stop a robot and that its sonars hear."""

from __future__ import annotations

import math

import numpy as np
import pytest

from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.robot.body import Body, FastClock, Gait
from doorway3ds.lab.sim.robot.ground import Ground
from doorway3ds.lab.sim.robot.model import MODELS
from tests.lab.sim.conftest import bare, doorway, two_rooms

WALL_X = 4.0 - 0.06
RADIUS = MODELS["nao"].radius_m


def body(x: float, y: float, heading_deg: float = 0.0, **door: object) -> Body:
    portal = doorway(**door)  # type: ignore[arg-type]
    ground = Ground(lambda: Plan(bare(two_rooms(portal))))
    return Body(x, y, heading_deg, clock=FastClock(), gait=Gait(slip=0, slip_deg=0), ground=ground)


def test_it_stops_at_a_wall_and_knows_where_it_touched_it() -> None:
    robot = body(3.0, 1.0)
    assert not robot.wait(robot.begin(3.0, 0.0, 0.0))
    assert robot.place()[0] == pytest.approx(WALL_X - RADIUS, abs=0.03)
    assert robot.odometry()[0] == pytest.approx(robot.place()[0] - 3.0)
    assert robot.touch_deg == pytest.approx(0.0, abs=10)
    assert not robot.moving


def test_it_walks_through_an_open_door_and_not_through_a_closed_one() -> None:
    through = body(3.0, 2.5)
    assert through.wait(through.begin(2.0, 0.0, 0.0))
    assert through.place()[0] == pytest.approx(5.0)
    shut = body(3.0, 2.5, state="closed")
    assert not shut.wait(shut.begin(2.0, 0.0, 0.0))
    assert shut.place()[0] < 4.0


def test_it_walks_to_no_garden() -> None:
    robot = body(1.0, 1.0, 180.0)
    assert not robot.wait(robot.begin(5.0, 0.0, 0.0))
    assert robot.place()[0] > 0


def test_it_turns_and_walks_away_from_what_it_touches() -> None:
    robot = body(3.0, 1.0)
    robot.wait(robot.begin(3.0, 0.0, 0.0))
    assert robot.wait(robot.begin(0.0, 0.0, math.pi))
    assert robot.touch_deg is not None  # it has not left it yet
    assert robot.wait(robot.begin(0.5, 0.0, 0.0))
    assert robot.touch_deg is None


@pytest.mark.parametrize(("heading", "side"), [(40.0, -1), (-40.0, 1)])
def test_what_it_walks_into_at_a_slant_is_on_its_side(heading: float, side: int) -> None:
    robot = body(3.4, 1.2 if heading > 0 else 4.0, heading)
    assert not robot.wait(robot.begin(2.0, 0.0, 0.0))
    assert robot.touch_deg is not None
    assert 20 < side * robot.touch_deg < 60


def test_a_walk_without_an_end_bends_and_stops_by_itself() -> None:
    robot = body(2.0, 1.2)
    robot.begin(4.0, 0.0, math.pi, arc=True)  # half a circle of 1.27 m radius
    robot.clock.sleep(10.0)
    x, y, heading = robot.place()
    along = math.radians(heading)
    assert (x, y) == pytest.approx(
        (2.0 + 4 / math.pi * math.sin(along), 1.2 + 4 / math.pi * (1 - math.cos(along)))
    )
    robot.clock.sleep(60.0)
    assert robot.touch_deg is None
    assert robot.place()[2] == pytest.approx(180.0)


@pytest.mark.parametrize(("x", "left", "right"), [(3.0, 0.93, 0.93), (1.0, 2.55, 1.17)])
def test_sonars_hear_the_nearest_wall_in_their_cone(x: float, left: float, right: float) -> None:
    """Ahead stands the wall at x = 4; from x = 1 only the right one hears the wall at y = 0."""
    robot = body(x, 1.0)
    heard = [robot.sonar(part, 2.55) for part in MODELS["nao"].sonars.values()]
    assert heard == pytest.approx([left, right], abs=0.05)


def test_beyond_the_plan_all_is_free() -> None:
    ground = Ground(lambda: Plan(bare(two_rooms())))
    assert np.all(ground.gap(np.array([[50.0, 50.0], [-9.0, 1.0]])) > 5)
    assert ground.range(50.0, 50.0, 0.0, 3.0) == 3.0
