"""Bag files of ROS 1 and 2, opened without ROS."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from doorway3ds.errors import UserError
from doorway3ds.sources.base import SourceLost

_SUFFIXES = (".bag", ".mcap", ".db3")


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
