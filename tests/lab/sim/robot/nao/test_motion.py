"""ALMotion and ALRobotPosture: values as NAOqi has them, and a body that obeys physics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from doorway3ds.lab.sim.robot.body import Body, FastClock, Gait
from doorway3ds.lab.sim.robot.model import MODELS
from doorway3ds.lab.sim.robot.nao import VirtualNao
from tests.lab.sim.robot.test_ground import body as walled
from tests.robots.conftest import picture

HEAD = ["HeadYaw", "HeadPitch"]


def robot(model: str = "nao", body: Body | None = None) -> tuple[VirtualNao, Any]:
    if body is None:
        body = Body(clock=FastClock(), model=MODELS[model], gait=Gait(slip=0, slip_deg=0))
    nao = VirtualNao(body, picture)
    return nao, nao.services["ALMotion"]


def test_limp_joints_do_not_move_before_wakeup_and_after_rest() -> None:
    nao, motion = robot()
    motion.setAngles("HeadYaw", 0.5, 1.0)
    motion.angleInterpolation("HeadPitch", 0.3, 1.0, True)
    assert motion.getAngles(HEAD, True) == pytest.approx([0.0, 0.0])
    motion.wakeUp()
    motion.angleInterpolation(HEAD, [0.5, 0.3], [1.0, 1.0], True)
    assert motion.getAngles(HEAD, True) == pytest.approx([0.5, 0.3])
    motion.rest()
    before = motion.getAngles(HEAD, True)
    motion.angleInterpolationWithSpeed(HEAD, [0.2, 0.2], 1.0)
    assert motion.getAngles(HEAD, True) == before
    assert motion.getStiffnesses("Body") == [0.0] * 26
    assert nao.body.posture == "Crouch"


def test_a_joint_that_goes_limp_stays_where_it_is() -> None:
    nao, motion = robot()
    motion.setStiffnesses("Head", 1.0)
    motion.setAngles("HeadYaw", 1.0, 0.1)
    nao.body.clock.sleep(0.5)
    motion.setStiffnesses("HeadYaw", 0.0)
    halfway = motion.getAngles("HeadYaw", True)
    nao.body.clock.sleep(5.0)
    assert motion.getAngles("HeadYaw", True) == halfway
    assert 0.1 < halfway[0] < 0.9


def test_several_stiffnesses_at_once_are_all_kept() -> None:
    _, motion = robot()
    motion.setStiffnesses(["HeadYaw", "LArm"], [0.2, *[0.7] * 6])
    motion.setStiffnesses(["RHand"], [0.9])
    assert motion.getStiffnesses(["HeadYaw", "HeadPitch", "LHand", "RHand"]) == pytest.approx(
        [0.2, 0.0, 0.7, 0.9]
    )
    motion.stiffnessInterpolation(["HeadYaw", "HeadPitch"], [[0.5, 1.0], [0.4]], [[0.1, 0.2], 0.3])
    assert motion.getStiffnesses("Head") == [1.0, 0.4]


def test_several_keys_for_a_joint_are_passed_one_after_the_other() -> None:
    nao, motion = robot()
    motion.setStiffnesses("Head", 1.0)
    seen = []
    asleep = nao.body.clock.sleep

    def watched(seconds: float) -> None:
        for _ in range(4):
            asleep(seconds / 4)
            seen.append(round(motion.getAngles("HeadYaw", True)[0], 6))

    nao.body.clock.sleep = watched  # type: ignore[method-assign]
    motion.angleInterpolation("HeadYaw", [0.4, -0.4, 0.0], [1.0, 3.0, 4.0], True)
    assert seen == pytest.approx([0.4, 0.0, -0.4, 0.0])
    seen.clear()
    motion.angleInterpolation(HEAD, [[0.2, 0.4], 0.1], [[1.0, 2.0], 2.0], True)
    assert seen == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert motion.getAngles("HeadPitch", True) == pytest.approx([0.1])
    motion.angleInterpolation("HeadYaw", [0.1, -0.1], [1.0, 2.0], False)  # from where it was
    assert motion.getAngles("HeadYaw", True) == pytest.approx([0.3])
    motion.angleInterpolationBezier(["HeadYaw"], [[1.0]], [[[0.7, [3, -0.1, 0], [3, 0.1, 0]]]])
    assert motion.getAngles("HeadYaw", True) == pytest.approx([0.7])


@pytest.mark.parametrize(
    ("names", "angles", "times", "said"),
    [
        ("HeadYaw", [0.1, 0.2], [1.0], "as many rising times"),
        ("HeadYaw", [0.1, 0.2], [2.0, 1.0], "as many rising times"),
        (HEAD, [0.1], [1.0], "expected 2 values"),
        ("Nose", 0.1, 1.0, "unknown joint Nose"),
    ],
)
def test_a_wrong_call_is_said(names: Any, angles: Any, times: Any, said: str) -> None:
    with pytest.raises(RuntimeError, match=said):
        robot()[1].angleInterpolation(names, angles, times, True)


def test_angles_stay_within_the_published_limits() -> None:
    _, motion = robot()
    motion.setStiffnesses("Body", 1.0)
    motion.angleInterpolationWithSpeed("Body", 9.0, 1.0)
    limits = motion.getLimits("Body")
    assert motion.getAngles("Body", True) == pytest.approx([low_high[1] for low_high in limits])
    assert limits[0] == pytest.approx([-2.0857, 2.0857, 8.268, 1.547])
    assert len(motion.getLimits("LLeg")) == 6


@pytest.mark.parametrize(
    ("model", "group", "size"),
    [("nao", "Body", 26), ("nao", "LArm", 6), ("nao", "RLeg", 6), ("nao", "HeadYaw", 1),
     ("pepper", "Body", 20), ("pepper", "Joints", 17), ("pepper", "Leg", 3)],
)  # fmt: skip
def test_groups_have_their_joints(model: str, group: str, size: int) -> None:
    _, motion = robot(model)
    assert len(motion.getBodyNames(group)) == len(motion.getAngles(group, True)) == size


def test_one_motor_turns_both_hips() -> None:
    _, motion = robot()
    motion.setStiffnesses("Body", 1.0)
    motion.angleInterpolationWithSpeed("LHipYawPitch", -0.4, 1.0)
    assert motion.getAngles("RHipYawPitch", True) == pytest.approx([-0.4])


def test_a_transform_and_a_position_are_of_the_same_place() -> None:
    _, motion = robot()
    motion.wakeUp()
    motion.angleInterpolation(HEAD, [0.6, 0.2], [1.0, 1.0], True)
    for frame in (0, 1, 2):
        m = np.array(motion.getTransform("CameraBottom", frame, True)).reshape(4, 4)
        at = motion.getPosition("CameraBottom", frame, True)
        assert m[:3, 3] == pytest.approx(at[:3])
        assert at[4:] == pytest.approx([0.2 + 0.6929, 0.6], abs=1e-4)
    with pytest.raises(ValueError, match="Nose"):
        motion.getTransform("Nose", 0, True)


def test_the_configuration_is_two_lists() -> None:
    names, values = robot()[1].getRobotConfig()
    assert dict(zip(names, values, strict=True))["Model Type"] == "naoH25"
    assert robot("pepper")[1].getRobotConfig()[1][0] == "juliette"


def test_walking_takes_configs_and_lists_of_poses() -> None:
    _, motion = robot()
    motion.wakeUp()
    assert motion.moveTo(0.2, 0.0, 0.0, [["MaxStepFrequency", 0.5]])
    assert motion.moveTo([[0.2, 0.0, 0.0], [0.2, 0.2, math.pi / 2]])
    assert motion.getRobotPosition(True) == pytest.approx([0.4, 0.2, math.pi / 2])
    assert motion.moveTo([0.1, 0.0, 0.0])
    assert motion.getRobotPosition(True)[:2] == pytest.approx([0.4, 0.3])
    with pytest.raises(RuntimeError, match="MaxStepX"):
        motion.moveTo(0.1, 0.0, 0.0, [["Speed", 1.0]])
    with pytest.raises(RuntimeError, match="x, y, theta"):
        motion.moveTo(0.1, 0.0)


def test_velocities_are_kept_until_it_is_stopped() -> None:
    nao, motion = robot()
    motion.wakeUp()
    motion.move(0.04, 0.0, 0.1)
    assert motion.getRobotVelocity() == pytest.approx([0.04, 0.0, 0.1], rel=0.02)
    nao.body.clock.sleep(5.0)
    motion.setWalkTargetVelocity(1.0, 0.0, 0.0, 0.5)
    assert motion.getRobotVelocity()[0] == pytest.approx(0.04, rel=0.02)
    motion.moveToward(0.0, 1.0, 0.0, [["MaxStepFrequency", 0.5]])
    assert motion.getRobotVelocity() == pytest.approx([0.0, 0.04, 0.0], rel=0.02)
    motion.killMove()
    assert motion.getRobotVelocity() == [0.0, 0.0, 0.0]
    assert not motion.moveIsActive()
    assert motion.getRobotPosition(True)[0] == pytest.approx(0.2, abs=0.02)


def test_legs_that_hold_walk_without_wakeup_and_limp_ones_do_not() -> None:
    nao, motion = robot()
    with pytest.raises(RuntimeError, match="limp"):
        motion.moveTo(0.1, 0.0, 0.0)
    motion.stiffnessInterpolation("Body", 1.0, 1.0)
    motion.walkInit()
    assert motion.walkTo(0.1, 0.0, 0.0)
    motion.moveToward(1.0, 0.0, 0.0)
    nao.body.clock.sleep(1.0)
    motion.setStiffnesses("RLeg", 0.0)
    assert not motion.moveIsActive()
    assert motion.getRobotPosition(True)[0] < 0.2


def test_walking_into_a_wall_returns_false_and_presses_both_bumpers() -> None:
    nao, motion = robot(body=walled(3.0, 1.0))
    motion.wakeUp()
    assert motion.moveTo(3.0, 0.0, 0.0) is False
    memory = nao.memory
    for bumper in ("LeftBumperPressed", "RightBumperPressed"):
        assert memory.getData(bumper) == 1.0
    assert memory.getData("Device/SubDeviceList/RFoot/Bumper/Left/Sensor/Value") == 1.0
    assert memory.getData("ALMotion/MoveFailed")[0] == "Obstacle"
    assert motion.moveTo(-0.3, 0.0, 0.0) is True
    assert memory.getData("RightBumperPressed") == 0.0


def test_postures_are_naos_for_nao_and_peppers_for_pepper() -> None:
    nao, _ = robot()
    posture = nao.services["ALRobotPosture"]
    assert posture.getPostureList() == [
        "Crouch", "LyingBack", "LyingBelly", "Sit", "SitRelax", "Stand", "StandInit", "StandZero",
    ]  # fmt: skip
    pepper = robot("pepper")[0].services["ALRobotPosture"]
    assert pepper.getPostureList() == ["Crouch", "Stand", "StandInit", "StandZero"]
    assert posture.goToPosture("Sit", 0.5)
    assert (posture.getPosture(), posture.getPostureFamily()) == ("Sit", "Sitting")
    assert nao.memory.getData("PostureFamilyChanged") == "Sitting"
    assert posture.applyPosture("StandZero", 0.5)
    assert nao.services["ALMotion"].getAngles("LLeg", True) == pytest.approx([0.0] * 6)
    assert not posture.goToPosture("Handstand", 0.5)


@pytest.mark.parametrize(
    ("name", "values"),
    [("FallManagerEnabled", (False,)), ("SmartStiffnessEnabled", (False,)),
     ("ExternalCollisionProtectionEnabled", ("Move", False)), ("BreathEnabled", ("Arms", True)),
     ("CollisionProtectionEnabled", ("LArm", False)), ("OrthogonalSecurityDistance", (0.2,))],
)  # fmt: skip
def test_safety_settings_are_kept(name: str, values: tuple[Any, ...]) -> None:
    _, motion = robot()
    before = getattr(motion, f"get{name}")(*values[:-1])
    getattr(motion, f"set{name}")(*values)
    assert before != getattr(motion, f"get{name}")(*values[:-1]) == values[-1]


@pytest.mark.parametrize(
    "rest",
    [([7, 7], [[0.4], [0.7]]), ([7, 7], [0.4, 0.7], True), (7, 0.7)],
    ids=["lists", "flat, absolute", "one"],
)
def test_effectors_take_their_time_and_stay(rest: tuple[Any, ...]) -> None:
    nao, motion = robot()
    motion.wakeUp()
    before, begun_s = motion.getPosition("LArm", 0), nao.body.clock.now()
    motion.positionInterpolations(["LArm", "RArm"], 0, [[[0.1] * 6], [[0.1] * 6]], *rest)
    assert nao.body.clock.now() - begun_s == pytest.approx(0.7, abs=0.05)
    assert motion.getPosition("LArm", 0) == before
    motion.wbEnable(True)
    assert motion.wbGoToBalance("LLeg", 1.0) is True
