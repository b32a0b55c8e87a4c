"""No motion without permission, beyond the limits, or on an old decision."""

import math

import pytest

from doorway3ds.robots import Driver, DryRobot, Limits, Refused, TurnEnd, TurnResult


class Recorder(DryRobot):
    """Turns exactly and remembers."""

    def __init__(self, end: TurnEnd = TurnEnd.DONE) -> None:
        self.turned: list[float] = []
        self.stopped = self.prepared = 0
        self.end = end

    def prepare(self) -> None:
        self.prepared += 1

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        self.turned.append(theta_deg)
        return TurnResult(theta_deg, theta_deg, self.end, 0.1)

    def stop(self) -> None:
        self.stopped += 1


def driver(robot: Recorder, move: bool = True, now: float = 100.0, **limits: float) -> Driver:
    return Driver(robot, move=move, limits=Limits(**limits), clock=lambda: now)  # type: ignore[arg-type]


def test_without_permission_nothing_reaches_the_robot() -> None:
    robot = Recorder()
    gate = driver(robot, move=False)
    gate.prepare()
    assert gate.turn(20.0, 100.0).end is TurnEnd.DRY
    gate.stop()
    assert (robot.turned, robot.prepared, robot.stopped) == ([], 0, 0)


@pytest.mark.parametrize("theta", [60.1, -61.0, math.nan, math.inf])
def test_no_turn_beyond_the_limit(theta: float) -> None:
    robot = Recorder()
    with pytest.raises(Refused):
        driver(robot).turn(theta, 100.0)
    assert robot.turned == []


@pytest.mark.parametrize(("stamp", "allowed"), [(98.1, True), (97.9, False), (100.5, False)])
def test_no_turn_on_a_decision_older_than_its_time_to_live(stamp: float, allowed: bool) -> None:
    robot = Recorder()
    gate = driver(robot, ttl_s=2.0)
    if allowed:
        gate.turn(10.0, stamp)
    else:
        with pytest.raises(Refused, match="old"):
            gate.turn(10.0, stamp)
    assert bool(robot.turned) is allowed


def test_a_run_has_an_end() -> None:
    robot = Recorder()
    gate = driver(robot, max_turns=2)
    gate.turn(5.0, 100.0)
    gate.turn(5.0, 100.0)
    with pytest.raises(Refused, match="2 times"):
        gate.turn(5.0, 100.0)
    gate = driver(robot, max_total_deg=70.0)
    gate.turn(-50.0, 100.0)
    with pytest.raises(Refused, match="limits"):
        gate.turn(30.0, 100.0)


@pytest.mark.parametrize("end", [TurnEnd.BUMPER, TurnEnd.FALLEN, TurnEnd.LIFTED])
def test_after_a_fall_or_bump_nothing_moves_again(end: TurnEnd) -> None:
    robot = Recorder(end)
    gate = driver(robot)
    gate.turn(5.0, 100.0)
    with pytest.raises(Refused, match="halted"):
        gate.turn(5.0, 100.0)
    assert robot.turned == [5.0]


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_limits_are_positive(value: float) -> None:
    with pytest.raises(ValueError, match="positive"):
        Limits(ttl_s=value)
