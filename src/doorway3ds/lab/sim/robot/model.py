"""The bodies of NAO V5 and Pepper: joints, links, limits, sensors' places and postures.

Metres and radians in NAOqi's frames (x forward, y left, z up). Lengths and limits are the makers'
published ones (H25 V5 links and joints; Pepper's technical overview).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from doorway3ds.camera.model import Array

Vector = tuple[float, float, float]


class Joint(NamedTuple):
    """parent: the joint that carries this one, "" for the torso. offset: from it, metres.

    axis: turned about. low, high: rad; speed: rad/s at most; torque: Nm at most. pitch: by which
    the joint's own frame is bent.
    """

    parent: str
    offset: Vector
    axis: Vector
    low: float
    high: float
    speed: float
    torque: float
    pitch: float = 0.0


class Part(NamedTuple):
    """A camera, an end of a chain or a sensor: what carries it, where, and roll, pitch, yaw."""

    parent: str
    offset: Vector
    turned: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Model:
    """name: "nao" or "pepper". joints: in the order of `getBodyNames("Body")`.

    chains: names of joints. parts: see `Part`. soles: the parts that stand on the floor.
    postures: joint angles, those left out are 0. grounded: height and pitch of the torso in
    postures that do not stand on the soles. radius_m: of the footprint. fov_deg, depth_fov_deg:
    of the cameras, across and down. sonars: name -> part.
    """

    name: str
    joints: Mapping[str, Joint]
    chains: Mapping[str, tuple[str, ...]]
    parts: Mapping[str, Part]
    soles: tuple[str, ...]
    postures: Mapping[str, Mapping[str, float]]
    radius_m: float
    fov_deg: tuple[float, float]
    sonars: Mapping[str, str]
    depth_fov_deg: tuple[float, float] | None = None
    grounded: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def names(self, group: str) -> tuple[str, ...]:
        """Joints of a joint's or chain's name or of "Body"; empty for no such group."""
        if group in self.joints:
            return (group,)
        return self.chains.get(group, ())

    def frame(self, name: str, angles: Mapping[str, float]) -> Array:
        """(4, 4): a joint, part or chain's end, or the torso, in the torso's frame.

        Raises KeyError for another name.
        """
        out = np.eye(4)
        if name in ("", "Torso"):
            return out
        if name in self.parts:
            part = self.parts[name]
            return self.frame(part.parent, angles) @ moved(part.offset) @ turned(part.turned)
        joint = self.joints[name]
        parent = self.frame(joint.parent, angles)
        own = moved(joint.offset) @ about(_Y, joint.pitch)
        return parent @ own @ about(joint.axis, angles.get(name, 0.0))

    def stance(self, angles: Mapping[str, float]) -> Array:
        """(4, 4): the robot's frame, on the floor amid the soles, in the torso's frame."""
        soles = [self.frame(name, angles) for name in self.soles]
        u, _, v = np.linalg.svd(sum(m[:3, :3] for m in soles))
        out = np.eye(4)
        out[:3, :3] = u @ v
        out[:3, 3] = np.mean([m[:3, 3] for m in soles], axis=0)
        return out


def moved(offset: Vector) -> Array:
    m = np.eye(4)
    m[:3, 3] = offset
    return m


def about(axis: Vector, angle: float) -> Array:
    """(4, 4) rotation by Rodrigues' formula; axis: of length 1."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    m = np.eye(4)
    m[:3, :3] += math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)
    return m


def turned(angles: Vector) -> Array:
    """(4, 4) of roll, pitch, yaw: yaw last, as NAOqi composes them."""
    roll, pitch, yaw = angles
    return about(_Z, yaw) @ about(_Y, pitch) @ about(_X, roll)


_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_HALF = math.sqrt(0.5)


def _span(a: float, b: float) -> tuple[float, float]:
    return min(a, b), max(a, b)


