"""A mobile base as a robot: turned by cmd_vel, measured by odometry."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from doorway3ds.camera.model import wrapped_deg
from doorway3ds.robots.base import Robot, RobotLost, RobotPose, TurnEnd, TurnResult
from doorway3ds.ros.received import heading_of

_PERIOD_S = 0.04
_GAIN = 2.0  # rad/s per rad of what is left
_SLOWEST_RAD_S = 0.08
_RAMP_RAD_S2 = 1.0
_WITHIN_DEG = 0.7
_JUMP_DEG = 15.0  # more between two looks at the odometry than the base can turn: it was reset
_STILL_S = 0.3  # it has arrived once it has stayed there for this long


class Odometry:
    """The newest pose of the base; may be used from any thread."""

    def __init__(self) -> None:
        self._newest: tuple[float, RobotPose] | None = None

    def update(self, message: Any) -> None:
        """A nav_msgs/Odometry; one without a direction is left out."""
        pose = message.pose.pose
        try:
            heading = heading_of(pose.orientation)
        except ValueError:
            return
        where = RobotPose(float(pose.position.x), float(pose.position.y), heading)
        self._newest = (time.monotonic(), where)

    def pose(self, within_s: float) -> RobotPose | None:
        """Where the base is; None if no message came within so many seconds."""
        newest = self._newest
        if newest is None or time.monotonic() - newest[0] > within_s:
            return None
        return newest[1]


class BaseRobot(Robot):
    """Turns a base on the spot, closed over its odometry; it has no head and no voice.

    send: publishes a turning speed in rad/s, + left. eyes: why the base must not turn now, None if
    nothing speaks against it. speed_rad_s: never exceeded. odometry_s: lost after so long.
    """

    name = "cmd_vel"

    def __init__(
        self,
        odometry: Odometry,
        send: Callable[[float], None],
        eyes: Callable[[], str | None],
        *,
        speed_rad_s: float = 0.5,
        odometry_s: float = 0.5,
    ) -> None:
        self._odometry, self._send, self._eyes = odometry, send, eyes
        self.speed_rad_s, self.odometry_s = speed_rad_s, odometry_s
        self._lock = threading.Lock()
        self._stops = 0
        self._closed = False
        self.why = ""

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        """As `Robot.turn`; `why` then says what ended it, if it did not arrive."""
        begun_s = time.monotonic()
        with self._lock:
            stops = self._stops
        self.why = ""
        last_deg, last_s = self.pose().heading_deg, begun_s
        turned_deg = speed = 0.0
        inside_s: float | None = None
        end = TurnEnd.DONE
        try:
            while True:
                now = time.monotonic()
                where = self._odometry.pose(self.odometry_s)
                stopped = self._stops != stops or self._closed
                problem = None if where is not None else "no odometry comes"
                problem = problem or self._eyes()
                if where is None or problem is not None or stopped:
                    self.why = problem or "it was stopped"
                    end = TurnEnd.STOPPED if stopped else TurnEnd.LOST
                    break
                step_deg = wrapped_deg(where.heading_deg - last_deg)
                fastest_deg = 2 * math.degrees(self.speed_rad_s) * (now - last_s + _PERIOD_S)
                if abs(step_deg) > fastest_deg + _JUMP_DEG:
                    self.why, end = f"the odometry jumps by {step_deg:.0f} deg", TurnEnd.LOST
                    break
                turned_deg += step_deg
                last_deg, last_s = where.heading_deg, now
                left_deg = theta_deg - turned_deg
                if abs(left_deg) > _WITHIN_DEG:
                    inside_s = None
                    if now - begun_s > timeout_s:
                        self.why, end = f"it took more than {timeout_s:g} s", TurnEnd.TIMEOUT
                        break
                    speed = self._speed(left_deg, speed)
                else:
                    speed = 0.0
                    inside_s = now if inside_s is None else inside_s
                    if now - inside_s >= _STILL_S:
                        break
                self._publish(speed, stops)
                time.sleep(_PERIOD_S)
        finally:
            self._halt()
        return TurnResult(theta_deg, turned_deg, end, time.monotonic() - begun_s)

    def _speed(self, left_deg: float, before: float) -> float:
        """The next speed: towards what is left, no jump from the one before."""
        size = min(max(_GAIN * math.radians(abs(left_deg)), _SLOWEST_RAD_S), self.speed_rad_s)
        wanted = math.copysign(size, left_deg)
        step = _RAMP_RAD_S2 * _PERIOD_S
        faster = min(max(wanted, before - step), before + step)
        # Slowing down waits for nothing.
        return wanted if abs(wanted) < abs(faster) and wanted * faster > 0 else faster

    def _publish(self, speed: float, stops: int) -> None:
        """Sends a speed, unless the base has been told to stop since the turn began."""
        with self._lock:
            if self._stops == stops and not self._closed:
                self._send(speed)

    def stop(self) -> None:
        """Ends a turn and sends zero; nothing else follows it."""
        self._halt(1)

    def _halt(self, stops: int = 0, last: bool = False) -> None:
        with self._lock:
            self._stops += stops
            if not self._closed:
                self._send(0.0)
            self._closed |= last

    def pose(self) -> RobotPose:
        where = self._odometry.pose(self.odometry_s)
        if where is None:
            raise RobotLost(f"no odometry came within {self.odometry_s:g} s; nothing moves")
        return where

    def close(self) -> None:
        """Sends zero as the last thing ever; may be called twice."""
        self._halt(1, last=True)
