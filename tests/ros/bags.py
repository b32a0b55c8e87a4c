"""Bags written by rosbags in the three formats that there are."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.ros import messages
from doorway3ds.ros.recorder import BagTypes

KINDS = ("ros1", "sqlite3", "mcap")
Entry = tuple[str, str, float, Any]  # topic, type, seconds, message


def write(path: Path, kind: str, entries: Iterable[Entry]) -> Path:
    """A bag with these messages, made by `BagTypes`; returns what to open."""
    make = BagTypes()
    if kind == "ros1":
        path = path.with_suffix(".bag")
        with Writer1(path) as writer:
            store = get_typestore(Stores.ROS1_NOETIC)
            tf = "geometry_msgs/TransformStamped[] transforms"
            store.register(get_types_from_msg(tf, "tf2_msgs/msg/TFMessage"))
            known: dict[str, Any] = {}
            for topic, name, at_s, message in entries:
                if topic not in known:
                    known[topic] = writer.add_connection(topic, name, typestore=store)
                data = store.serialize_ros1(_older(store, name, message), name)
                writer.write(known[topic], round(at_s * 1e9), data)
        return path
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as two:
        known = {}
        for topic, name, at_s, message in entries:
            if topic not in known:
                known[topic] = two.add_connection(topic, name, typestore=make.store)
            data = make.store.serialize_cdr(message, name)
            two.write(known[topic], round(at_s * 1e9), data)
    return path


def _older(store: Any, name: str, message: Any) -> Any:
    """The message as ROS 1 has it: headers count, and a camera's matrices are capitals."""
    if not hasattr(message, "__dataclass_fields__"):
        return message
    values = {}
    for field, (node, what) in store.fielddefs[name][1]:
        given = getattr(message, field, None)
        if given is None:
            given = getattr(message, field.lower(), 0)
        if isinstance(given, list):
            given = [_older(store, what[0][1], one) for one in given]
        elif node == 2:
            given = _older(store, what, given)
        values[field] = given
    return store.types[name](**values)


def camera_topics(
    images: Iterable[np.ndarray],
    camera: Camera | None = None,
    pose: Pose | None = None,
    *,
    topic: str = "/cam/image_raw",
    begin_s: float = 100.0,
    step_s: float = 0.1,
) -> list[Entry]:
    """Messages of one camera; its calibration and pose come first, if there are any."""
    make = BagTypes()

    def top(frame_id: str, at_s: float) -> Any:
        return messages.header(make, frame_id, messages.time_of(make, at_s))

    entries: list[Entry] = []
    if pose is not None:
        link = messages.camera_transform(make, top("base_footprint", begin_s), "lens", pose)
        tf = make("tf2_msgs/msg/TFMessage", transforms=[link])
        entries.append(("/tf_static", "tf2_msgs/msg/TFMessage", begin_s, tf))
    info_topic = topic.rpartition("/")[0] + "/camera_info"
    for number, pixels in enumerate(images):
        at_s = begin_s + number * step_s
        if camera is not None:
            info = messages.camera_info(make, top("lens", at_s), camera)
            entries.append((info_topic, "sensor_msgs/msg/CameraInfo", at_s + 0.02, info))
        image = messages.image(make, top("lens", at_s), pixels)
        entries.append((topic, "sensor_msgs/msg/Image", at_s + 0.02, image))
    return entries
