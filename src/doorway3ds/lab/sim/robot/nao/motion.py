"""ALMotion's joints and ALRobotPosture of a virtual NAO: radians and metres."""

from __future__ import annotations

from typing import Any

from doorway3ds.lab.sim.robot.model import angles_of
from doorway3ds.lab.sim.robot.nao.service import Service, each, returns
from doorway3ds.lab.sim.robot.nao.walk import Walk

_WAKE_S = 1.0


class Motion(Walk, name="ALMotion"):
    """ALMotion."""

    # Stiffness.

    def wakeUp(self) -> None:
        body = self._nao.body
        if not body.awake:
            took = _WAKE_S / 4 if body.posture.startswith("Stand") else _WAKE_S
            body.go(body.posture if body.posture.startswith("Stand") else "Stand", took)
            body.clock.sleep(took)
        body.awake = True
        self._nao.memory.raiseEvent("robotIsWakeUp", True)

    def rest(self, chain: str = "") -> None:
        """Crouches and goes limp; with a chain, only that goes limp."""
        body = self._nao.body
        if chain:
            self.setStiffnesses(chain, 0.0)
            return
        body.stop()
        if body.awake:
            body.go("Crouch", _WAKE_S)
            body.clock.sleep(_WAKE_S)
        self.setStiffnesses("Body", 0.0)
        body.awake = False
        self._nao.memory.raiseEvent("robotIsWakeUp", False)

    def robotIsWakeUp(self) -> bool:
        return self._nao.body.awake

    def setStiffnesses(self, names: Any, values: Any) -> None:
        joints = self._joints(names)
        for name, value in zip(joints, each("setStiffnesses", values, len(joints)), strict=True):
            self._nao.body.stiffen(name, float(value))
        if not self._legs_hold():
            self._nao.body.stop()

    @returns("[f]")
    def getStiffnesses(self, names: Any) -> list[float]:
        return [self._nao.body.stiffness(name) for name in self._joints(names)]

    def stiffnessInterpolation(self, names: Any, stiffnesses: Any, times: Any) -> None:
        joints = self._joints(names)
        steps = sorted(
            (when, name, value)
            for name, (whens, values) in zip(joints, _keys(joints, stiffnesses, times), strict=True)
            for when, value in zip(whens, values, strict=True)
        )
        past = 0.0
        for when, name, value in steps:
            self._nao.body.clock.sleep(when - past)
            self._nao.body.stiffen(name, value)
            past = when

    # Angles.

    @returns("[f]")
    def getAngles(self, names: Any, sensors: bool = True) -> list[float]:
        body = self._nao.body
        return [body.angle(n) if sensors else body.goal(n) for n in self._joints(names)]

    def setAngles(self, names: Any, angles: Any, fractions: Any) -> None:
        """Starts and does not wait."""
        joints = self._joints(names)
        self._towards(joints, each("setAngles", angles, len(joints)), fractions)

    def changeAngles(self, names: Any, changes: Any, fraction: Any) -> None:
        joints = self._joints(names)
        by = each("changeAngles", changes, len(joints))
        self._towards(
            joints, [self._nao.body.angle(j) + float(b) for j, b in zip(joints, by, strict=True)],
            fraction,
        )  # fmt: skip

    def angleInterpolation(self, names: Any, angles: Any, times: Any, absolute: bool = True
                           ) -> None:  # fmt: skip
        """Moves joints through angles, each reached at its time, and waits for the last."""
        body, joints = self._nao.body, self._joints(names)
        longest = 0.0
        for name, (whens, goals) in zip(joints, _keys(joints, angles, times), strict=True):
            base = 0.0 if absolute else body.angle(name)
            body.drive(name, whens, [base + goal for goal in goals])
            longest = max(longest, whens[-1])
        body.clock.sleep(longest)

    def angleInterpolationBezier(self, names: Any, times: Any, points: Any) -> None:
        """As `angleInterpolation`; of a control point the angle counts, not its handles."""
        angles = [[p[0] if isinstance(p, list | tuple) else p for p in line] for line in points]
        self.angleInterpolation(names, angles, times, True)

    def angleInterpolationWithSpeed(self, names: Any, angles: Any, fraction: float) -> None:
        joints = self._joints(names)
        goals = each("angleInterpolationWithSpeed", angles, len(joints))
        self._nao.body.clock.sleep(self._towards(joints, goals, fraction))

    def openHand(self, hand: str) -> None:
        self.angleInterpolationWithSpeed(hand, 1.0, 1.0)

    def closeHand(self, hand: str) -> None:
        self.angleInterpolationWithSpeed(hand, 0.0, 1.0)

    def killAll(self) -> None:
        self.stopMove()
        self._nao.body.freeze()

    # Where things are.

    @returns("[f]")
    def getTransform(self, name: str, frame: int, sensors: bool = True) -> list[float]:
        return [float(v) for v in self._nao.body.transform(name, int(frame)).ravel()]

    @returns("[f]")
    def getPosition(self, name: str, frame: int, sensors: bool = True) -> list[float]:
        m = self._nao.body.transform(name, int(frame))
        return [*(float(v) for v in m[:3, 3]), *angles_of(m)]

    def positionInterpolations(self, *given: Any) -> None:
        """Takes its time and moves nothing: there is no inverse kinematics.

        given: effectors, frames, paths, masks, times, then optionally whether they are absolute.
        """
        times = next((v for v in reversed(given) if not isinstance(v, bool)), 0.0)
        while isinstance(times, list | tuple):
            times = max((t[-1] if isinstance(t, list | tuple) else t for t in times), default=0.0)
        self._nao.body.clock.sleep(max(0.0, float(times)))

    positionInterpolation = transformInterpolation = positionInterpolations
    transformInterpolations = positionInterpolations

    @returns("[f]")
    def getCOM(self, name: str, frame: int, sensors: bool = True) -> list[float]:
        """Of the body it is taken for the torso."""
        part = "Torso" if name == "Body" else name
        return [float(v) for v in self._nao.body.transform(part, int(frame))[:3, 3]]

    # What there is.

    def getBodyNames(self, name: str) -> list[str]:
        return self._joints(name)

    getJointNames = getBodyNames

    def getSensorNames(self) -> list[str]:
        return list(self._nao.body.model.parts)

    def getLimits(self, name: str) -> list[list[float]]:
        """[[least, most (rad), speed (rad/s), torque (Nm)], ...]."""
        joints = (self._nao.body.model.joints[j] for j in self._joints(name))
        return [[float(v) for v in (j.low, j.high, j.speed, j.torque)] for j in joints]

    def getRobotConfig(self) -> list[list[Any]]:
        """[names, values]."""
        config = self._nao.body.model.config
        return [list(config), list(config.values())]

    def getSummary(self) -> str:
        body = self._nao.body
        lines = [f"{'joint':16}{'stiffness':>10}{'command':>9}{'sensor':>9}"]
        for j in body.model.joints:
            lines.append(f"{j:16}{body.stiffness(j):10.2f}{body.goal(j):9.4f}{body.angle(j):9.4f}")
        return "\n".join(lines)

    def getTaskList(self) -> list[list[Any]]:
        return [["Move", 1]] if self._nao.body.moving else []

    def _joints(self, names: Any) -> list[str]:
        model = self._nao.body.model
        out: list[str] = []
        for name in [names] if isinstance(names, str) else names:
            found = model.names(name)
            if not found:
                raise RuntimeError(
                    f"ALMotion: unknown joint {name}; expected {', '.join(model.joints)} or "
                    f"{', '.join(model.chains)}"
                )
            out += found
        return out

    def _towards(self, joints: list[str], goals: list[Any], fractions: Any) -> float:
        """Sends joints to angles; how long the slowest takes."""
        body, longest = self._nao.body, 0.0
        for name, goal, fraction in zip(
            joints, goals, each("fraction of the speed", fractions, len(joints)), strict=True
        ):
            if not 0 < float(fraction) <= 1:
                raise RuntimeError(
                    f"ALMotion: expected a fraction of speed in 0..1, got {fraction}"
                )
            limits = body.model.joints[name]
            end = min(max(float(goal), limits.low), limits.high)
            took = abs(end - body.angle(name)) / (limits.speed * float(fraction))
            body.drive(name, [took], [end])
            longest = max(longest, took)
        return longest


