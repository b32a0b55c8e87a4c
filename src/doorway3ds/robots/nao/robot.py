"""NAO and Pepper: prepared, turned and stopped through NAOqi.

Calls and their meaning are NAOqi 2.1 to 2.8's: radians, metres, + left; `moveTo` blocks until the
robot has arrived and is cut short by `stopMove` or by another client's move.
http://doc.aldebaran.com/2-8/naoqi/motion/control-walk-api.html
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable
from typing import Any

from doorway3ds.camera.model import wrapped_deg
from doorway3ds.errors import UserError
from doorway3ds.robots.base import (
    HALTING,
    Limits,
    RobotError,
    RobotLost,
    RobotPose,
    TurnEnd,
    TurnResult,
)
from doorway3ds.robots.nao.format import numbers
from doorway3ds.robots.nao.session import Naoqi, address

LIFE = "ALAutonomousLife"
POSTURE, POSTURE_SPEED = "StandInit", 0.5
HEAD = ["HeadYaw", "HeadPitch"]
HEAD_S = 1.0
AIM_S = 0.5
ARRIVED_DEG = 3.0
_PREPARE_S = 30.0
_STOP_S = 2.0
_POLL_MS = 50

_EVENTS = {
    "robotHasFallen": TurnEnd.FALLEN,
    "LeftBumperPressed": TurnEnd.BUMPER,
    "RightBumperPressed": TurnEnd.BUMPER,
    "BackBumperPressed": TurnEnd.BUMPER,
    "footContactChanged": TurnEnd.LIFTED,
}


class NaoRobot:
    """A robot at nao://host:port. Connecting moves nothing; see `prepare`.

    tell: is called with a line about what it changes of the robot's own life.
    """

    def __init__(
        self,
        uri: str,
        limits: Limits | None = None,
        timeout_s: float = 5.0,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        host, port = address(uri)
        self.name = f"nao://{host}:{port}"
        self.limits = limits or Limits()
        self._where = (host, port, timeout_s)
        self._halt: TurnEnd | None = None
        self._stopping = threading.Event()
        self._tell = tell
        self._life: str | None = None
        self._naoqi = Naoqi(host, port, timeout_s)
        try:
            for service in ("ALMotion", "ALRobotPosture", "ALMemory"):
                self._naoqi.service(service)
            self._naoqi.on(_EVENTS, self._react)
        except BaseException:
            self._naoqi.close()
            raise

    def prepare(self) -> None:
        """Autonomous life off until `close`, motors on, posture StandInit, head to zero."""
        self._halt = None
        self._stopping.clear()
        call = self._naoqi.call
        try:
            self._disable_life()
            if not call("ALMotion", "robotIsWakeUp"):
                call("ALMotion", "wakeUp", timeout_s=_PREPARE_S)
            call("ALMotion", "setStiffnesses", "Head", 1.0)
            stood = call(
                "ALRobotPosture", "goToPosture", POSTURE, POSTURE_SPEED, timeout_s=_PREPARE_S
            )
            if stood is False:
                raise RobotError(f"{self.name} did not reach the posture {POSTURE}")
            self._turn_head([0.0, 0.0], HEAD_S)
        except BaseException:
            self._quietly_stop()
            raise

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        if not math.isfinite(theta_deg) or abs(theta_deg) > self.limits.max_turn_deg + 1e-9:
            raise RobotError(
                f"turn angle must be finite and at most {self.limits.max_turn_deg:g} degrees, got "
                f"{theta_deg:g}"
            )
        began = time.monotonic()
        if self._halt is not None:
            return TurnResult(theta_deg, 0.0, self._halt, 0.0)
        self._stopping.clear()
        before = self.pose().heading_deg
        end = TurnEnd.LOST
        try:
            end = self._move(math.radians(theta_deg), began + timeout_s)
        except RobotLost:
            end = TurnEnd.LOST
        finally:
            # Also on Ctrl-C and on errors of ours: told to stop before anything else happens.
            if end is not TurnEnd.DONE and not self._quietly_stop():
                end = TurnEnd.LOST
        turned = self._turned_since(before) if end is not TurnEnd.LOST else None
        if end is TurnEnd.DONE and turned is not None and abs(turned - theta_deg) > ARRIVED_DEG:
            end = TurnEnd.STOPPED
        return TurnResult(theta_deg, turned, end, time.monotonic() - began)

    def aim(self, yaw_deg: float, pitch_deg: float) -> tuple[float, float] | None:
        yaw, pitch = self._numbers("getAngles", 2, HEAD, True)
        # NAOqi's pitch is + down; it clips to the joints' limits itself.
        self._turn_head([math.radians(yaw_deg), -math.radians(pitch_deg)], AIM_S)
        return math.degrees(yaw), -math.degrees(pitch)

    def stop(self) -> None:
        """Stops; over a new connection where the old one is gone.

        Raises RobotLost if the robot cannot be told.
        """
        self._stopping.set()
        self._on_any_connection("ALMotion", "stopMove")

    def pose(self) -> RobotPose:
        x, y, theta = self._numbers("getRobotPosition", 3, True)
        return RobotPose(x, y, math.degrees(theta))

    def say(self, text: str) -> None:
        self._naoqi.call("ALTextToSpeech", "say", text, timeout_s=_PREPARE_S)

    def rest(self) -> None:
        """Crouches and switches the motors off. Only ever called because a person asked.

        Autonomous life then stays off: it would wake the robot again.
        """
        self._naoqi.call("ALMotion", "rest", timeout_s=_PREPARE_S)
        if self._life is not None:
            self._tell(f"{self.name}: autonomous life stays disabled, since the robot rests")
            self._life = None

    def close(self) -> None:
        try:
            self._restore_life()
        finally:
            self._naoqi.close()

    def _disable_life(self) -> None:
        """Keeps the robot from moving on its own; remembers how it lived."""
        try:
            self._naoqi.service(LIFE)
        except RobotLost:
            raise
        except RobotError:
            return  # a robot without it does nothing on its own
        state = str(self._naoqi.call(LIFE, "getState"))
        if state == "disabled":
            return
        self._naoqi.call(LIFE, "setState", "disabled", timeout_s=_PREPARE_S)
        self._life = state
        self._tell(f"{self.name}: autonomous life was {state}, now disabled; restored at the end")

    def _restore_life(self) -> None:
        """Over a new connection where the old one is gone; a failure is told, not raised."""
        state, self._life = self._life, None
        if state is None:
            return
        wanted = state
        try:
            try:
                self._on_any_connection(LIFE, "setState", wanted, timeout_s=_PREPARE_S)
            except RobotLost:
                raise
            except RobotError:
                # Only an activity leads to some states: those follow from this one.
                wanted = "solitary"
                self._on_any_connection(LIFE, "setState", wanted, timeout_s=_PREPARE_S)
        except RobotError as error:
            self._tell(f"{self.name}: autonomous life could not be set back to {wanted}: {error}")
        else:
            self._tell(f"{self.name}: autonomous life is {wanted} again")

    def _numbers(self, method: str, size: int, *values: Any) -> list[float]:
        """ALMotion's answer; RobotError if it is not so many numbers."""
        answer = self._naoqi.call("ALMotion", method, *values)
        try:
            return numbers(f"{self.name}: ALMotion.{method}", answer, size)
        except UserError as error:
            raise RobotError(str(error)) from error

    def _on_any_connection(
        self, service: str, method: str, *values: Any, timeout_s: float = _STOP_S
    ) -> None:
        """Calls, and over a new connection where the old one is gone."""
        try:
            self._naoqi.call(service, method, *values, timeout_s=timeout_s)
        except RobotLost:
            host, port, _ = self._where
            again = Naoqi(host, port, _STOP_S)
            try:
                again.call(service, method, *values, timeout_s=timeout_s)
            finally:
                again.close()

    def _turn_head(self, angles: list[float], took_s: float) -> None:
        self._naoqi.call(
            "ALMotion", "angleInterpolation", HEAD, angles, [took_s, took_s], True,
            timeout_s=took_s + self._naoqi.timeout_s,
        )  # fmt: skip

    def _react(self, event: str, value: Any) -> None:
        """Bumper, fall or lost ground: stop at once, from the thread that hears of it."""
        touched = bool(value) if event != "footContactChanged" else not value
        if event == "robotHasFallen":
            touched = True
        if touched and self._halt is None:
            self._halt = _EVENTS[event]
            with contextlib.suppress(RobotError):
                self._naoqi.begin("ALMotion", "stopMove")

    def _move(self, theta_rad: float, deadline: float) -> TurnEnd:
        call = self._naoqi.begin("ALMotion", "moveTo", 0.0, 0.0, theta_rad)
        while not call.finished(_POLL_MS):
            if self._halt is not None:
                return self._halt
            if self._stopping.is_set():
                return TurnEnd.STOPPED
            if not self._naoqi.connected:
                return TurnEnd.LOST
            if time.monotonic() > deadline:
                return TurnEnd.TIMEOUT
        if self._halt in HALTING:
            return self._halt
        try:
            arrived = call.result(0.1)
        except RobotLost:
            raise
        except RobotError:
            return TurnEnd.STOPPED
        # NAOqi 2.1 returns nothing, later versions whether it arrived.
        return TurnEnd.STOPPED if arrived is False else TurnEnd.DONE

    def _turned_since(self, before_deg: float) -> float | None:
        try:
            return wrapped_deg(self.pose().heading_deg - before_deg)
        except RobotError:
            return None

    def _quietly_stop(self) -> bool:
        """Whether the robot could be told to stop."""
        try:
            self.stop()
        except RobotError:
            return False
        return True
