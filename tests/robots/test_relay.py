"""Decisions handed from who watches to a loop that acts."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest

from doorway3ds.robots import Driver, DryRobot
from doorway3ds.robots.loop import Outcome, TurnLoop
from doorway3ds.robots.relay import Relay
from doorway3ds.sources import SourceLost
from doorway3ds.types import Decision
from tests.live.test_tracker import look, opening


def decided(stamp_s: float) -> Decision:
    made = look(stamp_s, opening(20))
    return replace(made, frame=replace(made.frame, stamp_s=stamp_s))


def test_the_newest_decision_is_given_once_and_older_ones_never() -> None:
    relay = Relay()
    for stamp in (1.0, 2.0, 3.0):
        relay.offer(decided(stamp))
    frame = relay.read(1)
    assert frame is not None and frame.stamp_s == 3.0
    made = relay.decide(frame, None)
    assert made.frame is frame and relay.perception(frame) is made.perception
    assert relay.read(0.01) is None
    with pytest.raises(ValueError, match="another"):
        relay.decide(decided(3.0).frame, None)


def test_who_waits_is_woken() -> None:
    relay = Relay()
    later = threading.Timer(0.05, lambda: relay.offer(decided(1.0)))
    later.start()
    frame = relay.read(5)
    assert frame is not None and frame.stamp_s == 1.0
    later.join()


def test_the_last_decision_outlives_its_watcher() -> None:
    relay = Relay()
    relay.offer(decided(1.0))
    relay.end()
    assert not relay.ended
    assert relay.read(1) is not None
    assert relay.ended and relay.read(1) is None


def test_a_watcher_that_lost_its_camera_ends_the_loop_as_lost_and_a_bug_stops_the_robot() -> None:
    class Robot(DryRobot):
        stops = 0

        def stop(self) -> None:
            self.stops += 1

    robot, relay = Robot(), Relay()
    relay.end(SourceLost("the camera is gone"))
    report = TurnLoop(relay, relay.decide, Driver(robot, move=True)).run()
    assert report.outcome is Outcome.LOST and robot.stops == 1
    relay.end(ZeroDivisionError("a bug"))
    with pytest.raises(ZeroDivisionError):
        TurnLoop(relay, relay.decide, Driver(robot, move=True)).run()
    assert robot.stops == 2
