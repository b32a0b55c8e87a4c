"""The example scripts, as people run them, against a virtual NAO on a real libqi session."""

from __future__ import annotations

import math
import runpy
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from doorway3ds.lab.sim.robot.body import Body, Gait, RealClock
from doorway3ds.lab.sim.robot.model import MODELS

pytestmark = pytest.mark.nao
SCRIPTS = Path(__file__).parents[3] / "examples" / "naoqi"
BALL_RAD = (0.5, 0.15)
"""Where the ball is: yaw, + left, and pitch, + down, from where the robot stands."""


class Wall:
    """A ground with nothing but a wall across the way, at x = 2."""

    def reach(self, way: np.ndarray, radius_m: float) -> tuple[int, float | None]:
        stuck = np.flatnonzero(way[:, 0] > 2.0 - radius_m)
        return (int(stuck[0]) - 1, 0.0) if len(stuck) else (len(way) - 1, None)

    def range(self, x: float, y: float, heading_deg: float, most_m: float) -> float:
        ahead = math.cos(math.radians(heading_deg))
        return min(most_m, (2.0 - x) / ahead) if ahead > 0 else most_m


@pytest.fixture
def nao(virtual: Callable[..., Any]) -> Iterator[tuple[Any, str]]:
    """A robot ten times as fast as a real one, that sees a red ball and stands before a wall."""
    gait = Gait(speed_m_s=0.2, slip=0.0, slip_deg=0.0)
    body = Body(clock=RealClock(10.0), gait=gait, ground=Wall())  # type: ignore[arg-type]

    def ball(part: str, width: int, height: int) -> np.ndarray:
        image = np.full((height, width, 3), 90, np.uint8)
        focal = width / 2 / math.tan(math.radians(MODELS["nao"].fov_deg[0]) / 2)
        yaw, pitch = body.angle("HeadYaw"), body.angle("HeadPitch")
        x = width / 2 - focal * math.tan(BALL_RAD[0] - yaw)
        y = height / 2 + focal * math.tan(BALL_RAD[1] - pitch)
        cv2.circle(image, (round(x), round(y)), height // 12, (220, 20, 20), -1)
        return image

    robot, where = virtual(body=body)
    robot.picture = ball
    yield robot, where


@pytest.fixture
def run(nao: tuple[Any, str], monkeypatch: pytest.MonkeyPatch, capsys: Any) -> Callable[..., str]:
    """Runs a script with options and returns what it printed."""

    def call(name: str, **options: object) -> str:
        ip, port = nao[1].split(":")
        values = {"ip": ip, "port": port, **options}
        arguments = [str(v) for k, o in values.items() for v in (f"--{k.replace('_', '-')}", o)]
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        runpy.run_path(str(SCRIPTS / f"{name}.py"), run_name="__main__")
        return str(capsys.readouterr().out)

    return call


def test_every_script_is_run_here() -> None:
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {p.stem for p in SCRIPTS.glob("*.py")} <= tested


def test_take_photo(nao: Any, run: Any, tmp_path: Path) -> None:
    run("take_photo", out=tmp_path / "photo.png")
    image = cv2.imread(str(tmp_path / "photo.png"))
    assert image.shape == (480, 640, 3)
    assert (image[..., 2] > 200).sum() > 1000  # the ball, red in BGR, too
    assert nao[0].video.getSubscribers() == []


def test_walk_square(nao: Any, run: Any) -> None:
    assert run("walk_square", side=0.3).replace("-", "") == "at 0.00 m, 0.00 m, 0 deg\n"
    assert nao[0].body.place() == pytest.approx((0.0, 0.0, 360.0), abs=1e-6)
    assert (nao[0].body.awake, nao[0].body.posture) == (False, "Crouch")


def test_walk_square_stops_at_a_wall(nao: Any, run: Any) -> None:
    assert "in the way on side 1" in run("walk_square", side=5.0)
    assert nao[0].body.place()[0] == pytest.approx(2.0 - 0.15, abs=0.02)


def test_look_around(nao: Any, run: Any) -> None:
    assert "head at [0.3" in run("look_around")
    assert nao[0].body.angle("HeadYaw") == pytest.approx(0.3, abs=1e-3)
    assert nao[0].body.stiffness("HeadYaw") == 0.0


def test_say_and_listen(nao: Any, run: Any) -> None:
    out = run("say_and_listen")
    assert out == "heard 2 ends: ['Hello, I am a robot.', 'And I can listen.']\n"
    assert nao[0].said == ["Hello, I am a robot.", "And I can listen."]


def test_follow_sonar(nao: Any, run: Any) -> None:
    assert run("follow_sonar", near=0.6).startswith("stands, 0.")
    assert 1.2 < nao[0].body.place()[0] < 1.7
    assert not nao[0].body.moving


def test_led_show(nao: Any, run: Any) -> None:
    assert run("led_show") == "chest: [['ChestLed', [1.0, 0.0, 1.0]]]\n"
    leds = nao[0].services["ALLeds"]
    assert leds.getIntensity("LeftEarLed1") == [["LeftEarLed1", [0.5, 0.5, 0.5]]]


def test_record_video(nao: Any, run: Any, tmp_path: Path) -> None:
    run("record_video", frames=8, out=tmp_path / "nao.avi")
    film = cv2.VideoCapture(str(tmp_path / "nao.avi"))
    sizes = []
    while (frame := film.read()[1]) is not None:
        sizes.append(frame.shape)
    assert sizes == [(240, 320, 3)] * 8


def test_postures(nao: Any, run: Any) -> None:
    lines = run("postures").splitlines()
    assert [line.partition(":")[0] for line in lines] == [
        "Crouch", "LyingBack", "LyingBelly", "Sit", "SitRelax", "Stand", "StandInit", "StandZero",
    ]  # fmt: skip
    assert all("reached" in line for line in lines)


def test_touch_to_start(nao: Any, run: Any) -> None:
    def touch() -> None:
        while "FrontTactilTouched" not in nao[0].memory.getEventList():
            time.sleep(0.02)
        time.sleep(0.1)
        nao[0].memory.raiseEvent("FrontTactilTouched", 1.0)

    threading.Thread(target=touch, daemon=True).start()
    run("touch_to_start", wait_s=10)
    assert nao[0].said == ["Hello!"]


def test_track_ball(nao: Any, run: Any) -> None:
    run("track_ball", looks=12)
    body = nao[0].body
    assert (body.angle("HeadYaw"), body.angle("HeadPitch")) == pytest.approx(BALL_RAD, abs=0.03)
