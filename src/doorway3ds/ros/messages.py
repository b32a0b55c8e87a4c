"""From decisions to ROS messages.

Every function takes `make`, which builds a message of a named type from fields, others at their
defaults: `ros_message` where ROS is, `recorder.BagTypes` where it is not. Frames are those of REP
103 and 105, angles on topics radians; `robot` headers name the robot's frame on the floor.
"""

from __future__ import annotations

import array
import json
import math
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from importlib import import_module
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from doorway3ds.camera.model import Array, Camera, Pose, rotation
from doorway3ds.draw.space import Doorway, candidates, chosen, corridor
from doorway3ds.draw.words import headline, sentence
from doorway3ds.types import Decision, Reason

_LIFETIME_S = 1  # markers of a node that is gone vanish after this

Color = tuple[float, float, float, float]
_AZURE: Color = (0.34, 0.71, 0.91, 1.0)
_GREEN: Color = (0.0, 0.62, 0.45, 0.6)
_VERMILLION: Color = (0.84, 0.37, 0.0, 0.6)
_WHITE: Color = (0.95, 0.95, 0.95, 0.8)


class Make(Protocol):
    """Builds a message such as "std_msgs/msg/Header"; arrays of uint8 are given as bytes."""

    def __call__(self, name: str, /, **fields: Any) -> Any: ...


def ros_message(name: str, /, **fields: Any) -> Any:
    """`Make` of a ROS installation, or of the extra `ros`."""
    message = message_class(name)()
    for field, value in fields.items():
        if field == "data" and isinstance(value, bytes):
            value = array.array("B", value)  # rclpy would check plain bytes one by one
        setattr(message, field, value)
    return message


@lru_cache(maxsize=64)
def message_class(name: str) -> Any:
    package, _, kind = name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), kind)


TOPICS = {
    "decision": "std_msgs/msg/String",
    "p_open": "std_msgs/msg/Float64",
    "bearing": "std_msgs/msg/Float64",
    "doorway": "geometry_msgs/msg/PoseStamped",
    "corridor": "geometry_msgs/msg/PolygonStamped",
    "markers": "visualization_msgs/msg/MarkerArray",
    "depth": "sensor_msgs/msg/Image",
    "camera_info": "sensor_msgs/msg/CameraInfo",
}
"""What is told of a decision: topics below the node's own name, and their types."""


def decided(
    make: Make, top: Any, seen: Any, decision: Decision, answer: Callable[[], Mapping[str, Any]]
) -> dict[str, Callable[[], Any]]:
    """What makes each message that there is about a decision, by its name in TOPICS.

    top, seen: headers in the robot's and in the camera's frame. answer: the decision's JSON.
    """
    door, way, depth = chosen(decision), corridor(decision), decision.perception.depth_m
    bearing_deg = decision.bearing_deg
    out: dict[str, Callable[[], Any]] = {
        "decision": lambda: decision_text(make, answer()),
        "p_open": lambda: number(make, decision.p_open),
        "markers": lambda: markers(make, top, decision),
    }
    if bearing_deg is not None:
        out["bearing"] = lambda: number(make, math.radians(bearing_deg))
    if door is not None:
        out["doorway"] = lambda: doorway_pose(make, top, door)
    if way is not None:
        out["corridor"] = lambda: corridor_polygon(make, top, way)
    if depth is not None:
        small = decision.frame.camera.stretched_to(depth.shape[1], depth.shape[0])
        out["depth"] = lambda: image(make, seen, depth)
        out["camera_info"] = lambda: camera_info(make, seen, small)
    return out


def header(make: Make, frame_id: str, stamp: Any) -> Any:
    """A std_msgs/Header; stamp: a builtin_interfaces/Time of the same kind."""
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def time_of(make: Make, seconds: float) -> Any:
    """A builtin_interfaces/Time."""
    whole = math.floor(seconds)
    nanoseconds = min(round((seconds - whole) * 1e9), 999_999_999)
    return make("builtin_interfaces/msg/Time", sec=whole, nanosec=nanoseconds)


