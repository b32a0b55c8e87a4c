"""The adapter and the source against a virtual NAO on a real libqi session."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.sim.robot.body import Body, Gait
from doorway3ds.lab.sim.robot.nao import Faults
from doorway3ds.robots.base import RobotError, RobotLost, TurnEnd
from doorway3ds.robots.nao.session import Naoqi, address
from doorway3ds.sources import SourceLost, open_source
from tests.robots.conftest import picture

pytestmark = pytest.mark.nao
SLOW = Gait(speed_deg_s=15.0, ramp_s=0.0)


def robot_at(where: str, **options: Any) -> Any:
    pytest.importorskip("qi")
    from doorway3ds.robots.nao.robot import NaoRobot

    return NaoRobot(f"nao://{where}", **options)


@pytest.mark.parametrize("uri", ["nao://", "tcp://robot", "nao://robot:port"])
def test_an_address_that_is_none_is_refused(uri: str) -> None:
    with pytest.raises(CallError):
        address(uri)


def test_it_stands_up_turns_and_says(virtual: Any) -> None:
    nao, where = virtual()
    robot = robot_at(where)
    assert not nao.body.awake
    robot.prepare()
    assert (nao.body.awake, nao.body.posture) == (True, "StandInit")
    result = robot.turn(25.0, 5.0)
    assert (result.end, result.turned_deg) == (TurnEnd.DONE, pytest.approx(25.0, abs=0.01))
    assert abs(nao.body.place()[2] - 25.0) < 5
    robot.say("hello")
    assert nao.said == ["hello"]
    robot.close()
    robot.close()
    assert nao.body.awake  # it never rests by itself


def test_it_turns_its_head_as_far_as_that_goes_and_says_where_it_was(virtual: Any) -> None:
    nao, where = virtual()
    robot = robot_at(where)
    robot.prepare()
    assert robot.aim(20.0, -10.0) == pytest.approx((0.0, 0.0), abs=0.01)
    assert nao.body.angle("HeadYaw") == pytest.approx(np.radians(20.0), abs=1e-3)
    assert nao.body.angle("HeadPitch") == pytest.approx(np.radians(10.0), abs=1e-3)  # + is down
    assert robot.aim(0.0, -80.0) == pytest.approx((20.0, -10.0), abs=0.1)
    assert nao.body.angle("HeadPitch") == pytest.approx(0.5149, abs=1e-3)
    robot.close()


@pytest.mark.parametrize("colour", ["rgb", "bgr", "yuv422", "grey"])
def test_pictures_have_their_colours_camera_and_pose(virtual: Any, colour: str) -> None:
    nao, where = virtual()
    nao.body.aim("HeadPitch", -0.2, 1e9)
    with open_source(f"nao://{where}?resolution=qvga&fps=20&colour={colour}") as source:
        frame = source.read(5.0)
        assert len(nao.video.getSubscribers()) == 1
    assert frame is not None
    wanted = picture("CameraTop", 320, 240).astype(float)
    if colour == "grey":
        wanted = np.repeat((wanted @ [0.299, 0.587, 0.114])[..., None], 3, 2)
    assert np.abs(frame.image - wanted).mean() < 3
    assert frame.camera.hfov_deg == pytest.approx(60.9, abs=0.01)
    assert frame.camera.vfov_deg == pytest.approx(47.6, abs=0.01)
    assert frame.pose.pitch_deg == pytest.approx(np.degrees(0.2 - 0.0209), abs=0.01)
    assert 0 <= time.monotonic() - frame.stamp_s < 1
    assert nao.video.getSubscribers() == []


def test_subscriptions_of_crashed_processes_are_cleared_and_others_kept(virtual: Any) -> None:
    import socket

    nao, where = virtual()
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    computer = socket.gethostname().split(".")[0]
    dead = nao.video.subscribeCamera(f"doorway3ds-{computer}-{gone.pid}", 0, 1, 11, 10)
    alive = nao.video.subscribeCamera(f"doorway3ds-{computer}-{os.getpid()}", 0, 1, 11, 10)
    other = nao.video.subscribeCamera("face_detection", 0, 1, 11, 10)
    with open_source(f"nao://{where}?resolution=qvga&fps=20") as source:
        source.read(5.0)
        held = nao.video.getSubscribers()
    assert dead not in held
    assert {alive, other} <= set(held)


@pytest.mark.parametrize(
    "faults", [Faults(null=True), Faults(short=100), Faults(frozen=True), Faults(hang_s=3)]
)
def test_useless_pictures_are_never_handed_out(virtual: Any, faults: Faults) -> None:
    nao, where = virtual()
    uri = f"nao://{where}?resolution=qvga&fps=20&timeout_s=0.3"
    with open_source(uri, patience_s=1.0, stall_s=0.5) as source:
        assert source.read(5.0) is not None
        nao.faults = faults
        with pytest.raises(SourceLost):
            for _ in range(50):  # what was under way may still come, once
                source.read(0.2)
    nao.faults = Faults()


def test_pictures_come_back_and_a_jump_of_the_robots_clock_does_not_matter(virtual: Any) -> None:
    nao, where = virtual()
    with open_source(f"nao://{where}?resolution=qvga&fps=20&timeout_s=0.5") as source:
        assert source.read(5.0) is not None
        nao.faults.null = True
        time.sleep(0.2)
        nao.faults = Faults(clock_s=-86400.0)
        source.read(0.1)
        frame = source.read(5.0)
        assert frame is not None
        assert 0 <= time.monotonic() - frame.stamp_s < 1


@pytest.mark.parametrize(
    ("event", "value", "end"),
    [
        ("LeftBumperPressed", 1.0, TurnEnd.BUMPER),
        ("robotHasFallen", 1, TurnEnd.FALLEN),
        ("footContactChanged", False, TurnEnd.LIFTED),
    ],
)
def test_an_event_ends_the_turn_and_forbids_the_next(
    virtual: Any, event: str, value: Any, end: TurnEnd
) -> None:
    nao, where = virtual(body=Body(gait=SLOW))
    robot = robot_at(where)
    robot.prepare()
    threading.Timer(0.2, lambda: nao.memory.raiseEvent(event, value)).start()
    result = robot.turn(40.0, 5.0)
    assert result.end is end
    assert not nao.body.moving
    assert abs(nao.body.place()[2]) < 20
    assert robot.turn(5.0, 5.0).end is end
    robot.close()


def test_a_turn_that_takes_too_long_is_stopped(virtual: Any) -> None:
    nao, where = virtual(body=Body(gait=SLOW))
    robot = robot_at(where)
    robot.prepare()
    result = robot.turn(40.0, 0.4)
    assert result.end is TurnEnd.TIMEOUT
    assert not nao.body.moving
    assert 1 < result.turned_deg < 20
    robot.close()


def test_a_call_that_never_returns_does_not_hang(virtual: Any) -> None:
    _, where = virtual(faults=Faults(stuck=True))
    robot = robot_at(where)
    robot.prepare()
    start = time.monotonic()
    assert robot.turn(20.0, 0.5).end is TurnEnd.TIMEOUT
    assert time.monotonic() - start < 2
    robot.close()


def test_another_client_may_stop_the_robot(virtual: Any) -> None:
    _, where = virtual(body=Body(gait=SLOW))
    robot, other = robot_at(where), robot_at(where)
    robot.prepare()
    threading.Timer(0.3, other.stop).start()
    result = robot.turn(40.0, 5.0)
    assert result.end is TurnEnd.STOPPED
    assert result.turned_deg < 20
    robot.close()
    other.close()


def test_ctrl_c_stops_the_robot_before_anything_else(virtual: Any) -> None:
    nao, where = virtual(body=Body(gait=SLOW))
    robot = robot_at(where)
    robot.prepare()
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        robot.turn(40.0, 5.0)
    assert not nao.body.moving
    assert abs(nao.body.place()[2]) < 20
    robot.close()


def test_no_turn_beyond_the_limit_by_the_adapter_itself(virtual: Any) -> None:
    nao, where = virtual()
    robot = robot_at(where)
    robot.prepare()
    with pytest.raises(RobotError, match="60"):
        robot.turn(90.0, 5.0)
    assert nao.body.place()[2] == 0
    robot.close()


@pytest.mark.parametrize("service", ["ALMotion", "ALMemory", "ALRobotPosture"])
def test_a_missing_service_is_named(virtual: Any, service: str) -> None:
    _, where = virtual(without=(service,))
    with pytest.raises(RobotError, match=service):
        robot_at(where)


def test_a_camera_without_its_service_is_one_line(virtual: Any) -> None:
    _, where = virtual(without=("ALVideoDevice",))
    with pytest.raises(UserError, match="ALVideoDevice"):
        open_source(f"nao://{where}")


def test_nobody_there_is_one_line() -> None:
    pytest.importorskip("qi")
    with pytest.raises(RobotLost, match="is the robot on"):
        Naoqi("127.0.0.1", 9, 1.0)


SERVER = """
import sys, time
from doorway3ds.lab.sim.robot.body import Body
from doorway3ds.lab.sim.robot.nao import VirtualNao
from tests.robots.conftest import picture
from doorway3ds.lab.sim.robot.body import Gait
nao = VirtualNao(Body(gait=Gait(speed_deg_s=15.0)), picture)
print(nao.listen("tcp://127.0.0.1:0"), flush=True)
time.sleep(60)
"""


def test_a_robot_that_is_gone_in_the_middle_of_a_turn_is_known_to_be() -> None:
    pytest.importorskip("qi")
    server = subprocess.Popen([sys.executable, "-c", SERVER], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        robot = robot_at(server.stdout.readline().strip().removeprefix("tcp://"), timeout_s=1.0)
        robot.prepare()
        threading.Timer(0.4, server.kill).start()
        start = time.monotonic()
        result = robot.turn(40.0, 10.0)
        assert (result.end, result.turned_deg) == (TurnEnd.LOST, None)
        assert time.monotonic() - start < 5
        with pytest.raises(RobotLost):
            robot.stop()
        robot.close()
    finally:
        server.kill()
        server.wait()


def test_naoqi_scripts_find_the_calls_that_they_use(virtual: Any) -> None:
    nao, where = virtual()
    host, port = where.split(":")
    session = Naoqi(host, int(port))
    call = session.call
    call("ALMotion", "wakeUp")
    assert call("ALMotion", "robotIsWakeUp") is True
    call("ALMotion", "setAngles", ["HeadYaw"], [0.4], 1.0)
    time.sleep(0.5)
    assert call("ALMotion", "getAngles", "HeadYaw", True) == pytest.approx([0.4])
    assert call("ALMotion", "getPosition", "CameraTop", 2, True)[5] == pytest.approx(0.4, abs=1e-4)
    assert len(call("ALMotion", "getTransform", "CameraTop", 0, True)) == 16
    call("ALMotion", "moveToward", 0.0, 0.0, 0.5)
    assert call("ALMotion", "moveIsActive") is True
    time.sleep(0.1)
    call("ALMotion", "stopMove")
    assert call("ALMotion", "moveIsActive") is False
    assert nao.body.place()[2] > 0
    assert call("ALMotion", "moveTo", 0.0, 0.0, -0.3) is True
    assert call("ALRobotPosture", "goToPosture", "Nonsense", 0.5) is False
    assert call("ALMemory", "getData", "footContact") == 1.0
    handle = call("ALVideoDevice", "subscribeCamera", "script", 0, 1, 11, 10)
    image = call("ALVideoDevice", "getImageRemote", handle)
    assert [*image[:4], len(image), len(image[6])] == [320, 240, 3, 11, 12, 320 * 240 * 3]
    assert call("ALVideoDevice", "getImageRemote", "nobody") is None
    assert call("ALVideoDevice", "releaseImage", handle) is True
    assert call("ALVideoDevice", "unsubscribe", handle) is True
    with pytest.raises(RobotError, match="unknown joint"):
        call("ALMotion", "getAngles", "Nose", True)
    call("ALMotion", "rest")
    with pytest.raises(RobotError, match="not awake"):
        call("ALMotion", "moveTo", 0.0, 0.0, 0.3)
    session.close()


@pytest.mark.parametrize("state", ["solitary", "interactive", "safeguard"])
def test_autonomous_life_is_off_while_the_robot_is_ours_and_back_afterwards(
    virtual: Any, state: str
) -> None:
    nao, where = virtual()
    life = nao.services["ALAutonomousLife"]
    life.setState(state)
    told: list[str] = []
    robot = robot_at(where, tell=told.append)
    assert life.getState() == state  # connecting changes nothing
    robot.prepare()
    assert life.getState() == "disabled"
    assert told == [f"nao://{where}: autonomous life was {state}, now disabled; "
                    "restored at the end"]  # fmt: skip
    robot.close()
    assert life.getState() == state
    assert told[-1].endswith(f"autonomous life is {state} again")


def test_a_robot_that_was_asked_to_rest_is_not_woken_by_its_own_life(virtual: Any) -> None:
    nao, where = virtual()
    nao.services["ALAutonomousLife"].setState("solitary")
    told: list[str] = []
    robot = robot_at(where, tell=told.append)
    robot.prepare()
    robot.rest()
    robot.close()
    assert nao.services["ALAutonomousLife"].getState() == "disabled"
    assert "stays disabled" in told[-1]


def test_a_robot_without_autonomous_life_is_prepared_all_the_same(virtual: Any) -> None:
    nao, where = virtual(without=("ALAutonomousLife",))
    robot = robot_at(where)
    robot.prepare()
    robot.close()
    assert nao.body.awake
