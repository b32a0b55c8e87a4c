"""The ROS 2 package: launch file, RViz layout and package.xml agree with the node."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from doorway3ds.ros.parameters import table

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
    source = Path(sys.modules["doorway3ds.ros.parameters"].__file__ or "").with_name("outputs.py")
    assert len(topics) == 5
    for topic in topics:
        assert f'"{topic.removeprefix("/doorway3ds/")}": ' in source.read_text()


def test_package_xml_names_what_the_code_imports() -> None:
    depends = {one.text for one in ElementTree.parse(PACKAGE / "package.xml").iter("exec_depend")}
    imported = {"rclpy", "sensor_msgs", "geometry_msgs", "nav_msgs", "std_msgs", "std_srvs"}
    assert depends >= imported | {"visualization_msgs", "diagnostic_msgs", "launch", "launch_ros"}
