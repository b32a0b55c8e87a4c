"""The node's topics. What nobody listens to is not even made."""

from __future__ import annotations

from typing import Any

from doorway3ds.live.eyes import Update
from doorway3ds.ros import messages
from doorway3ds.ros.messages import ros_message as make
from doorway3ds.ros.topic import TopicFrame

_ANNOTATED = "annotated/compressed"
TOPICS = {**messages.TOPICS, _ANNOTATED: "sensor_msgs/msg/CompressedImage"}
_OF_THE_IMAGE = ("depth", "camera_info")


class Outputs:
    """Publishes what is known after each frame."""

    def __init__(self, node: Any, image_topic: str, robot_frame: str) -> None:
        from rclpy.event_handler import PublisherEventCallbacks

        self._topic, self._robot_frame = image_topic, robot_frame
        # Each event that is listened for costs rclpy's executor time with every message.
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        self._by_name = {
            name: node.create_publisher(
                messages.message_class(kind), f"~/{name}", 1, event_callbacks=quiet
            )
            for name, kind in TOPICS.items()
        }

    def publish(self, update: Update) -> None:
        """Everything about one frame, or that no frame comes."""
        decision = update.decision
        assert isinstance(decision.frame, TopicFrame)
        seen = decision.frame.header
        top = messages.header(make, self._robot_frame, seen.stamp)
        out = messages.decided(make, top, seen, decision, lambda: self._answer(update))
        if update.fresh:
            out[_ANNOTATED] = lambda: _annotated(update)
        else:
            out = {name: message for name, message in out.items() if name not in _OF_THE_IMAGE}
        for name, message in out.items():
            if self._by_name[name].get_subscription_count() > 0:
                self._by_name[name].publish(message())

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
