"""The camera's pose by tf2, which no wheel has: its module is stood in for."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs the extra ros")
from doorway3ds.camera.model import Pose
from doorway3ds.ros import messages, node
from doorway3ds.ros.messages import ros_message as make

POSE = Pose(0.6, pitch_deg=-4.0, yaw_deg=2.0, forward_m=0.1, left_m=0.03)


class Unknown(Exception):
    pass


class Buffer:
    """Knows the pose at 12.25 s and, as the newest one, nothing."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str, int]] = []

    def lookup_transform(self, target: str, source: str, time: Any) -> Any:
        self.asked.append((target, source, time.nanoseconds))
        if time.nanoseconds != 12_250_000_000:
            raise Unknown
        return messages.camera_transform(make, header("base_footprint", 12.25), source, POSE)


def header(frame_id: str, stamp_s: float) -> Any:
    return messages.header(make, frame_id, messages.time_of(make, stamp_s))


def test_at_the_image_else_the_newest_else_none(monkeypatch: pytest.MonkeyPatch) -> None:
    buffer = Buffer()
    tf2 = SimpleNamespace(
        Buffer=lambda: buffer, TransformListener=lambda *given: given, TransformException=Unknown
    )
    monkeypatch.setitem(sys.modules, "tf2_ros", tf2)
    pose = node.transform_buffer(None)
    assert vars(pose("base_footprint", header("/lens", 12.25))) == pytest.approx(vars(POSE))
    assert buffer.asked == [("base_footprint", "lens", 12_250_000_000)]
    assert pose("base_footprint", header("lens", 13.0)) is None
    assert [nanoseconds for _, _, nanoseconds in buffer.asked[1:]] == [13_000_000_000, 0]


def test_without_tf2_the_parameters_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    said: list[str] = []
    quiet = SimpleNamespace(get_logger=lambda: SimpleNamespace(info=said.append))
    assert node.transform_buffer(quiet) is None
    assert "not installed" in said[0]
