"""Robots whose answers are of no use: null, other types, other colour spaces, no transform."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from doorway3ds.errors import UserError
from doorway3ds.robots.base import RobotError
from doorway3ds.robots.nao.camera import NaoCapture
from doorway3ds.robots.nao.format import camera_of
from doorway3ds.robots.nao.robot import NaoRobot
from doorway3ds.sources import open_source

pytestmark = pytest.mark.nao


class Odd:
    """A robot's services with answers of no use."""

    def __init__(self, **answers: Any) -> None:
        self._answers = answers

    def getSubscribers(self) -> Any:
        return self._answers.get("held", [])

    def subscribeCamera(self, *asked: Any) -> Any:
        return self._answers.get("handle", "odd_0")

    def unsubscribe(self, handle: str) -> bool:
        return True

    def releaseImage(self, handle: str) -> bool:
        return True

    def getImageRemote(self, handle: str) -> Any:
        return self._answers.get("image")

    def getTransform(self, *asked: Any) -> Any:
        level = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.5, 0, 0, 0, 1]
        return self._answers.get("transform", [float(v) for v in level])

    def getAngles(self, *asked: Any) -> Any:
        return self._answers.get("angles")

    def getRobotPosition(self, *asked: Any) -> Any:
        return self._answers.get("position")

    def subscriber(self, name: str) -> Any:
        import qi

        class Subscriber:
            def __init__(self) -> None:
                self.signal = qi.Signal("(m)")

        return Subscriber()


@pytest.fixture
def odd() -> Iterator[Callable[..., str]]:
    """Starts robots that answer oddly: odd(handle=...) -> "127.0.0.1:port"."""
    qi = pytest.importorskip("qi")
    sessions = []

    def start(**answers: Any) -> str:
        session = qi.Session()
        session.listenStandalone("tcp://127.0.0.1:0")
        for name in ("ALVideoDevice", "ALMotion", "ALMemory", "ALRobotPosture"):
            session.registerService(name, Odd(**answers))
        sessions.append(session)
        return str(session.endpoints()[0]).removeprefix("tcp://")

    yield start
    for session in sessions:
        session.close()


GOOD = [4, 2, 3, 11, 1, 0, "24 letters, no bytes here", 0, 0.5, 0.4, -0.5, -0.4]
HOPELESS = float("nan")


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ({"handle": ""}, "refused camera 0"),
        ({"handle": None}, "refused camera 0"),
        ({"handle": 7}, "refused camera 0"),
        ({}, "answers null instead of an image"),
        ({"image": [1, 2]}, "container of 12 fields, got 2"),
        ({"image": "x"}, "container of 12 fields, got str"),
        ({"image": GOOD}, "expected an image's bytes, got str"),
        ({"image": [*GOOD[:3], 10, *GOOD[4:]]}, "rgb .11., .*got colour space 10"),
        ({"image": [None, *GOOD[1:]]}, "got None among them"),
        ({"transform": None}, "transform: expected 16 numbers, got nothing"),
        ({"transform": []}, "transform: expected 16 numbers, got 0"),
        ({"transform": [0.0] * 16}, "expected a rotation"),
        ({"transform": [HOPELESS] * 16}, "got nan among them"),
    ],
)
def test_answers_of_no_use_are_the_last_thing_said(
    odd: Any, answers: dict[str, Any], said: str
) -> None:
    def look() -> None:
        with open_source(f"nao://{odd(**answers)}?fps=30", patience_s=1.6) as source:
            for _ in range(100):
                source.read(0.5)

    with pytest.raises(UserError, match=said):
        look()


@pytest.mark.parametrize("answer", [None, [], [0.1], ["x", 0.2], [HOPELESS, 0.0], 3])
def test_a_robot_that_says_no_angle_or_place_is_one_line(odd: Any, answer: Any) -> None:
    robot = NaoRobot(f"nao://{odd(angles=answer, position=answer)}")
    for ask in (lambda: robot.aim(0.0, 0.0), robot.pose):
        with pytest.raises(RobotError, match=r"ALMotion\.get\w+: expected \d numbers"):
            ask()
    robot.close()


@pytest.mark.parametrize(
    ("angles", "known"),
    [
        ((0.5, 0.4, -0.5, -0.4), True),
        ((28.6, 22.9, -28.6, -22.9), False),  # degrees
        ((0.0, 0.0, 0.0, 0.0), False),
        ((-0.5, -0.4, 0.5, 0.4), False),
        ((None, 0.4, -0.5, -0.4), False),
        ((HOPELESS, 0.4, -0.5, -0.4), False),
    ],
)
def test_angles_that_make_no_sense_are_no_calibration(angles: Any, known: bool) -> None:
    camera = camera_of([320, 240, 3, 11, 1, 0, b"", 0, *angles])
    assert (camera is not None) == known


def test_a_robot_without_stamps_is_not_taken_for_a_frozen_one() -> None:
    level = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0.5, 0, 0, 0, 1.0]
    answers = {
        "getSubscribers": [], "subscribeCamera": "me_0", "releaseImage": True,
        "getTransform": level, "unsubscribe": True,
        "getImageRemote": (4, 2, 3, 11, 0, 0, bytes(24), 0, 0.5, 0.4, -0.5, -0.4),
    }  # fmt: skip

    class Stampless:
        name = "robot"

        def call(self, service: str, method: str, *values: Any, **options: Any) -> Any:
            return answers[method]

    capture = NaoCapture(Stampless(), (0, "CameraTop"), 1, 11, 30)  # type: ignore[arg-type]
    shots = [capture.read() for _ in range(2)]
    assert [shot is not None for shot in shots] == [True, True]