_FAMILIES = {
    "Crouch": "Crouching",
    "LyingBack": "LyingBack",
    "LyingBelly": "LyingBelly",
    "Sit": "Sitting",
    "SitRelax": "Sitting",
}


class Posture(Service, name="ALRobotPosture"):
    """ALRobotPosture."""

    def goToPosture(self, name: str, speed: float) -> bool:
        body = self._nao.body
        if name not in body.model.postures:
            return False
        family = self.getPostureFamily()
        stands = body.posture == name and body.awake
        took = 0.1 if stands else 0.6 / max(float(speed), 0.1)
        body.go(name, took)
        body.clock.sleep(took)
        body.awake = True
        memory = self._nao.memory
        memory.raiseEvent("PostureChanged", name)
        if self.getPostureFamily() != family:
            memory.raiseEvent("PostureFamilyChanged", self.getPostureFamily())
        return True

    applyPosture = goToPosture

    def getPosture(self) -> str:
        return self._nao.body.posture

    def getPostureFamily(self) -> str:
        return _FAMILIES.get(self._nao.body.posture, "Standing")

    def getPostureList(self) -> list[str]:
        return list(self._nao.body.model.postures)

    def getPostureFamilyList(self) -> list[str]:
        return sorted({_FAMILIES.get(n, "Standing") for n in self.getPostureList()})

    def stopMove(self) -> None:
        self._nao.body.freeze()


def _keys(joints: list[str], values: Any, times: Any) -> list[tuple[list[float], list[float]]]:
    """For each joint its times and values: each may have one or a list of them."""
    size = len(joints)
    lines, spans = values, times
    if size == 1 and isinstance(values, list | tuple) and not _nested(values):
        lines = [values]
    if size == 1 and isinstance(times, list | tuple) and not _nested(times):
        spans = [times]
    out = []
    for goals, whens in zip(each("values", lines, size), each("times", spans, size), strict=True):
        goals = [float(g) for g in (goals if isinstance(goals, list | tuple) else [goals])]
        whens = [float(t) for t in (whens if isinstance(whens, list | tuple) else [whens])]
        rising = all(a < b for a, b in zip([0.0, *whens], whens, strict=False))
        if len(goals) != len(whens) or not goals or not rising:
            raise RuntimeError(
                f"ALMotion: expected as many rising times as values for each joint, got {whens} "
                f"for {goals}"
            )
        out.append((whens, goals))
    return out


def _nested(values: Any) -> bool:
    return bool(values) and isinstance(values[0], list | tuple)
