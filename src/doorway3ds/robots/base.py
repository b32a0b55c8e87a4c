"""What every robot can do, and the one gate through which all motion goes.

A robot turns on the spot and nothing else. `Driver` is the only caller of `Robot.turn`: it holds
the permission to move, the limits and the decision's time-to-live, so that no other code has to.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Protocol

from doorway3ds.arguments import require, require_number, shown
from doorway3ds.compat import StrEnum
from doorway3ds.errors import CallError, UserError


class RobotError(UserError):
    """The robot cannot do what was asked."""


class RobotLost(RobotError):
    """The connection to the robot is gone; whether it still moves is not known."""


class Refused(RobotError):
    """A motion that the limits, the permission or the decision's age forbid. Nothing moved."""


class TurnEnd(StrEnum):
    """How a turn ended. After each but `lost` the robot stands still."""

    DONE = "done"  # by its own account it arrived
    STOPPED = "stopped"  # somebody else stopped it, or it gave up
    TIMEOUT = "timeout"  # it took longer than allowed and was stopped
    BUMPER = "bumper"  # a bumper was pressed
    FALLEN = "fallen"  # it fell
    LIFTED = "lifted"  # its feet left the ground
    LOST = "lost"  # the connection is gone
    DRY = "dry"  # no motion was allowed: nothing moved


HALTING = (TurnEnd.BUMPER, TurnEnd.FALLEN, TurnEnd.LIFTED)
"""Ends after which nothing may move until a person has looked."""


@dataclass(frozen=True)
class RobotPose:
    """Where the robot believes it stands: metres and degrees in its own odometry."""

    x_m: float
    y_m: float
    heading_deg: float


@dataclass(frozen=True)
class TurnResult:
    """One turn. turned_deg: by odometry, None if it could not be read afterwards."""

    asked_deg: float
    turned_deg: float | None
    end: TurnEnd
    took_s: float


@dataclass(frozen=True)
class Limits:
    """What no caller can exceed.

    max_turn_deg: of one turn. max_turns, max_total_deg: of one run, over all turns.
    ttl_s: a decision older than this, counted from its image's exposure, moves nothing.
    turn_timeout_s: a turn that takes longer is stopped.
    """

    max_turn_deg: float = 60.0
    max_turns: int = 40
    max_total_deg: float = 900.0
    ttl_s: float = 2.0
    turn_timeout_s: float = 20.0

    def __post_init__(self) -> None:
        for name in ("max_turn_deg", "max_turns", "max_total_deg", "ttl_s", "turn_timeout_s"):
            value = getattr(self, name)
            require(name, value, Real, "a positive number")
            if not 0 < value < math.inf:
                raise CallError(f"{name} must be a positive number, got {value:g}")


class Robot(Protocol):
    """A robot that turns on the spot: the protocol that your own robot follows.

    Methods raise RobotError or RobotLost, nothing else. Those that a robot derived from this leaves
    out do nothing.

    >>> class Mine(DryRobot):
    ...     name = "mine"
    >>> robot: Robot = Mine()
    >>> robot.turn(20.0, timeout_s=5.0).turned_deg
    0.0
    """

    @property
    def name(self) -> str: ...

    def prepare(self) -> None:
        """Stands up and looks ahead. This moves the robot."""
        return

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        """Turns by `theta_deg`, + left, and returns when it stands again.

        Whatever ends it, also an exception or Ctrl-C, the robot has been told to stop.
        """
        ...

    def aim(self, yaw_deg: float, pitch_deg: float) -> tuple[float, float] | None:
        """Turns the head, + left and + up, as far as it goes; returns when it is there.

        Returns where the head was before, None if there is no head to turn.
        """
        return None

    def stop(self) -> None:
        """Stops all motion. Allowed at any time and from any thread."""
        return

    def pose(self) -> RobotPose: ...

    def say(self, text: str) -> None:
        """Speaks."""
        return

    def close(self) -> None:
        """Lets go of the robot; may be called twice. Never makes it rest or sit."""
        return


