"""ALMotion and ALRobotPosture of a virtual NAO: radians, metres, + left."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from doorway3ds.lab.sim.robot.naoservice import Service, returns

_JOINTS = ("HeadYaw", "HeadPitch")
_HEAD_SPEED = 1.5  # rad/s at full speed
_POSTURES = ("StandInit", "Stand", "StandZero", "Crouch")


class Motion(Service):
    """ALMotion."""

    def wakeUp(self) -> None:
        self._nao.body.awake, self._nao.body.stiffness = True, 1.0

    def rest(self) -> None:
        self._nao.body.stop()
        self._nao.body.awake, self._nao.body.stiffness = False, 0.0
        self._nao.body.posture = "Crouch"

    def robotIsWakeUp(self) -> bool:
        return self._nao.body.awake

    def setStiffnesses(self, names: Any, values: Any) -> None:
        first = values[0] if isinstance(values, list | tuple) else values
        self._nao.body.stiffness = float(first)

    def getStiffnesses(self, names: Any) -> list[float]:
        return [self._nao.body.stiffness for _ in _joints(names)]

    def getAngles(self, names: Any, sensors: bool) -> list[float]:
        return [self._nao.body.angle(name) for name in _joints(names)]

    def setAngles(self, names: Any, angles: Any, fraction: float) -> None:
        joints = _joints(names)
        for name, angle in zip(joints, _list(angles, len(joints)), strict=True):
            self._nao.body.aim(name, float(angle), float(fraction) * _HEAD_SPEED)

    def angleInterpolation(self, names: Any, angles: Any, times: Any, absolute: bool) -> None:
        body, joints = self._nao.body, _joints(names)
        goals, spans = _list(angles, len(joints)), _list(times, len(joints))
        longest = 0.0
        for name, goal, span in zip(joints, goals, spans, strict=True):
            # Each joint may have one goal or a list of them; the last one counts here.
            angle, took = float(_last(goal)), float(_last(span))
            angle += 0.0 if absolute else body.angle(name)
            body.aim(name, angle, abs(angle - body.angle(name)) / max(took, 1e-3))
            longest = max(longest, took)
        body.clock.sleep(longest)

    @returns("[f]")
    def getTransform(self, name: str, frame: int, sensors: bool) -> list[float]:
        return [float(v) for v in self._nao.body.transform(name, int(frame)).ravel()]

    @returns("[f]")
    def getPosition(self, name: str, frame: int, sensors: bool) -> list[float]:
        m = self._nao.body.transform(name, int(frame))
        angles = (
            math.atan2(m[2, 1], m[2, 2]),
            math.asin(float(np.clip(-m[2, 0], -1, 1))),
            math.atan2(m[1, 0], m[0, 0]),
        )
        return [*(float(v) for v in m[:3, 3]), *angles]

    @returns("[f]")
    def getRobotPosition(self, sensors: bool) -> list[float]:
        x, y, heading = self._nao.body.odometry()
        return [x, y, math.radians((heading + 180) % 360 - 180)]

    def moveInit(self) -> None:
        self._nao.body.posture = "StandInit"

    def moveTo(self, x: float, y: float, theta: float) -> bool:
        nao = self._nao
        if not nao.body.awake:
            raise RuntimeError("ALMotion::moveTo the robot is not awake")
        number = nao.body.begin(float(x), float(y), float(theta))
        if nao.faults.stuck:
            nao.body.stop()
            nao.released.wait(60)
            return False
        return nao.body.wait(number)

    def moveToward(self, x: float, y: float, theta: float) -> None:
        body, gait = self._nao.body, self._nao.body.gait
        if not body.awake:
            raise RuntimeError("ALMotion::moveToward the robot is not awake")
        if not any((x, y, theta)):
            body.stop()
            return
        span = 60.0  # it goes on until stopped; nobody lets it go on for longer
        body.begin(
            x * gait.speed_m_s * span, y * gait.speed_m_s * span,
            math.radians(theta * gait.speed_deg_s * span),
        )  # fmt: skip

    def stopMove(self) -> None:
        self._nao.body.stop()
        self._nao.released.set()
        self._nao.released.clear()

    def moveIsActive(self) -> bool:
        return self._nao.body.moving

    def waitUntilMoveIsFinished(self) -> None:
        while self._nao.body.moving:
            self._nao.body.clock.sleep(0.02)


class Posture(Service):
    """ALRobotPosture."""

    def goToPosture(self, name: str, speed: float) -> bool:
        body = self._nao.body
        if name not in _POSTURES:
            return False
        if body.posture != name:
            body.clock.sleep(0.6 / max(float(speed), 0.1))
        body.posture, body.awake, body.stiffness = name, True, 1.0
        for joint in _JOINTS:
            body.aim(joint, 0.0, _HEAD_SPEED)
        return True

    def getPosture(self) -> str:
        return self._nao.body.posture

    def getPostureList(self) -> list[str]:
        return list(_POSTURES)


def _joints(names: Any) -> list[str]:
    wanted = [names] if isinstance(names, str) else list(names)
    out: list[str] = []
    for name in wanted:
        out += _JOINTS if name in ("Head", "Body") else (name,)
    unknown = [name for name in out if name not in _JOINTS]
    if unknown:
        raise RuntimeError(f"ALMotion: unknown joint {unknown[0]}; this robot moves {_JOINTS}")
    return out


def _list(values: Any, size: int) -> list[Any]:
    out = list(values) if isinstance(values, list | tuple) else [values] * size
    if len(out) != size:
        raise RuntimeError(f"ALMotion: expected {size} values, got {len(out)}")
    return out


def _last(value: Any) -> Any:
    return value[-1] if isinstance(value, list | tuple) else value
