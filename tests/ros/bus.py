"""A real ROS 2 bus on this machine: the node as a process, and a peer that talks to it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from std_srvs.srv import Trigger

from doorway3ds.camera.model import Camera
from doorway3ds.ros import messages
from doorway3ds.ros.messages import ros_message as make
from tests.factories import scene

SIZE = (160, 120)
CAMERA = Camera.from_fov(*SIZE, 70.0, name="cam")
WAIT_S = 60.0  # on a busy machine


def python(*arguments: str, environment: dict[str, str]) -> subprocess.Popen[str]:
    """A program of this Python, whose output is kept together."""
    return subprocess.Popen(
        [sys.executable, *arguments], env={**os.environ, **environment}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def ended(process: subprocess.Popen[str], how: int = signal.SIGINT) -> tuple[int, str]:
    """Ends a program by a signal; its exit status and output."""
    if process.poll() is None:
        process.send_signal(how)
    try:
        said = process.communicate(timeout=WAIT_S)[0]
    except subprocess.TimeoutExpired:
        process.kill()
        said = process.communicate()[0] + "\n(it had to be killed)"
    return process.returncode, said


class Peer:
    """A node beside the one under test: publishes images and odometry, hears and calls."""

    def __init__(self, name: str) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, context=self.context)
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def hear(self, kind: Any, topic: str) -> None:
        def take(message: Any) -> None:
            self.heard[topic].append((time.monotonic(), message))

        self.node.create_subscription(kind, topic, take, 10)

    def decisions(self) -> list[dict[str, Any]]:
        return [json.loads(message.data) for _, message in self.heard["/doorway3ds/decision"]]

    def publish(self, topic: str, message: Any) -> None:
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(type(message), topic, 1)
        self._publishers[topic].publish(message)

    def top(self, frame_id: str, stamp_s: float | None = None) -> Any:
        now = self.node.get_clock().now().to_msg()
        stamp = now if stamp_s is None else messages.time_of(make, stamp_s)
        return messages.header(make, frame_id, stamp)

    def image(
        self, camera: Camera | None = CAMERA, stamp_s: float | None = None, **fields: Any
    ) -> None:
        """One image and its calibration; fields: of the image, put in place of the right ones."""
        top = self.top("lens", stamp_s)
        if camera is not None:
            self.publish("/camera_info", messages.camera_info(make, top, camera))
        message = messages.image(make, top, scene(*SIZE))
        for field, value in fields.items():
            setattr(message, field, value)
        self.publish("/image", message)

    def odometry(self, heading_rad: float) -> None:
        pose = make("geometry_msgs/msg/Pose", orientation=messages.heading(make, heading_rad))
        covered = make("geometry_msgs/msg/PoseWithCovariance", pose=pose)
        name = "nav_msgs/msg/Odometry"
        self.publish("/odom", make(name, header=self.top("odom"), pose=covered))

    def until(
        self, done: Callable[[], Any], each: Callable[[], None] | None = None, *,
        seconds: float = WAIT_S, period_s: float = 0.05,
    ) -> Any:  # fmt: skip
        """Repeats `each` until `done` holds; fails after a while."""
        deadline = time.monotonic() + seconds
        while not (found := done()):
            assert time.monotonic() < deadline, f"it did not come about in {seconds:g} s"
            if each is not None:
                each()
            time.sleep(period_s)
        return found

    def call(self, service: str) -> Any:
        """The future of a Trigger's response."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(Trigger, service)
        client = self._clients[service]
        assert client.wait_for_service(WAIT_S)
        return client.call_async(Trigger.Request())

    def close(self) -> None:
        self._executor.shutdown(1.0)
        self._thread.join(2.0)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


def start_node(folder: Path, *parameters: str, name: str | None = None) -> subprocess.Popen[str]:
    """`3ds ros` with a network that sees one door, a little to the left, everywhere."""
    given = [f"network:={folder}/net.onnx", "threads:=1", *parameters]
    arguments = [part for one in given for part in ("-p", one)]
    if name is not None:
        arguments += ["-r", f"__node:={name}"]
    return python(
        "-m", "doorway3ds.cli.main", "ros", "--ros-args", *arguments, environment={}
    )  # fmt: skip


def turned(twists: list[tuple[float, Any]]) -> np.ndarray:
    """(n,) speeds in rad/s of what was heard on cmd_vel."""
    return np.array([message.angular.z for _, message in twists])
