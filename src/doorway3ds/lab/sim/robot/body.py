"""The body of a simulated NAO or Pepper: how it turns, what it believes, where its cameras are.

No picture is made here, so that the body works without OpenGL.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from doorway3ds.camera.model import Array, Camera

Rng = np.random.Generator


class Clock(Protocol):
    def now(self) -> float: ...

    def sleep(self, seconds: float) -> None: ...


class RealClock:
    """The clock on the wall."""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


class FastClock:
    """Time that passes only by sleeping, at once."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        return self._now

    def sleep(self, seconds: float) -> None:
        self._now += max(0.0, seconds)


@dataclass(frozen=True)
class Model:
    """Geometry of a robot's head: metres from the turning axis on the floor, radians.

    neck: (forward, up). lens: camera name -> (forward, up from the neck, tilt down).
    yaw, pitch: joint limits; pitch + is down, as NAOqi has it.
    """

    name: str
    neck: tuple[float, float]
    lens: dict[str, tuple[float, float, float]]
    fov_deg: tuple[float, float]
    yaw: tuple[float, float]
    pitch: tuple[float, float]


# Cameras and joints: see camera.py for the sources; neck heights give the presets' lens heights.
MODELS = {
    "nao": Model(
        "nao",
        (0.0, 0.4564),
        {"CameraTop": (0.05871, 0.06364, 0.0209), "CameraBottom": (0.05071, 0.01774, 0.6929)},
        (60.9, 47.6),
        (-2.0857, 2.0857),
        (-0.6720, 0.5149),
    ),
    "pepper": Model(
        "pepper",
        (-0.038, 0.9869),
        {"CameraTop": (0.0868, 0.1631, 0.0), "CameraBottom": (0.0936, 0.0616, 0.6981)},
        (56.3, 43.7),
        (-2.0857, 2.0857),
        (-0.7068, 0.6371),
    ),
}


@dataclass(frozen=True)
class Gait:
    """speed_deg_s, speed_m_s: when walking; ramp_s: to start and to stop.

    slip: standard deviation of a turn's error as a share of it; slip_deg: what comes on top;
    most: the error is never more than this share of the turn plus slip_deg.
    """

    speed_deg_s: float = 28.0
    speed_m_s: float = 0.08
    ramp_s: float = 0.6
    slip: float = 0.06
    slip_deg: float = 0.5
    most: float = 0.16


@dataclass(frozen=True)
class _Move:
    number: int
    start_s: float
    took_s: float
    true_from: tuple[float, float, float]
    true_by: tuple[float, float, float]
    odometry_from: tuple[float, float, float]
    odometry_by: tuple[float, float, float]


