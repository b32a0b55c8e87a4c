"""The node's parameters: the settings of the commands, and some of its own."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum
from typing import Any, TypeVar, get_type_hints

from doorway3ds.camera.options import CameraOptions
from doorway3ds.decide.options import DecideOptions
from doorway3ds.errors import CallError
from doorway3ds.options import Options, Setting, setting, settings_of
from doorway3ds.robots.options import MotionOptions

T = TypeVar("T", bound=Options)


@dataclass(frozen=True)
class TopicOptions(Options):
    """How images come, and what frames are called."""

    image_transport: str = setting(
        "raw", "Kind of the image topic: raw or compressed.", choices=("raw", "compressed")
    )
    robot_frame: str = setting(
        "base_footprint", "The robot's frame, on the floor under its turning axis."
    )
    use_tf: bool = setting(True, "Ask tf2 for the camera's pose, where tf2 is installed.")


@dataclass(frozen=True)
class MountOptions(CameraOptions):
    """The camera and where it sits, as far as camera_info and tf2 do not tell."""

    yaw_deg: float | None = setting(None, "Yaw of the camera, + left.", low=-180, high=180)
    forward_m: float | None = setting(
        None, "Distance of the lens in front of the turning axis.", low=-5, high=5
    )
    left_m: float | None = setting(
        None, "Distance of the lens to the left of the turning axis.", low=-5, high=5
    )


@dataclass(frozen=True)
class BaseOptions(MotionOptions):
    """Whether and how a base turns."""

    turn_speed: float = setting(0.5, "Fastest turn, rad/s.", low=0.1, high=3)
    stamped_twist: bool = setting(False, "Send TwistStamped on cmd_vel instead of Twist.")
    odom_timeout_s: float = setting(
        0.5, "Stop a turn if no odometry comes for this long.", low=0.1, high=5
    )
    image_timeout_s: float = setting(
        1.0, "Stop a turn if no image arrives for this long.", low=0.1, high=10
    )


GROUPS: tuple[type[Options], ...] = (TopicOptions, MountOptions, DecideOptions, BaseOptions)
_UNUSED = frozenset({"blocked_s"})  # of loops that wait, which the node has not
_FIXED = frozenset(
    {"move", "stamped_twist", "camera", "fov_deg"}
    | settings_of(TopicOptions).keys()
    | settings_of(DecideOptions).keys()
)
"""Set at the start only."""


def declare(node: Any) -> None:
    """Declares every parameter with its help and bounds.

    Raises CallError for a value of the command line that is out of bounds or of another kind.
    """
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
    from rclpy.exceptions import (
        InvalidParameterTypeException,
        InvalidParameterValueException,
    )
    from rclpy.parameter import Parameter

    types = {
        bool: Parameter.Type.BOOL, int: Parameter.Type.INTEGER, float: Parameter.Type.DOUBLE,
        str: Parameter.Type.STRING,
    }  # fmt: skip
    for name, (kind, default, known) in table().items():
        about = ParameterDescriptor(description=known.help, read_only=name in _FIXED)
        if known.low is not None and known.high is not None:
            if kind is int:
                bounds = IntegerRange(from_value=int(known.low), to_value=int(known.high), step=1)
                about.integer_range = [bounds]
            else:
                low, high = float(known.low), float(known.high)
                about.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        try:
            node.declare_parameter(name, types[kind] if default is None else default, about)
        except InvalidParameterValueException as error:
            between = "" if known.low is None else f" from {known.low:g} to {known.high:g}"
            got = error.args[1] if len(error.args) > 1 else "another value"
            raise CallError(
                f"parameter {name} must be a {_NAMES[kind]}{between}, got {got}"
            ) from error
        except InvalidParameterTypeException as error:
            example = {float: "1.0", int: "1", bool: "true", str: "text"}[kind]
            raise CallError(
                f"parameter {name} must be a {_NAMES[kind]} such as {example}: -p {name}:={example}"
            ) from error


_NAMES = {float: "number with a point", int: "whole number", bool: "truth value", str: "text"}


def table() -> dict[str, tuple[type, Any, Setting]]:
    """Kind, default (None: unset) and setting of each parameter by name."""
    found: dict[str, tuple[type, Any, Setting]] = {}
    for group in GROUPS:
        hints, known = get_type_hints(group), settings_of(group)
        for entry in fields(group):
            if entry.name in _UNUSED:
                continue
            default = entry.default.value if isinstance(entry.default, Enum) else entry.default
            kinds = (bool, int, float)
            kind = next((one for one in kinds if hints[entry.name] in (one, one | None)), str)
            found[entry.name] = (kind, default, known[entry.name])
    return found


def group(node: Any, kind: type[T]) -> T:
    """The group's settings as they are now."""
    from rclpy.exceptions import ParameterUninitializedException

    values: dict[str, Any] = {}
    for entry in fields(kind):
        if entry.name in _UNUSED:
            continue
        try:
            values[entry.name] = node.get_parameter(entry.name).value
        except ParameterUninitializedException:
            values[entry.name] = None
    return kind(**values)
