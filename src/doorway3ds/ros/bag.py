"""Bags as a source: bag://FILE?topic=/camera/image_raw, of ROS 1 and 2, without ROS.

The calibration comes from the bag's `camera_info`, the pose from its /tf and /tf_static.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from doorway3ds.errors import CallError, UserError
from doorway3ds.ros.received import Calibration, Transforms, image_of, stamp_of
from doorway3ds.sources.address import query
from doorway3ds.sources.base import Source, SourceLost, View
from doorway3ds.sources.clock import Clock
from doorway3ds.types import Frame

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_INFO = "sensor_msgs/msg/CameraInfo"
_TF, _TF_STATIC = "/tf", "/tf_static"
_SUFFIXES = (".bag", ".mcap", ".db3")


def open_uri(uri: str, view: View, **options: Any) -> Source:
    """The source of a bag:// URI; see `doorway3ds.sources.open_source`."""
    parts, asked = query(uri, {"topic": str, "frame": str})
    kept = {name: options[name] for name in ("pace", "loop") if name in options}
    path = Path(unquote(parts.netloc + parts.path))
    return BagSource(path, view, topic=asked.get("topic"), robot=asked.get("frame"), **kept)


class BagFile:
    """A .bag file, a bag folder of ROS 2, or one .mcap or .db3 file of it, open for reading.

    kinds: message type of each topic. counts: messages of each topic.
    duration_s: from the first message to the last.

    Raises UserError if it is missing, damaged or no bag.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        if not path.exists():
            raise UserError(f"{path} does not exist; expected a bag: .bag, .mcap, .db3 or a folder")
        if path.is_file() and path.suffix not in _SUFFIXES:
            raise UserError(f"{path} is not a bag; expected .bag, .mcap, .db3 or a bag folder")
        self._path, self._stack = path, ExitStack()
        try:
            default = get_typestore(Stores.ROS2_HUMBLE)
            self._reader = self._stack.enter_context(AnyReader([path], default_typestore=default))
        except Exception as error:  # a damaged file fails anywhere in its reader, in any way
            raise UserError(f"{path} cannot be read as a bag: {_line(error)}") from error
        connections = self._reader.connections
        self.kinds: dict[str, str] = {one.topic: one.msgtype for one in connections}
        self.counts = dict.fromkeys(self.kinds, 0)
        for one in connections:
            self.counts[one.topic] += one.msgcount
        self.duration_s = max(0.0, self._reader.duration * 1e-9)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, float, Any]]:
        """Topic, time in the bag in seconds, and message, in the bag's order.

        Raises SourceLost where the bag is damaged.
        """
        wanted = [one for one in self._reader.connections if one.topic in topics]
        if not wanted:
            return
        try:
            for connection, at_ns, data in self._reader.messages(wanted):
                message = self._reader.deserialize(data, connection.msgtype)
                yield connection.topic, at_ns * 1e-9, message
        except Exception as error:
            raise SourceLost(f"{self._path} is damaged: {_line(error)}") from error

    def close(self) -> None:
        self._stack.close()


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


class BagSource(Source):
    """The images of one topic of a bag, stamped as their headers are.

    topic: default: the only one with images. robot: the frame that the camera's pose is told in;
    default: base_footprint or base_link. pace: images come when they are due, none is left out;
    loop: begin again at the end, stamps as in the bag.

    Raises UserError if the bag cannot be read, or if it is not clear which topic is meant.
    """

    def __init__(
        self,
        path: Path,
        view: View | None = None,
        *,
        topic: str | None = None,
        robot: str | None = None,
        pace: bool = False,
        loop: bool = False,
    ) -> None:
        super().__init__(str(path))
        self._view, self._robot, self._pace, self._loop = view or View(), robot, pace, loop
        self._clock, self._lock = Clock(), threading.Lock()
        self._bag = BagFile(path)
        try:
            self._topic = _chosen(self.name, self._bag.kinds, topic)
            topics = [name for name, kind in self._bag.kinds.items() if kind == _INFO]
            self._info = beside(self._topic, topics)
            self._calibration = Calibration(
                self._info or "camera_info", rectified="rect" in self._topic
            )
            self._transforms = Transforms()
            for _, _, message in self._bag.messages([_TF_STATIC]):
                self._transforms.add(message)
            infos = self._bag.messages([self._info] if self._info else [])
            self._camera = next((self._calibration.camera(info) for _, _, info in infos), None)
        except BaseException:
            self._bag.close()
            raise
        count = self._bag.counts[self._topic]
        if count > 1 and self._bag.duration_s > 0:
            self.fps = (count - 1) / self._bag.duration_s
        self.name = self.frame_name = f"bag://{path}{self._topic}"
        self._number = self._answered = 0
        self._images = self._play()
        self._pending: tuple[float, Any] | None = None

    def read(self, timeout_s: float | None = None) -> Frame | None:
        while not self.ended:
            if self._pending is None:
                self._pending = self._next()
                continue
            at_s, message = self._pending
            if self._pace and not self._clock.wait_for(at_s, timeout_s):
                return None
            self._clock.delay(max(self._clock.late_s(at_s), 0.0))
            self._pending = None
            frame = self._frame(at_s, message)
            if frame is not None:
                return frame
        return None

    def close(self) -> None:
        self.ended = True
        self._clock.stop()
        with self._lock:
            self._bag.close()

    def _next(self) -> tuple[float, Any] | None:
        """Bag time and image of the next message; None at the end."""
        with self._lock:
            if self.ended:
                return None
            found = next(self._images, None)
            if found is None and self._loop and self._answered:
                self._images, self._clock, self._number = self._play(), Clock(), 0
                found = next(self._images, None)
        if found is None:
            self.ended = True
            if not self._answered:
                raise UserError(f"{self.name} holds no image that can be read")
        return found

    def _play(self) -> Iterator[tuple[float, Any]]:
        """Bag times and images; calibration and transforms are taken in on the way."""
        topics = {self._topic, _TF} | ({self._info} if self._info else set())
        for topic, at_s, message in self._bag.messages(topics):
            if topic == self._topic:
                yield at_s, message
            elif topic == _TF:
                self._transforms.add(message)
            else:
                self._camera = self._calibration.camera(message)

    def _frame(self, at_s: float, message: Any) -> Frame | None:
        self._number += 1
        self.frame_name = f"{self.name}#{self._number}"
        try:
            image = image_of(message, self.frame_name)
            pose = self._transforms.pose(message.header.frame_id, self._robot)
            camera = self._camera
            if camera is not None and self._view.camera is None:
                camera = camera.scaled_to(image.shape[1], image.shape[0])
            frame = self._view.frame(image, stamp_of(message) or at_s, camera=camera, pose=pose)
        except UserError as error:
            self.damaged += 1
            self.notice(str(error))
            return None
        self._answered += 1
        return frame


def _chosen(bag: str, kinds: dict[str, str], topic: str | None) -> str:
    images = sorted(
        name
        for name, kind in kinds.items()
        if kind in _IMAGES and not name.endswith("/compressedDepth")
    )
    if topic in images:
        return str(topic)
    if not images:
        held = ", ".join(sorted(kinds)) or "none"
        raise UserError(f"{bag} holds no images; its topics: {held}")
    if topic is not None:
        raise CallError(f"{bag} has no images on {topic}; it has them on {', '.join(images)}")
    if len(images) > 1:
        raise CallError(
            f"{bag} has images on {', '.join(images)}; name one of them: ?topic={images[0]}"
        )
    return images[0]


def beside(image_topic: str, infos: Iterable[str]) -> str | None:
    """The `camera_info` topic of an image topic: the one that shares most of its name with it."""
    parts = image_topic.strip("/").split("/")

    def shared(info: str) -> int:
        pairs = zip(parts, info.strip("/").split("/"), strict=False)
        return next((i for i, (one, other) in enumerate(pairs) if one != other), len(parts))

    # A camera's own topics share all but their last name, or two of a compressed image.
    near = [info for info in infos if shared(info) >= max(0, info.strip("/").count("/"))]
    return max(near, key=shared, default=None)
