"""The node's topics. What nobody listens to is not even made."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from doorway3ds.draw.space import chosen, corridor
from doorway3ds.live.eyes import Update
from doorway3ds.ros import messages
from doorway3ds.ros.messages import ros_message as make
from doorway3ds.ros.topic import TopicFrame


class Outputs:
    """Publishes what is known after each frame."""

    def __init__(self, node: Any, image_topic: str, robot_frame: str) -> None:
        from geometry_msgs.msg import PolygonStamped, PoseStamped
        from rclpy.event_handler import PublisherEventCallbacks
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image
        from std_msgs.msg import Float64, String
        from visualization_msgs.msg import MarkerArray

        self._topic, self._robot_frame = image_topic, robot_frame
        # Each event that is listened for costs rclpy's executor time with every message.
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        self._by_name = {
            name: node.create_publisher(kind, f"~/{name}", 1, event_callbacks=quiet)
            for name, kind in {
                "decision": String,
                "p_open": Float64,
                "bearing": Float64,
                "doorway": PoseStamped,
                "corridor": PolygonStamped,
                "markers": MarkerArray,
                "depth": Image,
                "camera_info": CameraInfo,
                "annotated/compressed": CompressedImage,
            }.items()
        }

    def publish(self, update: Update) -> None:
        """Everything about one frame, or that no frame comes."""
        decision = update.decision
        frame = decision.frame
        assert isinstance(frame, TopicFrame)
        seen = frame.header
        top = messages.header(make, self._robot_frame, seen.stamp)
        self._send("decision", lambda: messages.decision_text(make, self._answer(update)))
        self._send("p_open", lambda: messages.number(make, decision.p_open))
        self._send("markers", lambda: messages.markers(make, top, decision))
        bearing_deg = decision.bearing_deg
        if bearing_deg is not None:
            self._send("bearing", lambda: messages.number(make, math.radians(bearing_deg)))
        door, way = chosen(decision), corridor(decision)
        if door is not None:
            self._send("doorway", lambda: messages.doorway_pose(make, top, door))
        if way is not None:
            self._send("corridor", lambda: messages.corridor_polygon(make, top, way))
        depth = decision.perception.depth_m
        if depth is not None and update.fresh:
            small = frame.camera.stretched_to(depth.shape[1], depth.shape[0])
            self._send("depth", lambda: messages.image(make, seen, depth))
            self._send("camera_info", lambda: messages.camera_info(make, seen, small))
        if update.fresh:
            self._send("annotated/compressed", lambda: _annotated(update))

    def _send(self, name: str, message: Callable[[], Any]) -> None:
        publisher = self._by_name[name]
        if publisher.get_subscription_count() > 0:
            publisher.publish(message())

    def _answer(self, update: Update) -> dict[str, Any]:
        """The JSON of `3ds live --json`, and the header of the image that it is about."""
        frame = update.raw.frame
        assert isinstance(frame, TopicFrame)
        stamp = frame.header.stamp
        answer = update.raw.to_dict(self._topic)
        if not update.fresh:
            answer |= {"reason": str(update.decision.reason), "turn_deg": None}
        return {
            **answer,
            "stamp": {"sec": int(stamp.sec), "nanosec": int(stamp.nanosec)},
            "frame_id": frame.header.frame_id,
            "stamp_s": int(stamp.sec) + int(stamp.nanosec) * 1e-9,
            "tracked": update.tracked.to_dict(),
            "problem": update.problem,
        }


def _annotated(update: Update) -> Any:
    from doorway3ds.draw import overlay

    frame = update.decision.frame
    assert isinstance(frame, TopicFrame)
    return messages.compressed(make, frame.header, overlay(update.decision))
