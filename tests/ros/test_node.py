"""The node as a process, over a real bus: what it says, and what it survives."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs the extra ros")
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Twist
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Float64, String
from visualization_msgs.msg import MarkerArray

from doorway3ds.camera.model import Camera
from doorway3ds.ros import messages, received
from doorway3ds.ros.messages import ros_message as make
from tests.ros.bus import CAMERA, SIZE, WAIT_S, Peer, ended, turned

Start = Callable[..., Any]


def first_decision(peer: Peer, each: Callable[[], None] | None = None) -> dict[str, Any]:
    peer.hear(String, "/doorway3ds/decision")
    peer.until(lambda: len(peer.decisions()) > 5, each or peer.image)
    return peer.decisions()[-1]


def test_it_answers_an_image_topic_with_every_topic(node: Start, peer: Peer) -> None:
    node("height_m:=0.6")
    kinds = {
        "p_open": Float64, "bearing": Float64, "markers": MarkerArray, "doorway": PoseStamped,
        "depth": Image, "annotated/compressed": CompressedImage,
    }  # fmt: skip
    for name, kind in kinds.items():
        peer.hear(kind, f"/doorway3ds/{name}")
    peer.hear(DiagnosticArray, "/diagnostics")
    decision = first_decision(peer)
    peer.until(
        lambda: (
            all(peer.heard[f"/doorway3ds/{name}"] for name in kinds) and peer.heard["/diagnostics"]
        ),
        peer.image,
    )
    assert decision["camera"]["assumed"] is False and decision["frame_id"] == "lens"
    assert decision["open"] and decision["tracked"]["number"] == 1
    age_s = time.time() - decision["stamp_s"]
    assert 0 < age_s < WAIT_S
    bearing = peer.heard["/doorway3ds/bearing"][-1][1].data
    assert np.degrees(bearing) == pytest.approx(decision["tracked"]["bearing_deg"], abs=1.0)
    doorway = peer.heard["/doorway3ds/doorway"][-1][1]
    assert doorway.header.frame_id == "base_footprint"
    assert received.heading_of(doorway.pose.orientation) == pytest.approx(
        np.degrees(bearing), abs=1.0
    )
    depth = peer.heard["/doorway3ds/depth"][-1][1]
    assert (depth.encoding, depth.header.frame_id) == ("32FC1", "lens")
    annotated = received.image_of(peer.heard["/doorway3ds/annotated/compressed"][-1][1])
    assert annotated.shape == (*SIZE[::-1], 3)
    peer.until(
        lambda: peer.heard["/diagnostics"][-1][1].status[0].message == "deciding", peer.image
    )


def test_compressed_images(node: Start, peer: Peer) -> None:
    node("image_transport:=compressed", "fov_deg:=70.0")

    def show() -> None:
        packed = messages.compressed(make, peer.top("lens"), np.zeros((120, 160, 3), np.uint8))
        peer.publish("/image/compressed", packed)

    assert first_decision(peer, show)["camera"]["name"] == "fov 70 deg"


def test_it_survives_what_comes(node: Start, peer: Peer) -> None:
    """Wrong encoding, another size, another aspect, clocks that jump, a camera that pauses."""
    process = node()
    peer.hear(DiagnosticArray, "/diagnostics")
    first_decision(peer)

    def problem(words: str, each: Callable[[], None]) -> None:
        def told() -> bool:
            found = [one.status[0].message for _, one in peer.heard["/diagnostics"]]
            return any(words in one for one in found)

        peer.heard["/diagnostics"].clear()
        peer.until(told, each)
        count = len(peer.decisions())
        peer.until(lambda: len(peer.decisions()) > count, peer.image)

    problem("encoding 'bayer_rggb8'", lambda: peer.image(encoding="bayer_rggb8"))
    problem("holds 57600 bytes", lambda: peer.image(height=500))
    problem("another aspect", lambda: peer.image(Camera.from_fov(160, 90, 70)))
    problem("behind the node's clock", lambda: peer.image(stamp_s=12.5))
    problem("behind the node's clock", lambda: peer.image(stamp_s=time.time() + 1e6))
    # A calibration for twice the size, of the same aspect, is scaled.
    count = len(peer.decisions())
    peer.until(
        lambda: len(peer.decisions()) > count + 3,
        lambda: peer.image(Camera.from_fov(320, 240, 70)),
    )
    # The camera is gone: the decision becomes `lost`; it is back: decisions come again.
    peer.until(lambda: peer.decisions()[-1]["reason"] == "lost")
    peer.until(lambda: peer.decisions()[-1]["reason"] != "lost", peer.image)
    assert process.poll() is None


def test_images_that_are_lost_on_the_way_are_told(node: Start, peer: Peer) -> None:
    node()
    peer.hear(DiagnosticArray, "/diagnostics")

    def show() -> None:
        peer.image()
        for _ in range(4):  # of images that do not arrive
            peer.publish("/camera_info", messages.camera_info(make, peer.top("lens"), CAMERA))
            time.sleep(0.02)

    def told() -> bool:
        found = [one.status[0] for _, one in peer.heard["/diagnostics"]]
        return any("3ds ros --dds-profile" in one.message for one in found)

    peer.until(told, show)
    status = peer.heard["/diagnostics"][-1][1].status[0]
    rates = {one.key: one.value for one in status.values}
    assert 0 < float(rates["images per second"]) < 30


def test_zeros_in_camera_info_mean_that_nobody_calibrated(node: Start, peer: Peer) -> None:
    node()

    def show() -> None:
        info = make("sensor_msgs/msg/CameraInfo", width=SIZE[0], height=SIZE[1])
        peer.publish("/camera_info", info)
        peer.image(camera=None)

    assert first_decision(peer, show)["camera"]["assumed"] is True


def test_a_clock_that_goes_backwards(node: Start, peer: Peer) -> None:
    """As while a bag loops under use_sim_time: stamps and clock begin again."""
    node("use_sim_time:=true")
    clock = {"s": 1000.0}

    def show() -> None:
        clock["s"] += 0.1
        peer.publish(
            "/clock", make("rosgraph_msgs/msg/Clock", clock=messages.time_of(make, clock["s"]))
        )
        time.sleep(0.02)
        peer.image(stamp_s=clock["s"])

    peer.node.create_publisher(Clock, "/clock", 1)
    first_decision(peer, show)
    clock["s"] = 500.0
    peer.until(lambda: peer.decisions()[-1]["stamp_s"] < 600, show)
    count = len(peer.decisions())
    peer.until(lambda: len(peer.decisions()) > count + 5, show)
    assert peer.decisions()[-1]["tracked"]["number"] >= 1


def test_parameters_out_of_range_are_refused_with_a_reason(node: Start, peer: Peer) -> None:
    node()
    client = peer.node.create_client(SetParameters, "/doorway3ds/set_parameters")
    assert client.wait_for_service(WAIT_S)

    def put(name: str, value: Any) -> Any:
        request = SetParameters.Request()
        request.parameters = [Parameter(name, value=value).to_parameter_msg()]
        future = client.call_async(request)
        peer.until(future.done)
        return future.result().results[0]

    refused = put("height_m", 99.0)
    assert not refused.successful and "out of range" in refused.reason
    assert not put("move", True).successful
    assert put("height_m", 0.9).successful


@pytest.mark.parametrize(
    ("parameter", "complaint"),
    [
        ("height_m:=99.0", "parameter height_m must be a number with a point from 0.01 to 10"),
        ("height_m:=1", "parameter height_m must be a number with a point such as 1.0"),
        ("method:=guess", "method must be opening or paper, got 'guess'"),
        ("network:=/missing.onnx", "/missing.onnx"),
        ("image_transport:=theora", "image_transport must be one of raw, compressed"),
    ],
)
def test_wrong_parameters_end_it_with_one_line(
    tmp_path: Any, peer: Peer, parameter: str, complaint: str
) -> None:
    from tests.ros.bus import start_node

    process = start_node(tmp_path, parameter)
    said = process.communicate(timeout=WAIT_S)[0]
    assert process.returncode == 2
    assert complaint in said.splitlines()[-1] and "Traceback" not in said


def test_two_nodes_side_by_side(node: Start, peer: Peer) -> None:
    node()
    node("move:=false", name="second")
    peer.hear(String, "/doorway3ds/decision")
    peer.hear(String, "/second/decision")
    peer.until(
        lambda: (
            len(peer.heard["/doorway3ds/decision"]) > 3 and len(peer.heard["/second/decision"]) > 3
        ),
        peer.image,
    )


def test_nothing_moves_without_permission(node: Start, peer: Peer) -> None:
    node()
    peer.hear(Twist, "/cmd_vel")
    peer.hear(PoseStamped, "/goal_pose")
    decision = first_decision(peer)
    assert decision["tracked"]["reason"] == "turn"
    for service in ("turn", "go"):
        answer = peer.call(f"/doorway3ds/{service}")
        peer.until(answer.done, lambda: (peer.image(), peer.odometry(0.0)))
        assert not answer.result().success and "-p move:=true" in answer.result().message
    publishers = peer.node.get_publishers_info_by_topic("/cmd_vel")
    assert not publishers and not peer.heard["/cmd_vel"] and not peer.heard["/goal_pose"]


class Base:
    """A base that does as it is told, at once, and says where it stands."""

    def __init__(self, peer: Peer) -> None:
        self.peer, self.heading, self.last_s, self.mute = peer, 0.4, time.monotonic(), False
        peer.hear(Twist, "/cmd_vel")

    def step(self) -> None:
        now = time.monotonic()
        speeds = turned(self.peer.heard["/cmd_vel"])
        self.heading += (speeds[-1] if len(speeds) else 0.0) * (now - self.last_s)
        self.last_s = now
        if not self.mute:
            self.peer.odometry(self.heading)

    def step_and_show(self) -> None:
        self.step()
        self.peer.image()


def test_one_turn_closed_over_odometry(node: Start, peer: Peer) -> None:
    node("move:=true", "turn_speed:=0.3")
    base = Base(peer)
    asked = first_decision(peer, base.step_and_show)["tracked"]["turn_deg"]
    begun = base.heading
    answer = peer.call("/doorway3ds/turn")
    time.sleep(0.05)
    second = peer.call("/doorway3ds/turn")
    peer.until(lambda: answer.done() and second.done(), base.step_and_show, period_s=0.02)
    first, second = sorted((answer.result(), second.result()), key=lambda one: not one.success)
    assert first.success and "turned" in first.message
    assert (second.success, second.message) == (False, "a turn is under way")
    assert np.degrees(base.heading - begun) == pytest.approx(asked, abs=2.0)
    speeds = turned(peer.heard["/cmd_vel"])
    assert speeds[-1] == 0 and 0 < np.abs(speeds).max() <= 0.3


def test_a_goal_for_navigation(node: Start, peer: Peer) -> None:
    node("move:=true")
    peer.hear(PoseStamped, "/goal_pose")
    peer.hear(Twist, "/cmd_vel")
    decision = first_decision(peer)
    answer = peer.call("/doorway3ds/go")
    peer.until(answer.done, peer.image)
    assert answer.result().success, answer.result().message
    peer.until(lambda: peer.heard["/goal_pose"])
    goal = peer.heard["/goal_pose"][0][1]
    at = goal.pose.position
    assert goal.header.frame_id == "base_footprint"
    assert np.hypot(at.x, at.y) == pytest.approx(decision["tracked"]["range_m"], rel=0.05)
    assert not peer.heard["/cmd_vel"]  # it drives nothing itself


def test_no_turn_on_old_decisions_or_without_odometry(node: Start, peer: Peer) -> None:
    node("move:=true", "ttl_s:=0.5")
    peer.hear(Twist, "/cmd_vel")
    first_decision(peer)
    answer = peer.call("/doorway3ds/turn")
    peer.until(answer.done, peer.image)
    assert not answer.result().success and "no odometry" in answer.result().message
    first_decision(peer)
    time.sleep(0.7)
    for service in ("turn", "go"):
        answer = peer.call(f"/doorway3ds/{service}")
        peer.until(answer.done, lambda: peer.odometry(0.0))
        assert not answer.result().success
        assert "s old" in answer.result().message or "no decision" in answer.result().message
    # Images of another clock are decided on, but move nothing.
    peer.until(
        lambda: peer.decisions()[-1]["stamp_s"] == 12.5 and peer.decisions()[-1]["open"],
        lambda: peer.image(stamp_s=12.5),
    )
    answer = peer.call("/doorway3ds/turn")
    peer.until(answer.done, lambda: (peer.image(stamp_s=12.5), peer.odometry(0.0)))
    assert not answer.result().success and "clock" in answer.result().message
    assert not np.any(turned(peer.heard["/cmd_vel"]))


@pytest.mark.parametrize("lost", ["odometry", "images"])
def test_a_turn_stops_when_it_is_blind(node: Start, peer: Peer, lost: str) -> None:
    node("move:=true", "turn_speed:=0.1", "image_timeout_s:=0.4", "odom_timeout_s:=0.3")
    base = Base(peer)
    first_decision(peer, base.step_and_show)
    answer = peer.call("/doorway3ds/turn")
    peer.until(lambda: np.any(turned(peer.heard["/cmd_vel"])), base.step_and_show)
    base.mute = lost == "odometry"
    peer.until(answer.done, base.step_and_show if lost == "odometry" else base.step)
    assert not answer.result().success
    assert {"odometry": "no odometry", "images": "no image"}[lost] in answer.result().message
    peer.until(lambda: turned(peer.heard["/cmd_vel"])[-1] == 0)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_in_a_turn_sends_zero_last(node: Start, peer: Peer, how: int) -> None:
    process = node("move:=true", "turn_speed:=0.1")
    base = Base(peer)
    first_decision(peer, base.step_and_show)
    peer.call("/doorway3ds/turn")
    peer.until(lambda: np.any(turned(peer.heard["/cmd_vel"])), base.step_and_show)
    status, said = ended(process, how)
    assert status == 130 and "Traceback" not in said, said
    time.sleep(0.3)
    assert turned(peer.heard["/cmd_vel"])[-1] == 0
