"""The chains of joints against the makers' tables."""

from __future__ import annotations

import math

import numpy as np
import pytest

from doorway3ds.lab.sim.robot.body import Body
from doorway3ds.lab.sim.robot.model import MODELS

NAO, PEPPER = MODELS["nao"], MODELS["pepper"]


@pytest.mark.parametrize(
    ("part", "wanted"),
    [
        ("Head", (0.0, 0.0, 0.1265)),
        ("LArm", (0.105 + 0.05595 + 0.05775, 0.098 + 0.015, 0.1 - 0.01231)),
        ("RArm", (0.105 + 0.05595 + 0.05775, -0.098 - 0.015, 0.1 - 0.01231)),
        ("LLeg", (0.0, 0.05, -0.085 - 0.1 - 0.1029 - 0.04511)),
        ("RKneePitch", (0.0, -0.05, -0.185)),
        ("CameraTop", (0.05871, 0.0, 0.1265 + 0.06364)),
        ("Torso", (0.0, 0.0, 0.0)),
    ],
)
def test_naos_links_are_as_published_when_all_joints_are_zero(
    part: str, wanted: tuple[float, float, float]
) -> None:
    assert NAO.frame(part, {})[:3, 3] == pytest.approx(wanted, abs=1e-9)


def test_a_raised_arm_points_up_and_an_open_one_aside() -> None:
    up = NAO.frame("LArm", {"LShoulderPitch": -math.pi / 2})[:3, 3]
    assert up[2] == pytest.approx(0.1 + 0.2187, abs=1e-9)
    aside = NAO.frame("RArm", {"RShoulderRoll": -1.0})[:3, 3]
    assert aside[1] < -0.098 - 0.015


def test_both_legs_open_to_their_sides_when_the_hips_turn() -> None:
    angles = {"LHipYawPitch": -0.5, "RHipYawPitch": -0.5}
    left, right = (NAO.frame(leg, angles) for leg in ("LLeg", "RLeg"))
    assert left[1, 3] == pytest.approx(-right[1, 3])
    assert math.atan2(left[1, 0], left[0, 0]) > 0.3  # toes out


def test_the_two_arms_are_mirror_images_in_every_posture() -> None:
    for model in (NAO, PEPPER):
        for name, angles in model.postures.items():
            left, right = (model.frame(arm, angles)[:3, 3] for arm in ("LArm", "RArm"))
            assert left * (1, -1, 1) == pytest.approx(right, abs=1e-9), name


@pytest.mark.parametrize("model", [NAO, PEPPER], ids=lambda model: model.name)
def test_postures_lie_within_the_joints_limits(model: object) -> None:
    for name, angles in model.postures.items():  # type: ignore[attr-defined]
        for joint, angle in angles.items():
            limits = model.joints[joint]  # type: ignore[attr-defined]
            assert limits.low <= angle <= limits.high, (name, joint)


def test_a_standing_robots_feet_are_flat_on_the_floor() -> None:
    body = Body()
    for foot in ("LLeg", "RLeg"):
        m = body.transform(foot, 2)
        assert m[2, 3] == pytest.approx(0.0, abs=1e-6)
        assert m[:3, :3] == pytest.approx(np.eye(3), abs=1e-4)


def test_peppers_elbows_are_bent_by_nine_degrees() -> None:
    fore = PEPPER.frame("LWristYaw", {})[:3, 0]
    assert math.degrees(math.asin(fore[2])) == pytest.approx(9.0, abs=0.01)


def test_who_crouches_or_lies_sees_from_lower_down() -> None:
    body = Body()
    heights = []
    for posture in ("StandInit", "Crouch", "Sit", "LyingBack"):
        body.go(posture, 0.0)
        heights.append(float(body.transform("CameraTop", 2)[2, 3]))
    assert heights == sorted(heights, reverse=True)
    assert heights[0] == pytest.approx(0.52, abs=1e-3)
    assert heights[-1] < 0.15
