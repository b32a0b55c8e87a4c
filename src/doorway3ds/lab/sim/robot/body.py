"""The body of a simulated NAO or Pepper: how it moves, what it believes, where its parts are.

No image is made here, so that the body works without OpenGL.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from doorway3ds.camera.model import Array, Camera, wrapped_deg
from doorway3ds.lab.sim.robot.ground import STEP_M, Ground
from doorway3ds.lab.sim.robot.model import MODELS, Model, about, moved

Rng = np.random.Generator


class Clock(Protocol):
    def now(self) -> float: ...

    def sleep(self, seconds: float) -> None: ...


class RealClock:
    """The clock on the wall. rate: seconds of the robot's in one of ours."""

    def __init__(self, rate: float = 1.0) -> None:
        self._rate = rate

    def now(self) -> float:
        return time.monotonic() * self._rate

    def sleep(self, seconds: float) -> None:
        time.sleep(max(0.0, seconds) / self._rate)


class FastClock:
    """Time that passes only by sleeping, at once."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        return self._now

    def sleep(self, seconds: float) -> None:
        self._now += max(0.0, seconds)


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


Place = tuple[float, float, float]
"""x and y in metres, heading in degrees."""

_TWINS = {"LHipYawPitch": "RHipYawPitch", "RHipYawPitch": "LHipYawPitch"}
"""One motor turns both."""


@dataclass(frozen=True)
class _Move:
    """by: forward, left (metres) and turn (degrees) in the frame that it starts in.

    slip_deg: what it truly turns beyond that. arc: at a constant velocity of the body, which a
    straight way with a turn on it is not. until: the share after which it touches something, 1 for
    never. touches_deg: the plan bearing of what it touches.
    """

    number: int
    start_s: float
    took_s: float
    true_from: Place
    odometry_from: Place
    by: Place
    slip_deg: float
    arc: bool
    until: float = 1.0
    touches_deg: float | None = None

    def true(self, share: float) -> Place:
        forward, left, turn = self.by
        return _along(self.true_from, (forward, left, turn + self.slip_deg), share, self.arc)

    def odometry(self, share: float) -> Place:
        return _along(self.odometry_from, self.by, share, self.arc)


class Body:
    """Stands, turns, walks and moves its joints. All methods may be called from any thread.

    It begins as a person has put it down: standing, its motors off.
    x, y, heading_deg: true place in the plan. The odometry begins at zero and knows no slip.
    ground: what it can walk into; None: nothing.
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
        ground: Ground | None = None,
    ) -> None:
        self.model, self.clock = model, clock or RealClock()
        self.gait = gait or Gait()
        self.ground = ground
        self._rng = rng or np.random.default_rng(0)
        self._lock = threading.RLock()
        self._true: Place = (x, y, heading_deg)
        self._odometry: Place = (0.0, 0.0, 0.0)
        self._move: _Move | None = None
        self._count = self._arrived = 0
        self._touch: float | None = None
        self._tracks: dict[str, tuple[list[float], list[float]]] = {}
        self._stiffness = dict.fromkeys(model.joints, 0.0)
        self.awake = False
        self.posture = "Stand"
        for joint in model.joints:
            self.aim(joint, model.postures["Stand"].get(joint, 0.0), math.inf)

    # The ground.

    def begin(
        self,
        forward_m: float,
        left_m: float,
        theta_rad: float,
        speed: tuple[float, float] = (1.0, 1.0),
        arc: bool = False,
    ) -> int:
        """Starts a move, which ends any other; returns its number.

        speed: factors on the gait's speed of walking and of turning. arc: at a constant velocity.
        """
        with self._lock:
            self.stop()
            asked = math.degrees(theta_rad)
            gait = self.gait
            error = self._rng.normal(0, gait.slip) * asked + self._rng.normal(0, gait.slip_deg)
            limit = gait.most * abs(asked) + gait.slip_deg
            # A robot that is asked for nothing does not step.
            error = float(np.clip(error, -limit, limit)) if asked else 0.0
            length = math.hypot(forward_m, left_m)
            took = max(abs(asked) / (gait.speed_deg_s * speed[1]),
                       length / (gait.speed_m_s * speed[0]))  # fmt: skip
            took += gait.ramp_s if took > 0 else 0.0
            self._count += 1
            move = _Move(
                self._count, self.clock.now(), took, self._true, self._odometry,
                (forward_m, left_m, asked), error, arc,
            )  # fmt: skip
            if length > 0:
                self._touch = None
                if self.ground is not None:
                    share = np.linspace(0.0, 1.0, max(1, math.ceil(length / STEP_M)) + 1)
                    way = np.array([move.true(float(s))[:2] for s in share])
                    stop, touches = self.ground.reach(way, self.model.radius_m)
                    if touches is not None:
                        move = replace(move, until=float(share[stop]), touches_deg=touches)
            self._move = move
            return self._count

    def wait(self, number: int, slice_s: float = 0.02) -> bool:
        """Waits for the end of a move.

        Returns whether it arrived, rather than was stopped, replaced or blocked.
        """
        while True:
            with self._lock:
                self._settle()
                move = self._move
                if move is None or move.number != number:
                    return self._arrived == number
                left = move.start_s + move.took_s * move.until - self.clock.now()
            self.clock.sleep(min(slice_s, left) if isinstance(self.clock, RealClock) else left)

    def stop(self) -> None:
        with self._lock:
            self._settle()
            self._move = None

    @property
    def moving(self) -> bool:
        with self._lock:
            self._settle()
            return self._move is not None

    @property
    def touch_deg(self) -> float | None:
        """The bearing, + left, of what blocked the last walk; None after a walk that was free."""
        with self._lock:
            self._settle()
            return self._touch

    def place(self) -> Place:
        """True x, y and heading in degrees."""
        with self._lock:
            self._settle()
            return self._true

    def odometry(self) -> Place:
        """Where it believes it stands, from where it began: metres, degrees."""
        with self._lock:
            self._settle()
            return self._odometry

    def velocity(self) -> Place:
        """m/s and deg/s in its own frame, zero while it stands."""
        with self._lock:
            self._settle()
            move = self._move
            if move is None or move.took_s <= 0:
                return 0.0, 0.0, 0.0
            x, y, turn = (v / move.took_s for v in move.by)
            turned = 0.0 if move.arc else move.odometry_from[2] - self._odometry[2]
            return (*_turned(x, y, turned), turn)

    def sonar(self, part: str, most_m: float) -> float:
        """Metres from an ultrasonic sensor to the nearest thing before it, at most `most_m`."""
        if self.ground is None:
            return most_m
        m = self.transform(part, 2)
        x, y, heading = self.place()
        dx, dy = _turned(float(m[0, 3]), float(m[1, 3]), heading)
        yaw = math.degrees(math.atan2(m[1, 0], m[0, 0]))
        return self.ground.range(x + dx, y + dy, heading + yaw, most_m)

    def _settle(self) -> None:
        """Where the move has got to by now, and whether it is over."""
        move = self._move
        if move is None:
            return
        share = 1.0
        if move.took_s > 0:
            share = max(0.0, (self.clock.now() - move.start_s) / move.took_s)
        over = share >= move.until - 1e-9
        share = min(share, move.until)
        self._true, self._odometry = move.true(share), move.odometry(share)
        if over:
            self._move = None
            if move.touches_deg is None:
                self._arrived = move.number
            else:
                self._touch = wrapped_deg(move.touches_deg - self._true[2])

    # The joints.

    def aim(self, joint: str, angle: float, speed_rad_s: float) -> None:
        """Moves a joint towards an angle, within its limits, whether or not it is stiff."""
        with self._lock:
            now = self.angle(joint)
            limits = self.model.joints[joint]
            goal = min(max(angle, limits.low), limits.high)
            self._play(joint, [abs(goal - now) / max(speed_rad_s, 1e-3)], [goal])

    def drive(self, joint: str, times_s: Sequence[float], angles: Sequence[float]) -> None:
        """Moves a joint through angles, each reached that long from now; a limp one stays."""
        limits = self.model.joints[joint]
        goals = [min(max(angle, limits.low), limits.high) for angle in angles]
        with self._lock:
            if self._stiffness[joint] > 0:
                self._play(joint, times_s, goals)

    def freeze(self) -> None:
        """Stops every joint where it is."""
        with self._lock:
            for joint in self.model.joints:
                self._play(joint, [0.0], [self.angle(joint)])

    def angle(self, joint: str) -> float:
        with self._lock:
            times, angles = self._tracks.get(joint, ([0.0], [0.0]))
            return float(np.interp(self.clock.now(), times, angles))

    def angles(self) -> dict[str, float]:
        with self._lock:
            return {joint: self.angle(joint) for joint in self.model.joints}

    def goal(self, joint: str) -> float:
        """The angle that the joint was last sent to."""
        with self._lock:
            return self._tracks[joint][1][-1]

    def stiffness(self, joint: str) -> float:
        return self._stiffness[joint]

    def stiffen(self, joint: str, value: float) -> None:
        """From 0, limp, to 1; a joint that goes limp stays where it is."""
        with self._lock:
            self._stiffness[joint] = min(max(value, 0.0), 1.0)
            if value <= 0:
                self._play(joint, [0.0], [self.angle(joint)])

    def go(self, posture: str, took_s: float) -> None:
        """Goes to a posture, all joints stiff; KeyError for another name."""
        angles = self.model.postures[posture]
        with self._lock:
            for joint in self.model.joints:
                self._stiffness[joint] = 1.0
                self._play(joint, [took_s], [angles.get(joint, 0.0)])
            self.posture = posture

    def _play(self, joint: str, times_s: Sequence[float], angles: Sequence[float]) -> None:
        now = self.clock.now()
        track = [now, *(now + t for t in times_s)], [self.angle(joint), *angles]
        if times_s[-1] <= 0:
            track = [now], [angles[-1]]
        self._tracks[joint] = track
        if joint in _TWINS:
            self._tracks[_TWINS[joint]] = track

    def transform(self, part: str, frame: int) -> Array:
        """(4, 4) of a joint, a chain's end, a sensor or the torso; frame as in NAOqi.

        Raises ValueError for another name.
        """
        angles = self.angles()
        try:
            inside = self.model.frame(part, angles)
        except KeyError as error:
            known = ", ".join((*self.model.parts, *self.model.joints, "Torso"))
            raise ValueError(f"expected a part of {known}, got {part}") from error
        if frame == 0:
            return inside
        robot = self._torso(angles) @ inside
        if frame == 2:
            return robot
        x, y, heading = self.odometry()
        return moved((x, y, 0.0)) @ about((0.0, 0.0, 1.0), math.radians(heading)) @ robot

    def _torso(self, angles: Mapping[str, float]) -> Array:
        """(4, 4) of the torso in the robot's frame."""
        lying = self.model.grounded.get(self.posture)
        if lying is None:
            return np.asarray(np.linalg.inv(self.model.stance(angles)))
        height, pitch = lying
        return moved((0.0, 0.0, height)) @ about((0.0, 1.0, 0.0), pitch)

    def camera(self, width: int, height: int, part: str = "CameraTop") -> Camera:
        depth = self.model.depth_fov_deg if part == "CameraDepth" else None
        return Camera.from_fov(width, height, *(depth or self.model.fov_deg), self.model.preset)


def _along(start: Place, by: Place, share: float, arc: bool) -> Place:
    forward, left, turn = (share * v for v in by)
    angle = math.radians(turn)
    if arc and abs(angle) > 1e-9:
        ahead, aside = math.sin(angle) / angle, (1 - math.cos(angle)) / angle
        forward, left = ahead * forward - aside * left, aside * forward + ahead * left
    dx, dy = _turned(forward, left, start[2])
    return start[0] + dx, start[1] + dy, start[2] + turn


def _turned(forward_m: float, left_m: float, heading_deg: float) -> tuple[float, float]:
    c, s = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    return c * forward_m - s * left_m, s * forward_m + c * left_m
