"""ALMotion's walking of a virtual NAO: metres, radians, + left."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from doorway3ds.camera.model import wrapped_deg
from doorway3ds.lab.sim.robot.model import about, moved
from doorway3ds.lab.sim.robot.nao.service import Service, returns

if TYPE_CHECKING:
    pass

_ON_S = 60.0  # a walk without an end goes on until it is stopped; nobody lets it go on for longer


class Walk(Service):
    """What of ALMotion walks."""

    _arms = (True, True)

    def moveInit(self) -> None:
        body = self._nao.body
        self._stand("moveInit")
        if not body.posture.startswith("Stand"):
            body.go("StandInit", 0.6)
            body.clock.sleep(0.6)

    def moveTo(self, *given: Any) -> bool:
        """(x, y, theta), ([[x, y, theta], ...]), then optionally a time and a config.

        All poses are in the robot's frame at the start. Returns whether it arrived.
        """
        nao = self._nao
        poses, rest = _poses("moveTo", given)
        config = next((v for v in rest if isinstance(v, list | tuple)), [])
        seconds = next((float(v) for v in rest if not isinstance(v, list | tuple)), None)
        self.moveInit()
        if nao.faults.stuck:
            nao.body.stop()
            nao.released.wait(60)
            return False
        speed = self._speed(config)
        if seconds is not None and seconds <= 0:
            raise RuntimeError(f"ALMotion::moveTo expected a time above 0, got {seconds}")
        done = np.eye(3)
        for pose in poses:
            goal = _flat(*pose)
            step = np.linalg.inv(done) @ goal
            theta = math.atan2(step[1, 0], step[0, 0]) if len(poses) > 1 else pose[2]
            number = nao.body.begin(float(step[0, 2]), float(step[1, 2]), theta, speed)
            arrived = nao.body.wait(number)
            nao.sense()
            if not arrived:
                return False
            done = goal
        return True

    def move(self, x: float, y: float, theta: float, config: Any = ()) -> None:
        """m/s and rad/s, until stopped."""
        gait = self._nao.body.gait
        self._go(
            float(x) / gait.speed_m_s, float(y) / gait.speed_m_s,
            math.degrees(theta) / gait.speed_deg_s, (1.0, 1.0), "move",
        )  # fmt: skip

    def moveToward(self, x: float, y: float, theta: float, config: Any = ()) -> None:
        """Shares of the most, -1 to 1, until stopped."""
        x, y, theta = (min(max(float(v), -1.0), 1.0) for v in (x, y, theta))
        self._go(x, y, theta, self._speed(config), "moveToward")

    def setWalkTargetVelocity(
        self, x: float, y: float, theta: float, frequency: float, left: Any = (), right: Any = ()
    ) -> None:
        share = min(max(float(frequency), 0.0), 1.0)
        self.moveToward(float(x) * share, float(y) * share, float(theta) * share, left)

    def stopMove(self) -> None:
        self._nao.body.stop()
        self._nao.released.set()
        self._nao.released.clear()

    killMove = stopWalk = killWalk = stopMove
    walkInit, walkTo = moveInit, moveTo

    def moveIsActive(self) -> bool:
        return self._nao.body.moving

    def waitUntilMoveIsFinished(self) -> None:
        while self._nao.body.moving:
            self._nao.body.clock.sleep(0.02)

    walkIsActive, waitUntilWalkIsFinished = moveIsActive, waitUntilMoveIsFinished

    @returns("[f]")
    def getRobotPosition(self, sensors: bool = True) -> list[float]:
        x, y, heading = self._nao.body.odometry()
        return [x, y, math.radians(wrapped_deg(heading))]

    @returns("[f]")
    def getNextRobotPosition(self) -> list[float]:
        return self.getRobotPosition(True)  # type: ignore[no-any-return]

    @returns("[f]")
    def getRobotVelocity(self) -> list[float]:
        x, y, theta = self._nao.body.velocity()
        return [x, y, math.radians(theta)]

    def getMoveConfig(self, kind: str = "Default") -> list[list[Any]]:
        """[[name, value], ...] for "Min", "Default" or "Max"."""
        kinds = ("Min", "Default", "Max")
        which = kinds.index(self._one("getMoveConfig", kind, kinds))
        return [[name, v[which]] for name, v in self._nao.body.model.gait.items()]

    getFootGaitConfig = getMoveConfig

    def setMoveArmsEnabled(self, left: bool, right: bool) -> None:
        self._arms = bool(left), bool(right)

    def getMoveArmsEnabled(self, chain: str = "Arms") -> bool:
        return {"LArm": self._arms[0], "RArm": self._arms[1]}.get(chain, all(self._arms))

    setWalkArmsEnabled = setMoveArmsEnabled

    def getWalkArmsEnabled(self) -> list[bool]:
        return list(self._arms)

    def _stand(self, method: str) -> None:
        if not self._legs_hold():
            raise RuntimeError(f"ALMotion::{method} the robot is not awake: its legs are limp")

    def _legs_hold(self) -> bool:
        body = self._nao.body
        return all(body.stiffness(joint) > 0 for joint in body.model.chains["Legs"])

    def _go(self, x: float, y: float, theta: float, speed: tuple[float, float], method: str
            ) -> None:  # fmt: skip
        """Walks at shares of the gait's speed until stopped."""
        body, gait = self._nao.body, self._nao.body.gait
        self._stand(method)
        if not any((x, y, theta)):
            body.stop()
            return
        fast = max(math.hypot(x, y) * speed[0], abs(theta) * speed[1])
        body.begin(
            x * gait.speed_m_s * speed[0] * _ON_S, y * gait.speed_m_s * speed[0] * _ON_S,
            math.radians(theta * gait.speed_deg_s * speed[1] * _ON_S), (fast, fast), True,
        )  # fmt: skip

    def _speed(self, config: Any) -> tuple[float, float]:
        """Factors on walking and turning by a config of [name, value] pairs."""
        known = self._nao.body.model.gait
        share = {}
        for pair in config:
            if not isinstance(pair, list | tuple) or len(pair) != 2 or pair[0] not in known:
                raise RuntimeError(
                    f"ALMotion: expected a move config of [name, value] with {', '.join(known)}, "
                    f"got {pair}"
                )
            least, usual, most = known[pair[0]]
            share[pair[0]] = min(max(float(pair[1]), least, 1e-3), most) / (usual or 1.0)
        pace = share.get("MaxStepFrequency", 1.0)
        walks = share.get("MaxStepX", 1.0) * share.get("MaxVelXY", 1.0)
        turns = share.get("MaxStepTheta", 1.0) * share.get("MaxVelTheta", 1.0)
        return walks * pace, turns * pace


