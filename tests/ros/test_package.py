"""The ROS 2 package: launch file, RViz layout and package.xml agree with the node."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from doorway3ds.ros.parameters import table
from doorway3ds.ros.topic import TOPICS

PACKAGE = Path(__file__).resolve().parents[2] / "ros2" / "doorway3ds_ros"


class Part:
    """Any part of a launch description: keeps what it was made of."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self.arguments, self.named = arguments, named


class Configuration(Part):
    def perform(self, context: dict[str, str]) -> str:
        return context.get(self.arguments[0], "")


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The launch file's own names; ROS's `launch` is stood in for, as no wheel has it."""
    parts = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "OpaqueFunction"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }
    for name, classes in parts.items():
        module = ModuleType(name)
        for one in classes:
            setattr(module, one, Part)
        monkeypatch.setitem(sys.modules, name, module)
    substitutions = SimpleNamespace(LaunchConfiguration=Configuration)
    monkeypatch.setitem(sys.modules, "launch.substitutions", substitutions)
    return runpy.run_path(str(PACKAGE / "launch" / "doorway3ds.launch.py"))


def test_every_parameter_is_described(launched: dict[str, Any]) -> None:
    (description,) = launched["generate_launch_description"]().arguments
    declared = {one.arguments[0]: one.named for one in description if "description" in one.named}
    assert declared.keys() == table().keys() | launched["TOPICS"].keys() | {"rviz"}
    assert all(
        known.help in declared[name]["description"] for name, (_, _, known) in table().items()
    )


def test_only_what_is_given_reaches_the_node_in_its_own_type(launched: dict[str, Any]) -> None:
    given = {"height_m": "0.4", "move": "true", "threads": "2", "network": "doornet"}
    (node,) = launched["nodes"](given)
    assert node.named["parameters"] == [
        {"height_m": 0.4, "move": True, "threads": 2, "network": "doornet"}
    ]
    assert [name for name, _ in node.named["remappings"]] == list(launched["TOPICS"])
    assert len(launched["nodes"]({"rviz": "true"})) == 2


def test_rviz_shows_topics_that_the_node_publishes() -> None:
    layout = yaml.safe_load((PACKAGE / "rviz" / "doorway3ds.rviz").read_text())
    displays = layout["Visualization Manager"]["Displays"]
    topics = {one["Topic"]["Value"] for one in displays if "Topic" in one}
    assert len(topics) == 5 and topics <= {f"/doorway3ds/{name}" for name in TOPICS}


def test_package_xml_names_what_the_code_imports() -> None:
    depends = {one.text for one in ElementTree.parse(PACKAGE / "package.xml").iter("exec_depend")}
    imported = {"rclpy", "sensor_msgs", "geometry_msgs", "nav_msgs", "std_msgs", "std_srvs"}
    assert depends >= imported | {"visualization_msgs", "diagnostic_msgs", "launch", "launch_ros"}


def test_colcon_builds_a_package_whose_node_starts(tmp_path: Path) -> None:
    pytest.importorskip("colcon_ros", reason="needs colcon-common-extensions and colcon-ros")
    shutil.copytree(PACKAGE, tmp_path / "src" / PACKAGE.name)
    build = [sys.executable, "-m", "colcon", "build", "--packages-select", PACKAGE.name]
    subprocess.run(build, cwd=tmp_path, check=True, capture_output=True, timeout=120)
    share = tmp_path / "install" / PACKAGE.name / "share"
    assert (share / "ament_index/resource_index/packages" / PACKAGE.name).is_file()
    for part in ("package.xml", "launch/doorway3ds.launch.py", "rviz/doorway3ds.rviz"):
        assert (share / PACKAGE.name / part).read_text() == (PACKAGE / part).read_text()
    node = (
        f". install/setup.bash && install/{PACKAGE.name}/lib/{PACKAGE.name}/doorway3ds --parameters"
    )
    said = subprocess.run(
        ["bash", "-c", node], cwd=tmp_path, check=True, capture_output=True, text=True, timeout=60
    ).stdout
    assert [line.split()[0] for line in said.splitlines()] == list(table())


CAMERA = """
import time
import numpy
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from doorway3ds.ros import messages
rclpy.init()
node = rclpy.create_node("camera")
top = messages.header(messages.ros_message, "lens", node.get_clock().now().to_msg())
image = messages.image(messages.ros_message, top, numpy.zeros((480, 640, 3), numpy.uint8))
quality = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
images = node.create_publisher(type(image), "burst", quality)
while images.get_subscription_count() == 0:
    time.sleep(0.05)
time.sleep(0.5)
for _ in range(12):
    images.publish(image)
    time.sleep(1 / 30)
time.sleep(3.0)
"""


def test_a_camera_with_the_profile_loses_no_raw_image(
    capsys: pytest.CaptureFixture[str], peer: Any
) -> None:
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import Image

    from doorway3ds.cli.main import run
    from tests.ros.bus import ended, python

    assert run(["ros", "--dds-profile"]) == 0
    profile = {"FASTDDS_DEFAULT_PROFILES_FILE": capsys.readouterr().out.strip()}
    came: list[int] = []
    quality = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
    peer.node.create_subscription(Image, "burst", lambda one: came.append(len(one.data)), quality)
    camera = python("-c", CAMERA, environment=profile)
    try:
        peer.until(lambda: len(came) == 12)
        assert set(came) == {640 * 480 * 3}
    finally:
        ended(camera)


def test_its_node_ends_cleanly_by_ctrl_c(peer: Any) -> None:
    from std_msgs.msg import String

    from tests.ros.bus import ended, python

    peer.hear(String, "/doorway3ds/decision")
    start = "from doorway3ds_ros.node import main; main()"
    path = os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")])
    arguments = ["-c", start, "--ros-args", "-p", "fov_deg:=70.0", "-p", "threads:=1"]
    node = python(*arguments, environment={"PYTHONPATH": path})
    peer.until(lambda: peer.decisions() or node.poll() is not None, peer.image)
    status, said = ended(node)
    assert (status, "Traceback" in said) == (0, False), said  # to ros2 launch, no crash