class Body:
    """Stands, turns, walks a little and moves its head. All methods may be called from any thread.

    x, y, heading_deg: true place in the plan. The odometry begins at zero and knows no slip.
    """

    def __init__(
        self,
        x: float = 0.0,
        y: float = 0.0,
        heading_deg: float = 0.0,
        *,
        model: Model = MODELS["nao"],
        clock: Clock | None = None,
        rng: Rng | None = None,
        gait: Gait | None = None,
    ) -> None:
        self.model, self.clock = model, clock or RealClock()
        self.gait = gait or Gait()
        self._rng = rng or np.random.default_rng(0)
        self._lock = threading.RLock()
        self._true = (x, y, heading_deg)
        self._odometry = (0.0, 0.0, 0.0)
        self._move: _Move | None = None
        self._count = 0
        self._head = {"HeadYaw": (0.0, 0.0, 0.0, 1.0), "HeadPitch": (0.0, 0.0, 0.0, 1.0)}
        self.awake = False
        self.posture = "Crouch"
        self.stiffness = 0.0

    # The ground.

    def begin(self, forward_m: float, left_m: float, theta_rad: float) -> int:
        """Starts a move, which ends any other; returns its number."""
        with self._lock:
            self._settle()
            self._move = None
            asked = math.degrees(theta_rad)
            gait = self.gait
            error = self._rng.normal(0, gait.slip) * asked + self._rng.normal(0, gait.slip_deg)
            limit = gait.most * abs(asked) + gait.slip_deg
            # A robot that is asked for nothing does not step.
            error = float(np.clip(error, -limit, limit)) if asked else 0.0
            length = math.hypot(forward_m, left_m)
            took = max(abs(asked) / gait.speed_deg_s, length / gait.speed_m_s)
            took += gait.ramp_s if took > 0 else 0.0
            self._count += 1
            self._move = _Move(
                self._count, self.clock.now(), took, self._true,
                (*_turned(forward_m, left_m, self._true[2]), asked + error), self._odometry,
                (*_turned(forward_m, left_m, self._odometry[2]), asked),
            )  # fmt: skip
            return self._count

    def wait(self, number: int, slice_s: float = 0.02) -> bool:
        """Waits for the end of a move; whether it arrived, rather than was stopped or replaced."""
        while True:
            with self._lock:
                move = self._move
                if move is None or move.number != number:
                    return False
                left = move.start_s + move.took_s - self.clock.now()
                if left <= 0:
                    self._settle()
                    self._move = None
                    return True
            self.clock.sleep(min(slice_s, left) if isinstance(self.clock, RealClock) else left)

    def stop(self) -> None:
        with self._lock:
            self._settle()
            self._move = None

    @property
    def moving(self) -> bool:
        with self._lock:
            return self._move is not None and self._progress(self._move) < 1

    def place(self) -> tuple[float, float, float]:
        """True x, y and heading in degrees."""
        with self._lock:
            self._settle()
            return self._true

    def odometry(self) -> tuple[float, float, float]:
        """Where it believes it stands, from where it began: metres, degrees."""
        with self._lock:
            self._settle()
            return self._odometry

    def _progress(self, move: _Move) -> float:
        if move.took_s <= 0:
            return 1.0
        return min(1.0, max(0.0, (self.clock.now() - move.start_s) / move.took_s))

    def _settle(self) -> None:
        move = self._move
        if move is None:
            return
        share = self._progress(move)
        self._true = _along(move.true_from, move.true_by, share)
        self._odometry = _along(move.odometry_from, move.odometry_by, share)

    # The head.

    def aim(self, joint: str, angle: float, speed_rad_s: float) -> None:
        """Moves a head joint towards an angle, within its limits."""
        low, high = self.model.yaw if joint == "HeadYaw" else self.model.pitch
        with self._lock:
            now = self.angle(joint)
            self._head[joint] = (
                now, min(max(angle, low), high), self.clock.now(), max(speed_rad_s, 1e-3)
            )  # fmt: skip

    def angle(self, joint: str) -> float:
        with self._lock:
            start, goal, since, speed = self._head[joint]
            reach = speed * (self.clock.now() - since)
            return start + max(-reach, min(reach, goal - start))

    def transform(self, part: str, frame: int) -> Array:
        """(4, 4) of a camera or the head: x forward, y left, z up; frame as in NAOqi."""
        model = self.model
        head = _translation(model.neck[0], model.neck[1])
        head = head @ _about_z(self.angle("HeadYaw")) @ _about_y(self.angle("HeadPitch"))
        if part in model.lens:
            forward, up, tilt = model.lens[part]
            head = head @ _translation(forward, up) @ _about_y(tilt)
        elif part != "Head":
            raise ValueError(f"expected Head, {', '.join(model.lens)}, got {part}")
        if frame == 2:
            return head
        if frame == 0:
            return _translation(0.0, -_TORSO_M * model.neck[1]) @ head
        x, y, heading = self.odometry()
        world = _about_z(math.radians(heading))
        world[:2, 3] = x, y
        return world @ head

    def camera(self, width: int, height: int) -> Camera:
        name = {"nao": "nao-v5-top", "pepper": "pepper-top"}[self.model.name]
        return Camera.from_fov(width, height, *self.model.fov_deg, name)


_TORSO_M = 0.73
"""Height of the torso's origin as a share of the neck's."""


def _along(
    start: tuple[float, float, float], by: tuple[float, float, float], share: float
) -> tuple[float, float, float]:
    return start[0] + share * by[0], start[1] + share * by[1], start[2] + share * by[2]


def _turned(forward_m: float, left_m: float, heading_deg: float) -> tuple[float, float]:
    c, s = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    return c * forward_m - s * left_m, s * forward_m + c * left_m


def _translation(forward: float, up: float) -> Array:
    m = np.eye(4)
    m[0, 3], m[2, 3] = forward, up
    return m


def _about_z(angle: float) -> Array:
    m = np.eye(4)
    c, s = math.cos(angle), math.sin(angle)
    m[:2, :2] = [[c, -s], [s, c]]
    return m


def _about_y(angle: float) -> Array:
    m = np.eye(4)
    c, s = math.cos(angle), math.sin(angle)
    m[0, 0], m[0, 2], m[2, 0], m[2, 2] = c, s, -s, c
    return m
