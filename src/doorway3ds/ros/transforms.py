"""Where frames stand to each other, as /tf and /tf_static tell it."""

from __future__ import annotations

from typing import Any

import numpy as np

from doorway3ds.camera.model import Array, Pose
from doorway3ds.ros.received import pose_of, transform_of

ROBOT_FRAMES = ("base_footprint", "base_link")
"""Usual names of a robot's own frame, the one on the floor first (REP 105, REP 120)."""

_DEEPEST = 100


class Transforms:
    """The newest transform of every frame into its parent's."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Array]] = {}

    def add(self, message: Any) -> None:
        """Takes in a tf2_msgs/TFMessage; transforms that are no rotation are left out."""
        for one in message.transforms:
            try:
                transform = transform_of(one.transform)
            except ValueError:
                continue
            child, parent = bare(one.child_frame_id), bare(one.header.frame_id)
            self._parents[child] = (parent, transform)

    def lookup(self, target: str, source: str) -> Array | None:
        """(4, 4) from the source frame into the target frame; None if they are not connected."""
        up, down = self._to_root(bare(source)), self._to_root(bare(target))
        for frame, from_source in up.items():
            if frame in down:
                return np.asarray(np.linalg.inv(down[frame]) @ from_source)
        return None

    def pose(self, camera: str, robot: str | None = None) -> Pose | None:
        """The camera's pose on the robot; robot: its frame, default: the usual ones."""
        for frame in ROBOT_FRAMES if robot is None else (robot,):
            transform = self.lookup(frame, camera)
            if transform is not None:
                return pose_of(transform)
        return None

    def _to_root(self, frame: str) -> dict[str, Array]:
        """The frame and its ancestors, each with the transform from the frame into it."""
        found, transform = {frame: np.eye(4)}, np.eye(4)
        while frame in self._parents and len(found) < _DEEPEST:
            frame, step = self._parents[frame]
            transform = step @ transform
            found[frame] = transform
        return found


def bare(frame: str) -> str:
    """The frame's name as tf2 has it; those of ROS 1 may begin with a slash."""
    return frame.lstrip("/")