def _nao() -> Model:
    head = {
        "HeadYaw": Joint("", (0, 0, 0.1265), _Z, -2.0857, 2.0857, 8.268, 1.547),
        "HeadPitch": Joint("HeadYaw", (0, 0, 0), _Y, -0.6720, 0.5149, 7.194, 1.532),
    }

    def arm(s: str, y: float) -> dict[str, Joint]:
        # The limits of the two arms are mirrored: a roll's or yaw's sign is the side's.
        roll, elbow = _span(-0.3142 * y, 1.3265 * y), _span(-1.5446 * y, -0.0349 * y)
        return {
            f"{s}ShoulderPitch": Joint("", (0, 0.098 * y, 0.1), _Y, -2.0857, 2.0857, 8.268, 1.329),
            f"{s}ShoulderRoll": Joint(f"{s}ShoulderPitch", (0, 0, 0), _Z, *roll, 7.194, 1.783),
            f"{s}ElbowYaw": Joint(
                f"{s}ShoulderRoll", (0.105, 0.015 * y, 0), _X, -2.0857, 2.0857, 8.268, 1.547
            ),
            f"{s}ElbowRoll": Joint(f"{s}ElbowYaw", (0, 0, 0), _Z, *elbow, 7.194, 1.532),
            f"{s}WristYaw": Joint(
                f"{s}ElbowRoll", (0.05595, 0, 0), _X, -1.8238, 1.8238, 24.623, 0.408
            ),
            f"{s}Hand": Joint(f"{s}WristYaw", (0, 0, 0), _X, 0.0, 1.0, 8.33, 0.292),
        }

    def leg(s: str, y: float) -> dict[str, Joint]:
        hip, ankle = _span(-0.3794 * y, 0.7905 * y), _span(-0.3978 * y, 0.7690 * y)
        bend = (-1.1894, 0.9226) if y > 0 else (-1.1863, 0.9320)
        return {
            f"{s}HipYawPitch": Joint(
                "", (0, 0.05 * y, -0.085), (0, _HALF, -_HALF * y), -1.1453, 0.7407, 4.162, 3.348
            ),
            f"{s}HipRoll": Joint(f"{s}HipYawPitch", (0, 0, 0), _X, *hip, 4.162, 3.348),
            f"{s}HipPitch": Joint(f"{s}HipRoll", (0, 0, 0), _Y, -1.5359, 0.4840, 6.402, 3.023),
            f"{s}KneePitch": Joint(f"{s}HipPitch", (0, 0, -0.1), _Y, -0.0923, 2.1125, 6.402, 3.023),
            f"{s}AnklePitch": Joint(f"{s}KneePitch", (0, 0, -0.1029), _Y, *bend, 6.402, 3.023),
            f"{s}AnkleRoll": Joint(f"{s}AnklePitch", (0, 0, 0), _X, *ankle, 4.162, 3.348),
        }

    joints = {**head, **arm("L", 1.0), **leg("L", 1.0), **leg("R", -1.0), **arm("R", -1.0)}
    parts = {
        "Head": Part("HeadPitch", (0, 0, 0)),
        "CameraTop": Part("HeadPitch", (0.05871, 0, 0.06364), (0, 0.0209, 0)),
        "CameraBottom": Part("HeadPitch", (0.05071, 0, 0.01774), (0, 0.6929, 0)),
        "Head/Touch/Front": Part("HeadPitch", (0.0312, 0, 0.1014), (0, -1.1861, 0)),
        "Head/Touch/Middle": Part("HeadPitch", (0.001, 0, 0.1099), (math.pi, -_QUARTER, -math.pi)),
        "Head/Touch/Rear": Part("HeadPitch", (-0.0257, 0, 0.1045), (math.pi, -1.3332, -math.pi)),
        "ChestBoard/Button": Part("", (0.04987, 0.00159, 0.05516)),
        "Accelerometer": Part("", (-0.008, 0.00606, 0.027)),
        "Gyrometer": Part("", (-0.008, 0.006, 0.029)),
        "Sonar/Left": Part("", (0.00558, 0.01921, 0.06239), (-0.0048, 0.0436, 0.3924)),
        "Sonar/Right": Part("", (0.00558, -0.01921, 0.06239), (0.0048, 0.0436, -0.3924)),
    }
    for s, y in (("L", 1.0), ("R", -1.0)):
        parts[f"{s}Arm"] = Part(f"{s}WristYaw", (0.05775, 0, -0.01231))
        parts[f"{s}Leg"] = Part(f"{s}AnkleRoll", (0, 0, -0.04511))
        for side, across in (("Left", 0.0165 + 0.0025 * y), ("Right", 0.0025 * y - 0.0165)):
            parts[f"{s}Foot/Bumper/{side}"] = Part(f"{s}AnkleRoll", (0.0876, across, -0.0353))
    return Model(
        name="nao",
        joints=joints,
        chains=_chains(joints, {"LLeg": "L", "RLeg": "R"}),
        parts=parts,
        soles=("LLeg", "RLeg"),
        postures=_NAO_POSTURES,
        radius_m=0.15,
        fov_deg=(60.9, 47.6),
        sonars={"Left": "Sonar/Left", "Right": "Sonar/Right"},
        grounded={
            "Sit": (0.115, 0.0),
            "SitRelax": (0.115, -0.35),
            "LyingBelly": (0.06, _QUARTER),
            "LyingBack": (0.06, -_QUARTER),
        },
    )


