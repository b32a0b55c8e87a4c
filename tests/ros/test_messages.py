"""Messages there and back, by the definitions of a ROS installation and by those of rosbags."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from importlib.util import find_spec
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose, bearing_of_pixel, rotation
from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import select_opening
from doorway3ds.errors import UserError
from doorway3ds.ros import messages, received
from doorway3ds.types import Decision, Reason
from tests import raycast

pytest.importorskip("rosbags", reason="needs the extra bag")
from doorway3ds.ros.recorder import BagTypes

CAMERA = Camera("cam", 160, 120, 140.0, 141.0, 81.0, 58.0, (-0.1, 0.02, 0.001, -0.002, 0.003))


@pytest.fixture(params=["rosbags", "rclpy"], scope="module")
def make(request: pytest.FixtureRequest) -> messages.Make:
    if request.param == "rosbags":
        return BagTypes()
    if find_spec("rclpy") is None:
        pytest.skip("needs the extra ros")
    return messages.ros_message


@pytest.fixture(scope="module")
def decision() -> Decision:
    """A doorway 2.5 m ahead, 0.4 m to the left, seen without error."""
    camera = Camera.from_fov(160, 120, 80)
    pose = Pose(height_m=0.8, forward_m=0.1)
    view = raycast.render(raycast.Room(distance=2.5, aside=0.4), camera, pose)
    frame, seen = view.frame(), view.perception()
    return decide(seen, select_opening(seen, frame), frame, "opening", Gates())


def top(make: messages.Make, frame_id: str = "base_footprint") -> object:
    return messages.header(make, frame_id, messages.time_of(make, 12.25))


def raw(encoding: str, data: np.ndarray, width: int, step: int, big: int = 0) -> SimpleNamespace:
    return SimpleNamespace(
        encoding=encoding, height=len(data), width=width, step=step, is_bigendian=big,
        data=data.tobytes(),
    )  # fmt: skip


def test_an_image_there_and_back_is_the_same(make: messages.Make) -> None:
    image = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    message = messages.image(make, top(make), image)
    assert (message.width, message.height, message.step) == (64, 48, 192)
    assert np.array_equal(received.image_of(message), image)
    assert received.stamp_of(message) == 12.25
    packed = messages.compressed(make, top(make), image, "png")
    assert np.array_equal(received.image_of(packed), image)


def test_depth_is_metres_in_32_bits(make: messages.Make) -> None:
    depth = np.array([[1.5, np.nan], [0.25, 3.0]], np.float32)
    message = messages.image(make, top(make), depth)
    assert message.encoding == "32FC1"
    back = np.frombuffer(message.data, "<f4").reshape(2, 2)
    assert np.array_equal(back, depth, equal_nan=True)


# Two pixels, red and then blue, in each encoding. Of YUV both pixels are of one grey.
@pytest.mark.parametrize(
    ("encoding", "values", "expected"),
    [
        ("rgb8", [255, 0, 0, 0, 0, 255], [[255, 0, 0], [0, 0, 255]]),
        ("bgr8", [0, 0, 255, 255, 0, 0], [[255, 0, 0], [0, 0, 255]]),
        ("rgba8", [255, 0, 0, 9, 0, 0, 255, 9], [[255, 0, 0], [0, 0, 255]]),
        ("bgra8", [0, 0, 255, 9, 255, 0, 0, 9], [[255, 0, 0], [0, 0, 255]]),
        ("mono8", [7, 200], [[7] * 3, [200] * 3]),
        ("mono16", [1, 7, 2, 200], [[7] * 3, [200] * 3]),
        ("yuv422", [128, 126, 128, 126], [[128] * 3, [128] * 3]),
        ("uyvy", [128, 126, 128, 126], [[128] * 3, [128] * 3]),
        ("yuv422_yuy2", [126, 128, 126, 128], [[128] * 3, [128] * 3]),
    ],
)
@pytest.mark.parametrize("padding", [0, 5])
def test_encodings(encoding: str, values: list[int], expected: list[int], padding: int) -> None:
    row = np.array([[*values, *[99] * padding]] * 3, np.uint8)
    image = received.image_of(raw(encoding, row, 2, row.shape[1]))
    assert np.abs(image.astype(int) - np.array([expected] * 3)).max() <= 1


def test_big_endian_grey() -> None:
    row = np.array([[7, 1, 200, 2]], np.uint8)
    assert received.image_of(raw("mono16", row, 2, 4, big=1))[0, :, 0].tolist() == [7, 200]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"encoding": "bayer_rggb8"}, "encoding 'bayer_rggb8'; expected rgb8"),
        ({"step": 3}, "rows of 3 bytes"),
        ({"height": 9}, "holds 18 bytes; expected 54"),
        ({"width": 0}, "at least one pixel"),
    ],
)
def test_wrong_images_are_refused(change: dict[str, object], complaint: str) -> None:
    message = raw("rgb8", np.zeros((3, 6), np.uint8), 2, 6)
    message.__dict__.update(change)
    with pytest.raises(UserError, match=complaint):
        received.image_of(message, "camera")


def test_wrong_compressed_images_are_refused() -> None:
    with pytest.raises(UserError, match="holds depth"):
        received.image_of(SimpleNamespace(format="16UC1; compressedDepth png", data=b""))
    with pytest.raises(UserError, match=r"^camera "):
        received.image_of(SimpleNamespace(format="jpeg", data=b"not an image"), "camera")


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [
        ("plumb_bob", CAMERA.distortion),
        ("rational_polynomial", (-0.1, 0.02, 0.001, -0.002, 0.003, 0.01, -0.004, 0.001)),
        ("equidistant", (0.02, -0.01, 0.004, -0.001)),
    ],
)
def test_a_camera_there_and_back_is_the_same(
    make: messages.Make, model: str, coefficients: tuple[float, ...]
) -> None:
    camera = replace(CAMERA, distortion_model=model, distortion=coefficients)
    message = messages.camera_info(make, top(make), camera)
    assert received.camera_of(message, "cam") == camera
    straight = received.camera_of(message, "cam", rectified=True)
    assert straight is not None and not any(straight.distortion) and straight.fx == CAMERA.fx


def test_zeros_mean_uncalibrated(make: messages.Make) -> None:
    message = make("sensor_msgs/msg/CameraInfo", width=160, height=120)
    assert received.camera_of(message) is None


def test_binning_and_region_keep_every_ray(make: messages.Make) -> None:
    message = messages.camera_info(make, top(make), CAMERA)
    message.roi.x_offset, message.roi.y_offset = 40, 20
    message.roi.width, message.roi.height = 100, 60
    message.binning_x = message.binning_y = 2
    small = received.camera_of(message)
    assert small is not None and (small.width, small.height) == (50, 30)
    # Pixel (10, 5) of the binned region covers (60..61, 30..31) of the sensor.
    assert bearing_of_pixel(small, Pose(), (10, 5)) == pytest.approx(
        bearing_of_pixel(CAMERA, Pose(), (60.5, 30.5))
    )


def test_a_camera_of_another_kind_is_refused(make: messages.Make) -> None:
    message = messages.camera_info(make, top(make), CAMERA)
    message.distortion_model = "division"
    with pytest.raises(UserError, match=r"cam describes no camera.*division"):
        received.camera_of(message, "cam")


def test_ros_1_names_its_matrices_in_capitals(make: messages.Make) -> None:
    two = messages.camera_info(make, top(make), CAMERA)
    one = SimpleNamespace(
        D=two.d, K=two.k, P=two.p, distortion_model="plumb_bob", roi=two.roi, width=160,
        height=120, binning_x=0, binning_y=0,
    )  # fmt: skip
    assert received.camera_of(one, "cam") == CAMERA


@pytest.mark.parametrize(
    "pose",
    [
        Pose(0.5),
        Pose(1.2, pitch_deg=-17, yaw_deg=25, roll_deg=4, forward_m=0.2, left_m=-0.05),
        Pose(0.3, pitch_deg=30, yaw_deg=170, roll_deg=-90),
    ],
)
def test_a_pose_there_and_back_is_the_same(make: messages.Make, pose: Pose) -> None:
    message = messages.camera_transform(make, top(make), "lens", pose)
    back = received.transform_of(message.transform)
    assert back[:3, :3] == pytest.approx(rotation(pose), abs=1e-9)
    found = received.pose_of(back)
    assert vars(found) == pytest.approx(vars(pose), abs=1e-6)


def test_the_doorway_faces_through_the_middle_of_the_sill(
    make: messages.Make, decision: Decision
) -> None:
    door = messages.chosen(decision)
    assert door is not None
    message = messages.doorway_pose(make, top(make), door)
    at = message.pose.position
    assert (at.x, at.y, at.z) == pytest.approx((2.5, 0.4, 0.0), abs=0.06)
    heading = received.heading_of(message.pose.orientation)
    assert heading == pytest.approx(decision.bearing_deg, abs=1e-9)
    assert np.linalg.norm(door.left - door.right) == pytest.approx(0.9, abs=0.08)
    assert (message.header.frame_id, received.stamp_of(message)) == ("base_footprint", 12.25)


def test_markers_show_doorway_corridor_and_words(make: messages.Make, decision: Decision) -> None:
    shown = messages.markers(make, top(make), decision).markers
    assert shown[0].action == 3
    spaces = [one.ns for one in shown[1:]]
    assert spaces == ["corridor", "doorway", "words"]
    jambs = next(one for one in shown if one.ns == "doorway").points
    assert [one.z for one in jambs] == [0, 2, 2, 0]
    assert jambs[0].y > 0.4 > jambs[3].y
    way = next(one for one in shown if one.ns == "corridor").points
    corners = np.array([(one.x, one.y) for one in way[:-1]])
    assert corners == pytest.approx(decision.selection.evidence["corridor_m"])
    assert shown[-1].text.startswith("Turn left")
    assert all(one.pose.orientation.w == 1.0 for one in shown[1:])


def test_without_a_doorway_only_words_remain(make: messages.Make, decision: Decision) -> None:
    nothing = replace(decision, reason=Reason.NO_DOOR)
    shown = messages.markers(make, top(make), nothing).markers
    assert {one.ns for one in shown[1:]} <= {"candidates", "words"}


def test_the_decision_is_the_contract(make: messages.Make, decision: Decision) -> None:
    message = messages.decision_text(make, decision.to_dict())
    assert json.loads(message.data)["bearing_deg"] == decision.bearing_deg


def test_twists_turn_on_the_spot(make: messages.Make) -> None:
    plain = messages.twist(make, 0.4)
    assert (plain.linear.x, plain.angular.z) == (0.0, 0.4)
    stamped = messages.twist(make, -0.4, top(make))
    assert (stamped.twist.angular.z, stamped.header.frame_id) == (-0.4, "base_footprint")


def test_corridor_and_diagnostics(make: messages.Make) -> None:
    corners = np.array([[0.1, 0.2], [2, 0.2], [2, -0.2], [0.1, -0.2]])
    polygon = messages.corridor_polygon(make, top(make), corners).polygon
    assert np.array([(one.x, one.y) for one in polygon.points]) == pytest.approx(corners)
    array = messages.diagnostics(make, top(make), "no image", {"fps": 1.5})
    status = array.status[0]
    assert status.level in (1, b"\x01") and status.message == "no image"
    assert (status.values[0].key, status.values[0].value) == ("fps", "1.5")


def test_heading_of_a_quaternion(make: messages.Make) -> None:
    for degrees in (-179.0, -30.0, 0.0, 90.0):
        turned = messages.heading(make, math.radians(degrees))
        assert received.heading_of(turned) == pytest.approx(degrees)
    with pytest.raises(ValueError, match="length 1"):
        received.heading_of(SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0))


def test_jpeg_is_near(make: messages.Make) -> None:
    image = cv2.resize(np.arange(48, dtype=np.uint8).reshape(4, 4, 3), (64, 48))
    packed = messages.compressed(make, top(make), image)
    assert packed.format == "jpeg"
    assert np.abs(received.image_of(packed).astype(int) - image).max() < 12