class DryRobot(Robot):
    """No robot: nothing ever moves."""

    name = "dry"

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        return TurnResult(theta_deg, 0.0, TurnEnd.DRY, 0.0)

    def pose(self) -> RobotPose:
        return RobotPose(0.0, 0.0, 0.0)


class Driver:
    """The gate to a robot's motion.

    >>> driver = Driver(DryRobot())
    >>> driver.turn(20.0, stamp_s=time.monotonic()).end
    <TurnEnd.DRY: 'dry'>

    Args:
        robot: that turns.
        move: without it nothing moves, whatever is asked.
        limits: of one turn and of the run.
        clock: the clock of the frames' stamps.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        move: bool = False,
        limits: Limits | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not (callable(getattr(robot, "turn", None)) and hasattr(robot, "stop")):
            raise CallError(f"robot must follow the protocol Robot, got {shown(robot)}")
        require("move", move, bool, "True or False")
        require("limits", limits, (Limits, type(None)), "Limits or None")
        self.robot, self.move, self.limits = robot, move, limits or Limits()
        self._clock = clock
        self.turns = 0
        self.total_deg = 0.0
        self._halted: TurnEnd | None = None

    def __repr__(self) -> str:
        return f"<Driver of {self.robot.name}, {'may' if self.move else 'may not'} move>"

    def prepare(self) -> None:
        if self.move:
            self.robot.prepare()

    def clamp(self, theta_deg: float) -> float:
        """The nearest angle that one turn may have."""
        require_number("theta_deg", theta_deg)
        return max(-self.limits.max_turn_deg, min(self.limits.max_turn_deg, theta_deg))

    def age_s(self, stamp_s: float) -> float:
        """Age of a decision on an image of that stamp."""
        return self._clock() - stamp_s

    def turn(self, theta_deg: float, stamp_s: float) -> TurnResult:
        """Turns for a decision whose image was taken at `stamp_s`.

        Raises Refused, before anything moves, for an angle that is no number or too large, a
        decision that is too old or from the future, a run that has turned enough, or a robot
        that fell or bumped before.
        """
        require("theta_deg", theta_deg, Real, "an angle in degrees")
        require_number("stamp_s", stamp_s)
        limits = self.limits
        if not math.isfinite(theta_deg) or abs(theta_deg) > limits.max_turn_deg + 1e-9:
            raise Refused(
                f"turn angle must be finite and at most {limits.max_turn_deg:g} degrees, got "
                f"{theta_deg:g}"
            )
        if not self.move:
            return TurnResult(theta_deg, 0.0, TurnEnd.DRY, 0.0)
        if self._halted is not None:
            raise Refused(f"the robot is halted ({self._halted}): look after it, then start again")
        age = self.age_s(stamp_s)
        if not 0 <= age <= limits.ttl_s:
            raise Refused(
                f"the decision is {age:.2f} s old; it must be from 0 to {limits.ttl_s:g} s old"
            )
        if self.turns >= limits.max_turns or self.total_deg + abs(theta_deg) > limits.max_total_deg:
            raise Refused(
                f"this run has turned {self.turns} times by {self.total_deg:.0f} deg; the limits "
                f"are {limits.max_turns} times and {limits.max_total_deg:g} deg"
            )
        self.turns += 1
        self.total_deg += abs(theta_deg)
        result = self.robot.turn(theta_deg, limits.turn_timeout_s)
        if result.end in HALTING:
            self._halted = result.end
        return result

    def aim(self, yaw_deg: float, pitch_deg: float) -> tuple[float, float] | None:
        """Turns the head, as `Robot.aim`; not without permission, nor on a halted robot."""
        if not self.move or self._halted is not None:
            return None
        return self.robot.aim(yaw_deg, pitch_deg)

    def stop(self) -> None:
        """Stops the robot if it was ever allowed to move."""
        if self.move:
            self.robot.stop()
