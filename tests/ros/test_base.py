"""A base turned over its odometry, without a bus: a body in a thread that does as it is told."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from doorway3ds.robots.base import Driver, Limits, Refused, RobotLost, TurnEnd
from doorway3ds.ros.base import BaseRobot, Odometry


class Body:
    """Follows its speed after a short lag, and reports its heading at 100 Hz."""

    def __init__(self) -> None:
        self.odometry, self.sent = Odometry(), [0.0]
        self.heading = math.radians(170)  # a turn to the left passes +-180 degrees
        self.speed, self.mute, self.running = 0.0, False, True
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        last_s = time.monotonic()
        while self.running:
            time.sleep(0.01)
            now = time.monotonic()
            self.speed += (self.sent[-1] - self.speed) * min(1.0, (now - last_s) / 0.05)
            self.heading += self.speed * (now - last_s)
            last_s = now
            if not self.mute:
                self.report(self.heading)

    def report(self, heading: float) -> None:
        half = heading / 2
        turned = SimpleNamespace(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
        at = SimpleNamespace(x=1.0, y=2.0, z=0.0)
        pose = SimpleNamespace(orientation=turned, position=at)
        self.odometry.update(SimpleNamespace(pose=SimpleNamespace(pose=pose)))


@pytest.fixture
def body() -> Iterator[Body]:
    found = Body()
    while found.odometry.pose(1.0) is None:
        time.sleep(0.01)
    yield found
    found.running = False
    found.thread.join()


def base(body: Body, **options: Any) -> BaseRobot:
    eyes = options.pop("eyes", lambda: None)
    return BaseRobot(body.odometry, body.sent.append, eyes, odometry_s=0.3, **options)


def later(seconds: float, act: Any) -> None:
    threading.Timer(seconds, act).start()


@pytest.mark.parametrize("asked_deg", [25.0, -25.0, 2.0])
def test_it_arrives_and_stands(body: Body, asked_deg: float) -> None:
    begun = body.heading
    result = base(body, speed_rad_s=1.5).turn(asked_deg, 10.0)
    assert (result.end, result.asked_deg) == (TurnEnd.DONE, asked_deg)
    assert math.degrees(body.heading - begun) == pytest.approx(asked_deg, abs=1.5)
    assert result.turned_deg == pytest.approx(math.degrees(body.heading - begun), abs=0.5)
    assert body.sent[-1] == 0 and max(abs(one) for one in body.sent) <= 1.5


def test_without_odometry_nothing_is_sent(body: Body) -> None:
    body.mute = True
    time.sleep(0.4)
    with pytest.raises(RobotLost, match=r"no odometry came within 0\.3 s"):
        base(body).turn(20.0, 10.0)
    assert body.sent == [0.0]


@pytest.mark.parametrize(
    ("event", "end", "why"),
    [
        ("mute", TurnEnd.LOST, "no odometry comes"),
        ("jump", TurnEnd.LOST, "the odometry jumps by 9"),  # 90 deg, and what it turned meanwhile
        ("blind", TurnEnd.LOST, "no image"),
        ("stop", TurnEnd.STOPPED, "it was stopped"),
        ("close", TurnEnd.STOPPED, "it was stopped"),
        ("slow", TurnEnd.TIMEOUT, "it took more than 1 s"),
    ],
)
def test_what_ends_a_turn_ends_it_with_zero(body: Body, event: str, end: TurnEnd, why: str) -> None:
    blind: list[str] = []
    robot = base(body, speed_rad_s=0.2, eyes=lambda: blind[0] if blind else None)

    def jump() -> None:
        body.heading += math.pi / 2

    happens = {
        "mute": lambda: setattr(body, "mute", True), "jump": jump, "stop": robot.stop,
        "blind": lambda: blind.append("no image for 1.0 s"), "close": robot.close,
        "slow": lambda: None,
    }  # fmt: skip
    later(0.2, happens[event])
    result = robot.turn(60.0, 1.0 if event == "slow" else 10.0)
    assert result.end is end and why in robot.why
    assert any(body.sent) and body.sent[-1] == 0
    assert result.took_s < 2.0


def test_nothing_follows_the_last_zero(body: Body) -> None:
    robot = base(body)
    robot.close()
    robot.close()
    count = len(body.sent)
    assert robot.turn(20.0, 1.0).end is TurnEnd.STOPPED
    robot.stop()
    assert len(body.sent) == count and body.sent[-1] == 0


def test_the_gate_holds_for_a_base(body: Body) -> None:
    robot = base(body)
    driver = Driver(robot, move=True, limits=Limits(ttl_s=0.5))
    with pytest.raises(Refused, match="s old"):
        driver.turn(10.0, time.monotonic() - 1.0)
    with pytest.raises(Refused, match="60 deg"):
        driver.turn(90.0, time.monotonic())
    assert Driver(robot).turn(10.0, time.monotonic()).end is TurnEnd.DRY
    assert body.sent == [0.0]
