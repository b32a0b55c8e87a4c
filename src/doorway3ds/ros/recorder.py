"""Decisions as a bag: an MCAP that ROS 2, RViz and Foxglove open, written without ROS."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.errors import UserError
from doorway3ds.ros import messages
from doorway3ds.types import Decision

CAMERA, ROBOT = "camera_optical_frame", "base_footprint"
"""Frames of what is recorded."""

_TYPES = {
    "/camera/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "/camera/camera_info": "sensor_msgs/msg/CameraInfo",
    "/tf": "tf2_msgs/msg/TFMessage",
    **{f"/doorway3ds/{name}": kind for name, kind in messages.TOPICS.items()},
}


class BagTypes:
    """`messages.Make` by the message definitions that come with `rosbags`."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)

    def __call__(self, name: str, /, **fields: Any) -> Any:
        kinds = dict(self.store.fielddefs[name][1])
        unknown = fields.keys() - kinds.keys()
        if unknown:
            raise TypeError(f"{name} has no field {', '.join(sorted(unknown))}")
        values = {field: self._value(kind, fields.get(field)) for field, kind in kinds.items()}
        return self.store.types[name](**values)

    def _value(self, kind: Any, given: Any) -> Any:
        """A field's value as rosbags wants it, or its default."""
        from rosbags.interfaces import Nodetype

        node, what = kind
        if node == Nodetype.NAME:
            return self(what) if given is None else given
        if node == Nodetype.BASE:
            base = what[0]
            if base == "string":
                return given or ""
            if base in ("byte", "octet") and isinstance(given, bytes):
                return given[0]
            if given is None:
                return False if base == "bool" else np.dtype(base).type(0).item()
            return given
        (inner, of), size = what
        if inner == Nodetype.BASE and of[0] != "string":
            dtype = np.dtype(of[0])
            if isinstance(given, bytes):
                return np.frombuffer(given, dtype)
            return np.zeros(size, dtype) if given is None else np.asarray(given, dtype)
        return [] if given is None else list(given)


class BagRecorder:
    """Writes what is decided into a bag folder that appears whole, when it is closed.

    stamps are moved to the wall's clock where they count from another origin.
    """

    def __init__(self, folder: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        if folder.exists():
            raise UserError(f"{folder} exists; a bag is a new folder, name another one")
        self._folder = folder
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            self._temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        except OSError as error:
            raise UserError(f"cannot write the bag {folder}: {error.strerror}") from error
        self._make = BagTypes()
        self._writer = Writer(
            self._temporary / folder.name, version=9, storage_plugin=StoragePlugin.MCAP
        )
        self._writer.open()
        self._topics = {
            topic: self._writer.add_connection(topic, kind, typestore=self._make.store)
            for topic, kind in _TYPES.items()
        }
        self._offset_s: float | None = None
        self._open = True

    def add(self, decision: Decision, answer: dict[str, Any]) -> None:
        """One frame. decision: with memory, where there is one; answer: its JSON."""
        make, frame = self._make, decision.frame
        if self._offset_s is None:
            recent = abs(frame.stamp_s - time.time()) < 20 * 365 * 86400
            self._offset_s = 0.0 if recent else time.time() - frame.stamp_s
        stamp_s = frame.stamp_s + self._offset_s
        stamp = messages.time_of(make, stamp_s)
        seen = messages.header(make, CAMERA, stamp)
        top = messages.header(make, ROBOT, stamp)
        out = {
            # A reader needs these before the image.
            "/tf": make(
                _TYPES["/tf"],
                transforms=[messages.camera_transform(make, top, CAMERA, frame.pose)],
            ),
            "/camera/camera_info": messages.camera_info(make, seen, frame.camera),
            "/camera/image_raw/compressed": messages.compressed(make, seen, frame.image),
        }
        about = messages.decided(make, top, seen, decision, lambda: answer)
        out |= {f"/doorway3ds/{name}": message() for name, message in about.items()}
        at_ns = int(stamp.sec) * 10**9 + int(stamp.nanosec)
        try:
            for topic, message in out.items():
                data = make.store.serialize_cdr(message, _TYPES[topic])
                self._writer.write(self._topics[topic], at_ns, data)
        except OSError as error:
            raise UserError(f"cannot write the bag {self._folder}: {error.strerror}") from error

    def close(self) -> None:
        """Ends the bag and gives it its name; may be called twice."""
        if not self._open:
            return
        self._open = False
        try:
            self._writer.close()
            (self._temporary / self._folder.name).rename(self._folder)
        except OSError as error:
            raise UserError(f"cannot write the bag {self._folder}: {error.strerror}") from error
        finally:
            shutil.rmtree(self._temporary, ignore_errors=True)
