"""Looks on demand: by a session itself, or handed on by a thread that watches."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.live.eyes import Relay, Update
from doorway3ds.live.session import Session
from doorway3ds.live.tracker import Tracked
from doorway3ds.robots import Driver, DryRobot
from doorway3ds.robots.loop import Outcome, TurnLoop
from doorway3ds.sources import SourceLost
from doorway3ds.types import Perception
from tests.live.test_session import Door, Script
from tests.live.test_tracker import look, opening


def update(stamp_s: float) -> Update:
    made = look(stamp_s, opening(20))
    made = replace(made, frame=replace(made.frame, stamp_s=stamp_s))
    return Update(1, "x", Tracked(made, made, made.p_open))


@pytest.fixture
def relay() -> Relay:
    return Relay(Pipeline(Door()))


def test_the_newest_decision_is_given_once_and_older_ones_never(relay: Relay) -> None:
    for stamp in (1.0, 2.0, 3.0):
        relay.offer(update(stamp))
    made = relay.look(2.5, 1)
    assert made is not None and made.frame.stamp_s == 3.0
    assert relay.look(2.5, 0.01) is None


def test_a_decision_from_before_the_last_motion_is_left_out(relay: Relay) -> None:
    relay.offer(update(1.0))
    assert relay.look(1.5, 0.05) is None
    relay.offer(update(2.0))
    made = relay.look(1.5, 1)
    assert made is not None and made.frame.stamp_s == 2.0


def test_who_waits_is_woken(relay: Relay) -> None:
    later = threading.Timer(0.05, lambda: relay.offer(update(1.0)))
    later.start()
    made = relay.look(0.0, 5)
    assert made is not None and made.frame.stamp_s == 1.0
    later.join()


def test_the_last_decision_outlives_its_watcher(relay: Relay) -> None:
    relay.offer(update(1.0))
    relay.end()
    assert not relay.ended
    assert relay.look(0.0, 1) is not None
    assert relay.ended and relay.look(0.0, 1) is None


def test_a_watcher_that_lost_its_camera_ends_the_loop_as_lost_and_a_bug_stops_the_robot(
    relay: Relay,
) -> None:
    class Robot(DryRobot):
        stops = 0

        def stop(self) -> None:
            self.stops += 1

    robot = Robot()
    relay.end(SourceLost("the camera is gone"))
    report = TurnLoop(relay, Driver(robot, move=True)).run()
    assert report.outcome is Outcome.LOST and robot.stops == 1
    relay.end(ZeroDivisionError("a bug"))
    with pytest.raises(ZeroDivisionError):
        TurnLoop(relay, Driver(robot, move=True)).run()
    assert robot.stops == 2


def test_a_session_looks_when_it_is_asked_and_shows_the_network_no_older_frame() -> None:
    class Counted(Door):
        asked = 0

        def __call__(self, image: Any, camera: Camera) -> Perception:
            self.asked += 1
            return super().__call__(image, camera)

    door, source = Counted(), Script(8)
    with Session(source, Pipeline(door), ahead=0) as session:
        assert source.given == 0
        first, later = session.look(0.0, 5), session.look(0.35, 5)
    assert first is not None and later is not None
    assert (first.frame.stamp_s, later.frame.stamp_s) == (0.1, 0.4)
    assert door.asked == 2
