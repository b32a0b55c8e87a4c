"""What ALMemory knows of a virtual NAO's devices: Device/SubDeviceList/... and who touches it.

http://doc.aldebaran.com/2-8/family/nao_technical/nao_dcm/actuator_sensor_names.html
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

_TOUCHES = {
    "FrontTactilTouched": ("Head/Touch/Front",),
    "MiddleTactilTouched": ("Head/Touch/Middle",),
    "RearTactilTouched": ("Head/Touch/Rear",),
    "ChestButtonPressed": ("ChestBoard/Button",),
    "HandLeftBackTouched": ("LHand/Touch/Back",),
    "HandRightBackTouched": ("RHand/Touch/Back",),
}
_OWN_TOUCHES: dict[str, dict[str, tuple[str, ...]]] = {
    "nao": {
        "LeftBumperPressed": ("LFoot/Bumper/Left", "LFoot/Bumper/Right"),
        "RightBumperPressed": ("RFoot/Bumper/Left", "RFoot/Bumper/Right"),
        **{
            f"Hand{side}{where}Touched": (f"{side[0]}Hand/Touch/{where}",)
            for side in ("Left", "Right")
            for where in ("Left", "Right")
        },
    },
    "pepper": {
        "LeftBumperPressed": ("Platform/FrontLeft/Bumper",),
        "RightBumperPressed": ("Platform/FrontRight/Bumper",),
        "BackBumperPressed": ("Platform/Back/Bumper",),
    },
}

SONAR_M = {"nao": (0.20, 2.55), "pepper": (0.30, 5.0)}
_G = 9.81


def touches(model: str) -> dict[str, tuple[str, ...]]:
    """A robot's events of touch, and the sensors that raise them."""
    return {**_TOUCHES, **_OWN_TOUCHES[model]}


def touch_sensors(model: str) -> list[str]:
    return [part for group in touches(model).values() for part in group]


def sonar(nao: VirtualNao, name: str) -> float:
    """Metres, within what the robot's sonars can tell."""
    least, most = SONAR_M[nao.body.model.name]
    return max(least, nao.body.sonar(nao.body.model.sonars[name], most))


def devices(nao: VirtualNao) -> dict[str, Callable[[], Any]]:
    """Key -> what reads it now."""
    body, base = nao.body, "Device/SubDeviceList/"
    out: dict[str, Callable[[], Any]] = {}
    for joint in body.model.joints:
        at = f"{base}{joint}/"
        out[f"{at}Position/Sensor/Value"] = partial(body.angle, joint)
        out[f"{at}Position/Actuator/Value"] = partial(body.goal, joint)
        out[f"{at}Hardness/Actuator/Value"] = partial(body.stiffness, joint)
        out[f"{at}ElectricCurrent/Sensor/Value"] = partial(_current, nao, joint)
        out[f"{at}Temperature/Sensor/Value"] = lambda: 38.0
        out[f"{at}Temperature/Sensor/Status"] = lambda: 0
    for name in body.model.sonars:
        if body.model.name == "nao":
            for echo in ("", *"123456789"):
                out[f"{base}US/{name}/Sensor/Value{echo}"] = partial(_echo, nao, name, echo)
        else:
            out[f"{base}Platform/{name}/Sonar/Sensor/Value"] = partial(sonar, nao, name)
    for part in touch_sensors(body.model.name):
        out[f"{base}{part}/Sensor/Value"] = partial(nao.touched.get, part, 0.0)
    out[f"{base}Battery/Charge/Sensor/Value"] = lambda: nao.charge() / 100
    out[f"{base}Battery/Charge/Sensor/TotalVoltage"] = lambda: 21.6 + 3.6 * nao.charge() / 100
    out[f"{base}Battery/Current/Sensor/Value"] = lambda: -1.2 if body.awake else -0.6
    out[f"{base}Battery/Temperature/Sensor/Value"] = lambda: 38.0
    for axis in "XYZ":
        gyro, acceleration = partial(_gyro, nao, axis), partial(_acceleration, nao, axis)
        for kind in ("Gyr", "Gyroscope"):
            out[f"{base}InertialSensor/{kind}{axis}/Sensor/Value"] = gyro
        for kind in ("Acc", "Accelerometer"):
            out[f"{base}InertialSensor/{kind}{axis}/Sensor/Value"] = acceleration
        out[f"{base}InertialSensor/Angle{axis}/Sensor/Value"] = partial(_lean, nao, axis)
    if body.model.name == "nao":
        for foot in "LR":
            for where in ("FrontLeft", "FrontRight", "RearLeft", "RearRight"):
                out[f"{base}{foot}Foot/FSR/{where}/Sensor/Value"] = partial(_weight, nao, 1 / 8)
            out[f"{base}{foot}Foot/FSR/TotalWeight/Sensor/Value"] = partial(_weight, nao, 1 / 2)
    return out


def _current(nao: VirtualNao, joint: str) -> float:
    return 0.1 * nao.body.stiffness(joint)


def _echo(nao: VirtualNao, name: str, echo: str) -> float:
    """The first echo; there is but one, and no echo is 0 in the keys of the later ones."""
    return sonar(nao, name) if echo in ("", "1") else 0.0


def _lean(nao: VirtualNao, axis: str) -> float:
    """How the torso leans, rad."""
    m = nao.body.transform("Torso", 2)
    if axis == "X":
        return math.atan2(m[2, 1], m[2, 2])
    if axis == "Y":
        return math.asin(max(-1.0, min(1.0, -m[2, 0])))
    return math.radians((nao.body.odometry()[2] + 180) % 360 - 180)


def _gyro(nao: VirtualNao, axis: str) -> float:
    return math.radians(nao.body.velocity()[2]) if axis == "Z" else 0.0


def _acceleration(nao: VirtualNao, axis: str) -> float:
    """Gravity in the torso's frame, m/s2; + up, so that a robot that stands reads -9.81 along Z."""
    return -_G * float(nao.body.transform("Torso", 2)[2, "XYZ".index(axis)])


def _weight(nao: VirtualNao, share: float) -> float:
    """kg on a sensor of a robot of 5.3 kg that stands on both feet."""
    standing = nao.body.posture not in nao.body.model.grounded
    return 5.3 * share if standing and nao.memory.getData("footContact") else 0.0