def _poses(method: str, given: tuple[Any, ...]) -> tuple[list[list[float]], tuple[Any, ...]]:
    """The poses of a walk's arguments, and what follows them."""
    if given and isinstance(given[0], list | tuple):
        first = given[0]
        lines = first if first and isinstance(first[0], list | tuple) else [first]
        rest = given[1:]
    else:
        lines, rest = [given[:3]], given[3:]
    poses = [[float(v) for v in line] for line in lines]
    if not poses or any(len(p) != 3 or not all(map(math.isfinite, p)) for p in poses):
        raise RuntimeError(
            f"ALMotion::{method} expected x, y, theta or a list of those, got {given}"
        )
    return poses, rest


def _flat(x: float, y: float, theta: float) -> np.ndarray:
    """(3, 3) of a pose on the floor."""
    m = moved((x, y, 0.0)) @ about((0.0, 0.0, 1.0), theta)
    return m[np.ix_([0, 1, 3], [0, 1, 3])]


class Navigation(Service, name="ALNavigation"):
    """ALNavigation: goes straight, as ALMotion does; plans no way round things, maps nothing."""

    def navigateTo(self, x: float, y: float, theta: float = 0.0, config: Any = ()) -> bool:
        """Whether it arrived."""
        return bool(self._nao.services["ALMotion"].moveTo(x, y, theta))

    def moveAlong(self, trajectory: Any) -> bool:
        """Along ["Holonomic", ["Line", [x, y]], theta, seconds] or ["Composed", ...] of those."""
        kind, *parts = trajectory
        if kind == "Composed":
            return all(self.moveAlong(part) for part in parts)
        (shape, (x, y, *_)), theta = parts[:2]
        if shape != "Line":
            raise RuntimeError(f"ALNavigation::moveAlong expected a Line, got {shape}")
        return self.navigateTo(float(x), float(y), float(theta))

    def stopNavigateTo(self) -> None:
        self._nao.services["ALMotion"].stopMove()

    def navigateToInMap(self, target: Any) -> int:
        """0: it arrived; nothing is mapped, so the target counts from where it stands."""
        return 0 if self.navigateTo(*(float(v) for v in target)) else 1

    def findFreeZone(self, radius: float, restricted: float) -> list[Any]:
        """[error, radius (m), [x, y, 0]]: where it stands."""
        return [0, float(radius), [0.0, 0.0, 0.0]]

    getFreeZone = stopAndComputeFreeZone = findFreeZone
