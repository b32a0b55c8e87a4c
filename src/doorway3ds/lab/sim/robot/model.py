"""The bodies of NAO V5 and Pepper: joints, links, limits, sensors' places and postures.

Metres and radians in NAOqi's frames (x forward, y left, z up). The numbers stand in bodies.yaml.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
import yaml

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
    of the cameras, across and down. config: as ALMotion reports it. sonars: name -> part; sonar_m:
    what they can tell. touches: event -> sensors. gait: name -> least, usual and most value of a
    walk's config.
    """

    name: str
    kind: str
    preset: str
    camera_model: int
    config: Mapping[str, Any]
    joints: Mapping[str, Joint]
    chains: Mapping[str, tuple[str, ...]]
    parts: Mapping[str, Part]
    soles: tuple[str, ...]
    postures: Mapping[str, Mapping[str, float]]
    radius_m: float
    fov_deg: tuple[float, float]
    sonars: Mapping[str, str]
    depth_fov_deg: tuple[float, float] | None
    grounded: Mapping[str, tuple[float, float]]
    sonar_m: tuple[float, float]
    touches: Mapping[str, tuple[str, ...]]
    gait: Mapping[str, tuple[float, float, float]]

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


def angles_of(m: Array) -> Vector:
    """Roll, pitch, yaw of a (4, 4), the inverse of `turned`."""
    pitch = math.asin(max(-1.0, min(1.0, -float(m[2, 0]))))
    return math.atan2(m[2, 1], m[2, 2]), pitch, math.atan2(m[1, 0], m[0, 0])


def turned(angles: Vector) -> Array:
    """(4, 4) of roll, pitch, yaw: yaw last, as NAOqi composes them."""
    roll, pitch, yaw = angles
    return about(_Z, yaw) @ about(_Y, pitch) @ about(_X, roll)


_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_AXES = {"X": _X, "Y": _Y, "Z": _Z}


def _model(name: str, about: dict[str, Any]) -> Model:
    """A robot of bodies.yaml."""
    joints = {
        joint: Joint(parent, offset, _AXES[axis] if isinstance(axis, str) else axis, *rest)
        for joint, (parent, offset, axis, *rest) in about.pop("joints").items()
    }
    chains = {**about.pop("chains"), "Body": "", "Actuators": ""}
    chains |= dict.fromkeys(("Joints", "JointActuators"), "(?!Wheel)")
    return Model(
        name=name,
        joints=joints,
        chains={
            chain: tuple(joint for joint in joints if re.match(begins, joint))
            for chain, begins in chains.items()
        },
        parts={part: Part(*placed) for part, placed in about.pop("parts").items()},
        postures={
            posture: _both(joints, angles) for posture, angles in about.pop("postures").items()
        },
        **about,
    )


def _both(joints: Mapping[str, Joint], angles: Mapping[str, float]) -> dict[str, float]:
    """The same on both sides; rolls, yaws of the arms and hip rolls have the side's sign."""
    out: dict[str, float] = {}
    for name, angle in angles.items():
        sign = -1.0 if "Roll" in name or name in ("ElbowYaw", "WristYaw") else 1.0
        both = {f"L{name}": angle, f"R{name}": sign * angle}
        out |= {name: angle} if name in joints else both
    return out


MODELS: dict[str, Model] = {
    name: _model(name, about)
    for name, about in yaml.safe_load(
        files(__package__).joinpath("bodies.yaml").read_text()
    ).items()
}