def point(make: Make, xyz: ArrayLike, kind: str = "Point") -> Any:
    """A geometry_msgs/Point, or another kind of three numbers."""
    x, y, z = (float(v) for v in np.asarray(xyz, np.float64))
    return make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def heading(make: Make, heading_rad: float) -> Any:
    """A geometry_msgs/Quaternion about z."""
    half = heading_rad / 2
    return make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))


def image(make: Make, top: Any, pixels: NDArray[Any]) -> Any:
    """A sensor_msgs/Image: rgb8 of (H, W, 3) uint8, 32FC1 of (H, W) float32 metres."""
    kinds = {("|u1", 3): ("rgb8", 3), ("<f4", 2): ("32FC1", 4)}
    encoding, size = kinds[(pixels.dtype.newbyteorder("<").str, pixels.ndim)]
    height, width = pixels.shape[:2]
    data = pixels.astype(pixels.dtype.newbyteorder("<"), copy=False).tobytes()
    return make(
        "sensor_msgs/msg/Image", header=top, height=height, width=width, encoding=encoding,
        is_bigendian=0, step=width * size, data=data,
    )  # fmt: skip


def compressed(make: Make, top: Any, pixels: NDArray[np.uint8], kind: str = "jpeg") -> Any:
    """A sensor_msgs/CompressedImage, jpeg or png, of (H, W, 3) uint8 RGB."""
    options = [cv2.IMWRITE_JPEG_QUALITY, 95] if kind == "jpeg" else []
    data = cv2.imencode(f".{kind}", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), options)[1].tobytes()
    return make("sensor_msgs/msg/CompressedImage", header=top, format=kind, data=data)


def camera_info(make: Make, top: Any, camera: Camera) -> Any:
    """A sensor_msgs/CameraInfo for images of the camera's size."""
    fx, fy, cx, cy = (float(v) for v in (camera.fx, camera.fy, camera.cx, camera.cy))
    return make(
        "sensor_msgs/msg/CameraInfo", header=top, width=camera.width, height=camera.height,
        distortion_model=camera.distortion_model, d=[float(v) for v in camera.distortion],
        k=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )  # fmt: skip


def camera_transform(make: Make, top: Any, child: str, pose: Pose) -> Any:
    """A geometry_msgs/TransformStamped from the camera's optical frame into `top`'s frame."""
    x, y, z, w = _quaternion(rotation(pose))
    moved = (pose.forward_m, pose.left_m, pose.height_m or 0.0)
    transform = make(
        "geometry_msgs/msg/Transform",
        translation=point(make, moved, "Vector3"),
        rotation=make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
    )
    name = "geometry_msgs/msg/TransformStamped"
    return make(name, header=top, child_frame_id=child, transform=transform)


def _quaternion(turn: Array) -> tuple[float, float, float, float]:
    """(x, y, z, w) of a (3, 3) rotation, by Rodrigues' axis and angle."""
    axis = cv2.Rodrigues(turn)[0].ravel()
    angle = float(np.linalg.norm(axis))
    x, y, z = (float(v) * (math.sin(angle / 2) / angle if angle else 0.0) for v in axis)
    return x, y, z, math.cos(angle / 2)


def decision_text(make: Make, answer: Mapping[str, Any]) -> Any:
    """A std_msgs/String that holds the JSON contract."""
    return make("std_msgs/msg/String", data=json.dumps(answer, allow_nan=False))


def number(make: Make, value: float) -> Any:
    return make("std_msgs/msg/Float64", data=float(value))


def doorway_pose(make: Make, top: Any, door: Doorway) -> Any:
    """A geometry_msgs/PoseStamped: the middle of the sill, facing through the doorway."""
    pose = make(
        "geometry_msgs/msg/Pose",
        position=point(make, (*door.middle, 0.0)),
        orientation=heading(make, math.radians(door.bearing_deg)),
    )
    return make("geometry_msgs/msg/PoseStamped", header=top, pose=pose)