def _pepper() -> Model:
    def arm(s: str, y: float) -> dict[str, Joint]:
        roll, elbow = _span(0.0087 * y, 1.5621 * y), _span(-1.5621 * y, -0.0087 * y)
        return {
            f"{s}ShoulderPitch": Joint(
                "", (-0.057, 0.14974 * y, 0.08682), _Y, -2.0857, 2.0857, 7.340, 5.428
            ),
            f"{s}ShoulderRoll": Joint(f"{s}ShoulderPitch", (0, 0, 0), _Z, *roll, 9.228, 2.666),
            f"{s}ElbowYaw": Joint(
                f"{s}ShoulderRoll", (0.1812, 0.015 * y, 0.00013), _X, -2.0857, 2.0857, 7.340,
                5.428, pitch=-0.1571,
            ),
            f"{s}ElbowRoll": Joint(f"{s}ElbowYaw", (0, 0, 0), _Z, *elbow, 9.228, 2.666),
            f"{s}WristYaw": Joint(
                f"{s}ElbowRoll", (0.15, 0, 0), _X, -1.8239, 1.8239, 17.384, 0.2014
            ),
            f"{s}Hand": Joint(f"{s}WristYaw", (0, 0, 0), _X, 0.0, 1.0, 12.56, 0.144),
        }  # fmt: skip

    joints = {
        "HeadYaw": Joint("", (-0.038, 0, 0.1699), _Z, -2.0857, 2.0857, 7.340, 5.428),
        "HeadPitch": Joint("HeadYaw", (0, 0, 0), _Y, -0.7068, 0.6371, 9.228, 2.666),
        **arm("L", 1.0),
        "HipRoll": Joint("", (0, 0, -0.139), _X, -0.5149, 0.5149, 2.270, 10.188),
        "HipPitch": Joint("HipRoll", (0, 0, -0.079), _Y, -1.0385, 1.0385, 2.933, 19.787),
        "KneePitch": Joint("HipPitch", (0, 0, -0.268), _Y, -0.5149, 0.5149, 2.933, 27.702),
        **arm("R", -1.0),
        "WheelFL": Joint("KneePitch", (0.09, 0.155, -0.264), _X, 0.0, 0.0, 6.283, 3.25),
        "WheelFR": Joint("KneePitch", (0.09, -0.155, -0.264), _X, 0.0, 0.0, 6.283, 3.25),
        "WheelB": Joint("KneePitch", (-0.17, 0, -0.264), _X, 0.0, 0.0, 6.283, 3.25),
    }
    parts = {
        "Head": Part("HeadPitch", (0, 0, 0)),
        "CameraTop": Part("HeadPitch", (0.0868, 0, 0.1631)),
        "CameraBottom": Part("HeadPitch", (0.0936, 0, 0.0616), (0, 0.6981, 0)),
        "CameraDepth": Part("HeadPitch", (0.05138, 0.039, 0.1194)),
        "Head/Touch/Front": Part("HeadPitch", (0.0282, 0, 0.2127), (0, 0.2094, 0)),
        "Head/Touch/Middle": Part("HeadPitch", (0.0041, 0, 0.2159), (0, -0.0349, 0)),
        "Head/Touch/Rear": Part("HeadPitch", (-0.0338, 0, 0.2105), (0, -0.3142, 0)),
        "LArm": Part("LWristYaw", (0.025, 0, 0)),
        "RArm": Part("RWristYaw", (0.025, 0, 0)),
        # The floor lies where the preset's lens is 1.15 m above it: 3 mm higher than published.
        "Leg": Part("KneePitch", (0, 0, -0.331)),
        "Sonar/Front": Part("KneePitch", (0.0699, 0, -0.1023), (0, -0.3229, 0)),
        "Sonar/Back": Part("KneePitch", (-0.0718, 0, -0.0534), (0, -0.2094, math.pi)),
        "Platform/Bumper/FrontLeft": Part("KneePitch", (0.129, 0.227, -0.264)),
        "Platform/Bumper/FrontRight": Part("KneePitch", (0.129, -0.227, -0.264)),
        "Platform/Bumper/Back": Part("KneePitch", (-0.251, 0, -0.264)),
    }
    return Model(
        name="pepper",
        joints=joints,
        chains=_chains(joints, {"Leg": "HipRoll HipPitch KneePitch", "Wheels": "Wheel"}),
        parts=parts,
        soles=("Leg",),
        postures=_PEPPER_POSTURES,
        radius_m=0.27,
        fov_deg=(56.3, 43.7),
        depth_fov_deg=(58.0, 45.0),
        sonars={"Front": "Sonar/Front", "Back": "Sonar/Back"},
    )


