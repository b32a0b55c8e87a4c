"""Who turns: NAO and Pepper, the simulated robot, or nobody (a dry run)."""

from doorway3ds.robots.base import (
    Driver,
    DryRobot,
    Limits,
    Refused,
    Robot,
    RobotError,
    RobotLost,
    RobotPose,
    TurnEnd,
    TurnResult,
)

__all__ = [
    "Driver",
    "DryRobot",
    "Limits",
    "Refused",
    "Robot",
    "RobotError",
    "RobotLost",
    "RobotPose",
    "TurnEnd",
    "TurnResult",
]