def corridor_polygon(make: Make, top: Any, corners: Array) -> Any:
    """A geometry_msgs/PolygonStamped of the swept floor, corners (n, 2)."""
    points = [point(make, (*corner, 0.0), "Point32") for corner in corners]
    polygon = make("geometry_msgs/msg/Polygon", points=points)
    return make("geometry_msgs/msg/PolygonStamped", header=top, polygon=polygon)


def twist(make: Make, turn_rad_s: float, top: Any = None) -> Any:
    """A geometry_msgs/Twist that turns on the spot, + left; a TwistStamped if `top` is given."""
    still, spin = (point(make, (0.0, 0.0, rate), "Vector3") for rate in (0.0, turn_rad_s))
    plain = make("geometry_msgs/msg/Twist", linear=still, angular=spin)
    if top is None:
        return plain
    return make("geometry_msgs/msg/TwistStamped", header=top, twist=plain)


def diagnostics(make: Make, top: Any, problem: str | None, facts: Mapping[str, object]) -> Any:
    """A diagnostic_msgs/DiagnosticArray with one status: OK, or WARN for a problem."""
    values = [
        make("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
        for key, value in facts.items()
    ]
    status = make(
        "diagnostic_msgs/msg/DiagnosticStatus", level=b"\x00" if problem is None else b"\x01",
        name="doorway3ds: decisions", message=problem or "deciding", hardware_id="", values=values,
    )  # fmt: skip
    return make("diagnostic_msgs/msg/DiagnosticArray", header=top, status=[status])


def markers(make: Make, top: Any, decision: Decision) -> Any:
    """A visualization_msgs/MarkerArray: jambs and lintel, swept corridor, candidates, words.

    The first marker deletes those of the frame before.
    """
    door, way = chosen(decision), corridor(decision)
    drawn = [_marker(make, top, "", 0, action=3)]
    if way is not None:
        clear = decision.selection.clear
        color = {True: _GREEN, False: _VERMILLION, None: _WHITE}[clear]
        floor = [(*corner, 0.01) for corner in (*way, way[0])]
        drawn.append(_lines(make, top, "corridor", 0, floor, 0.03, color))
    if door is not None:
        good = decision.reason in (Reason.TURN, Reason.ALIGNED)
        color = _AZURE if good else _VERMILLION
        drawn.append(_lines(make, top, "doorway", 0, door.frame, 0.06, color))
    for index, other in enumerate(candidates(decision)):
        drawn.append(_lines(make, top, "candidates", index, other.frame, 0.02, _WHITE))
    at = (1.0, 0.0, 1.2) if door is None else (*door.middle, 2.2)
    words = f"{headline(decision)}\n{sentence(decision)}".replace("\u00a0", " ")
    drawn.append(
        _marker(
            make, top, "words", 0, type=9, text=words, color=_color(make, _WHITE),
            scale=point(make, (0.0, 0.0, 0.16), "Vector3"),
            pose=make("geometry_msgs/msg/Pose", position=point(make, at),
                      orientation=heading(make, 0.0)),
        )
    )  # fmt: skip
    return make("visualization_msgs/msg/MarkerArray", markers=drawn)


def _lines(
    make: Make, top: Any, space: str, number: int, points: Iterable[ArrayLike], width_m: float,
    color: Color,
) -> Any:  # fmt: skip
    return _marker(
        make, top, space, number, type=4, points=[point(make, one) for one in points],
        scale=point(make, (width_m, 0.0, 0.0), "Vector3"), color=_color(make, color),
        pose=make("geometry_msgs/msg/Pose", position=point(make, (0, 0, 0)),
                  orientation=heading(make, 0.0)),
    )  # fmt: skip


def _marker(make: Make, top: Any, space: str, number: int, **fields: Any) -> Any:
    lifetime = make("builtin_interfaces/msg/Duration", sec=_LIFETIME_S, nanosec=0)
    return make(
        "visualization_msgs/msg/Marker", header=top, ns=space, id=number, lifetime=lifetime,
        **fields,
    )  # fmt: skip


def _color(make: Make, color: Color) -> Any:
    r, g, b, a = color
    return make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=a)
