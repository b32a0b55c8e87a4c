"""The loop closed: a base with odometry in a simulated home, seen by the packaged network."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs the extra ros")
pytest.importorskip("mujoco", reason="needs the extra sim")
from std_msgs.msg import String

from tests.lab.sim.conftest import gl  # noqa: F401  # skips where nothing can be drawn
from tests.ros.bus import Peer, ended, python

START_S = 60.0  # of a renderer in software, on a busy machine
SEED = 2


class Told:
    """The lines that a program prints, as they come."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.lines: list[str] = []
        threading.Thread(target=self._read, args=(process,), daemon=True).start()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self.lines.append(line)

    def last(self) -> dict[str, Any]:
        said: dict[str, Any] = json.loads(self.lines[-1])
        return said


def test_it_faces_the_doorway_within_three_degrees(peer: Peer, gl: Any) -> None:  # noqa: F811
    base = python("-m", "tests.ros.simbase", str(SEED), environment={})
    world = Told(base)
    running = [base]
    try:
        peer.until(lambda: world.lines and world.lines[-1].startswith("{"), seconds=START_S)
        begun = world.last()
        assert min(abs(one) for one in begun["doors"]) > 10  # it does not face it yet
        placed = {name: begun["pose"][name] for name in ("height_m", "pitch_deg", "forward_m")}
        given = ["move:=true", "threads:=1", "ttl_s:=5.0", "image_timeout_s:=5.0"]
        given += [f"{name}:={float(value):.6f}" for name, value in placed.items()]
        arguments = [part for one in given for part in ("-p", one)]
        node = python(
            "-m", "doorway3ds.cli.main", "ros", "--ros-args", *arguments, environment={}
        )  # fmt: skip
        running.append(node)
        peer.hear(String, "/doorway3ds/decision")

        def settled() -> bool:
            decisions = peer.decisions()
            return bool(decisions) and decisions[-1]["tracked"]["reason"] == "turn"

        peer.until(settled, seconds=START_S)
        answer = peer.call("/doorway3ds/turn")
        peer.until(answer.done, seconds=START_S)
        assert answer.result().success, answer.result().message
        count = len(world.lines)
        peer.until(lambda: len(world.lines) > count + 2, seconds=START_S)
        time.sleep(0.1)
        assert min(abs(one) for one in world.last()["doors"]) <= 3.0
    finally:
        for process in running:
            process.stdout = None  # its reader has it
            ended(process)