def _chains(joints: Mapping[str, Joint], legs: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    def of(*starts: str) -> tuple[str, ...]:
        return tuple(name for name in joints if name.startswith(starts))

    arms = {f"{s}Arm": of(*(f"{s}{p}" for p in ("Shoulder", "Elbow", "Wrist", "Hand")))
            for s in "LR"}  # fmt: skip
    below = {
        chain: of(*starts.split()) if len(starts) > 1
        else of(*(f"{starts}{p}" for p in ("Hip", "Knee", "Ankle")))
        for chain, starts in legs.items()
    }  # fmt: skip
    body = tuple(joints)
    bones = tuple(name for name in joints if not name.startswith("Wheel"))
    return {
        "Head": of("Head"), **arms, **below,
        "Arms": arms["LArm"] + arms["RArm"],
        "Legs": tuple(name for chain in below.values() for name in chain if "Wheel" not in name),
        "Body": body, "Actuators": body, "Joints": bones, "JointActuators": bones,
    }  # fmt: skip


_QUARTER = math.pi / 2


def _both(**left: float) -> dict[str, float]:
    """The same on both sides; rolls, yaws of the arms and hip rolls have the side's sign."""
    out: dict[str, float] = {}
    for name, angle in left.items():
        sign = -1.0 if "Roll" in name or name in ("ElbowYaw", "WristYaw") else 1.0
        out |= {f"L{name}": angle, f"R{name}": sign * angle}
    return out


# The knees are bent so that the lens stands at the preset's 0.52 m, above the turning axis.
_STAND = {"HipPitch": -0.177862, "KneePitch": 0.350659, "AnklePitch": -0.172798}
_NAO_POSTURES = {
    "Crouch": _both(
        ShoulderPitch=1.57, ShoulderRoll=0.16, ElbowYaw=-0.80, ElbowRoll=-1.05, HipPitch=-0.70,
        KneePitch=2.11, AnklePitch=-1.18,
    ),
    "LyingBack": _both(ShoulderPitch=1.57, ShoulderRoll=0.14, ElbowRoll=-0.35),
    "LyingBelly": _both(ShoulderPitch=-2.05, ShoulderRoll=0.27, ElbowRoll=-0.70),
    "Sit": _both(
        ShoulderPitch=0.96, ShoulderRoll=0.26, ElbowYaw=-0.52, ElbowRoll=-1.24, HipYawPitch=-0.60,
        HipRoll=0.26, HipPitch=-1.52, KneePitch=1.41, AnklePitch=0.85,
    ),
    "SitRelax": _both(
        ShoulderPitch=2.05, ShoulderRoll=0.33, ElbowYaw=-0.70, ElbowRoll=-0.05, HipYawPitch=-0.47,
        HipRoll=0.20, HipPitch=-1.02, KneePitch=0.70, AnklePitch=0.65,
    ),
    "Stand": _both(ShoulderPitch=1.45, ShoulderRoll=0.18, ElbowYaw=-1.18, ElbowRoll=-0.41,
                   Hand=0.3, **_STAND),
    "StandInit": _both(ShoulderPitch=1.39, ShoulderRoll=0.35, ElbowYaw=-1.39, ElbowRoll=-1.04,
                       **_STAND),
    "StandZero": _both(ElbowRoll=-0.0349),
}  # fmt: skip
_PEPPER_POSTURES = {
    "Crouch": {
        **_both(ShoulderPitch=1.01, ShoulderRoll=0.12, ElbowYaw=-0.70, ElbowRoll=-0.15),
        "HipPitch": -1.03, "KneePitch": 0.51, "HeadPitch": 0.62,
    },
    "Stand": _both(ShoulderPitch=1.57, ShoulderRoll=0.12, ElbowYaw=-1.23, ElbowRoll=-0.52,
                   Hand=0.6),
    "StandInit": _both(ShoulderPitch=1.39, ShoulderRoll=0.17, ElbowYaw=-1.23, ElbowRoll=-0.52,
                       Hand=0.3),
    "StandZero": _both(ShoulderRoll=0.0087, ElbowRoll=-0.0087),
}  # fmt: skip

MODELS = {"nao": _nao(), "pepper": _pepper()}
