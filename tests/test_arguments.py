"""What the public names answer to arguments of another kind: one line that names the argument."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import doorway3ds as d3
from doorway3ds.live.tracker import TrackerParams
from doorway3ds.networks import load
from doorway3ds.networks.averaged import Mirrored
from doorway3ds.networks.base import Joined
from doorway3ds.robots.base import DryRobot, Limits
from doorway3ds.robots.loop import LoopParams
from tests.factories import doornet, scene

LINE = {"reason": "turn", "p_open": 0.9, "turn_deg": 5.0}
OPENING = {
    "left_px": 1.0, "right_px": 2.0, "left_deg": 3.0, "right_deg": 1.0,
    "bearing_deg": 2.0, "range_m": None, "score": 0.5, "cut": None,
}  # fmt: skip
CAMERA = d3.Camera.from_fov(64, 48, 60.0)
IMAGE = np.zeros((48, 64, 3), np.uint8)
NO_IMAGES: dict[str, Any] = {
    "none": None,
    "number": 5,
    "list": [[0, 0, 0]],
    "float": np.zeros((48, 64, 3), np.float32),
    "four channels": np.zeros((48, 64, 4), np.uint8),
    "grey": np.zeros((48, 64), np.uint8),
    "empty": np.zeros((0, 64, 3), np.uint8),
    "scalar": np.array(3, np.uint8),
}


@pytest.fixture(scope="module")
def decide(tmp_path_factory: pytest.TempPathFactory) -> d3.Pipeline:
    folder = tmp_path_factory.mktemp("network")
    return d3.Pipeline(load(str(doornet(folder / "net.onnx", left=0.2, right=0.4))))


def refusal(call: Callable[..., Any], *given: Any, **named: Any) -> str:
    with pytest.raises(d3.UserError) as caught:
        call(*given, **named)
    line = str(caught.value)
    assert line and "\n" not in line and len(line) < 300
    return line


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[(name, bad) for name in ("width", "height") for bad in (None, 0, -1, 64.5, math.nan)],
        *[(name, bad) for name in ("fx", "fy", "cx", "cy") for bad in (None, math.inf, "10")],
        ("name", None),
        ("distortion", None),
        ("distortion", (math.nan,) * 5),
        ("distortion", (0.0, 0.0)),
        ("distortion_model", None),
        ("distortion_model", ["plumb_bob"]),
    ],
)
def test_camera(name: str, value: Any) -> None:
    given = {"name": "c", "width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 1.0, "cy": 1.0}
    assert refusal(d3.Camera, **{**given, name: value}).startswith(f"{name} must ")


@pytest.mark.parametrize("bad", [None, math.nan, math.inf, -1.0, 0.0, 180.0, 1e30, "60", IMAGE])
def test_field_of_view(bad: Any) -> None:
    assert refusal(d3.Camera.from_fov, 64, 48, bad).startswith("hfov_deg must be a number from")
    if bad is not None:
        assert "vfov_deg must" in refusal(d3.Camera.from_fov, 64, 48, 60.0, bad)


@pytest.mark.parametrize("bad", [None, 0, -64, 1.5, math.nan])
def test_a_camera_at_another_size(bad: Any) -> None:
    assert refusal(CAMERA.scaled_to, bad, 48).startswith("width must be a whole number")
    assert refusal(CAMERA.scaled_to, 64, bad).startswith("height must be a whole number")
    assert "orientation must be a whole number from 1 to 8" in refusal(CAMERA.turned, bad)


@pytest.mark.parametrize(
    "name", ["height_m", "pitch_deg", "yaw_deg", "roll_deg", "forward_m", "left_m"]
)
@pytest.mark.parametrize("bad", [math.nan, -math.inf, "1", IMAGE])
def test_pose(name: str, bad: Any) -> None:
    assert refusal(d3.Pose, **{name: bad}).startswith(f"{name} must be a finite number, got ")


@pytest.mark.parametrize("kind", NO_IMAGES)
def test_frame_and_pipeline_refuse_what_is_no_image(decide: d3.Pipeline, kind: str) -> None:
    bad = NO_IMAGES[kind]
    assert refusal(d3.Frame, bad, CAMERA).startswith("image must be a uint8 array of shape (H, W,")
    assert refusal(decide, bad).startswith("image must be a")
    assert refusal(next, decide.each([bad])).startswith("image must be a")
    if kind not in ("four channels", "grey"):
        assert refusal(d3.from_bgr, bad).startswith("image must be a uint8 array of shape")


def test_frame() -> None:
    assert refusal(d3.Frame, IMAGE, None) == "camera must be a Camera, got None"
    assert refusal(d3.Frame, IMAGE, CAMERA, pose=5) == "pose must be a Pose, got 5"
    assert refusal(d3.Frame, IMAGE, CAMERA, stamp_s=math.nan).startswith("stamp_s must be a finite")
    assert "use camera.scaled_to" in refusal(d3.Frame, IMAGE[:40], CAMERA)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("p_open", bad) for bad in (None, "0.5", 1.5, -0.1, math.inf)],
        *[(name, bad) for name in ("depth_m", "floor") for bad in (5, [[1.0]], np.zeros(3))],
        ("columns", np.zeros(3)),
        ("relative", 1.0),
        ("depth_error", math.nan),
        ("bearing_error_deg", -1.0),
    ],
)
def test_perception(name: str, value: Any) -> None:
    assert refusal(d3.Perception, **{"p_open": 0.5, name: value}).startswith(f"{name} must be ")


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, bad) for name in OPENING if name != "cut" for bad in (math.nan, "1")] + [("cut", 1)],
)
def test_opening(name: str, value: Any) -> None:
    assert refusal(d3.Opening, **{**OPENING, name: value}).startswith(f"{name} must be ")


@pytest.mark.parametrize("bad", [None, "nope", 5, math.nan])
def test_reason(bad: Any) -> None:
    assert refusal(d3.Reason, bad).startswith("reason must be one of no_door, blocked, unsure")
    assert refusal(d3.Decision.from_dict, {"reason": bad}).startswith("reason must be one of")


@pytest.mark.parametrize(
    ("answer", "line"),
    [
        (None, "answer must be a mapping, as to_dict returns it, got None"),
        ([], "answer must be a mapping"),
        ("turn", "answer must be a mapping"),
        ({}, "answer must have a reason, got only nothing"),
        ({"p_open": 0.5}, "answer must have a reason, got only p_open"),
        *[
            ({**LINE, "p_open": bad}, "p_open must be a number from 0 to 1")
            for bad in (None, 2, "1")
        ],
        *[
            ({**LINE, name: bad}, f"{name} must be a finite number")
            for name in ("turn_deg", "bearing_deg", "range_m", "floor_from_m", "max_depth")
            for bad in (math.nan, "1", [1])
        ],
        *[
            ({**LINE, name: bad}, f"{name} must be (row, column) or None")
            for name in ("pixel", "max_pixel")
            for bad in (5, "ab", [1], [1.5, 2.0], [None, None])
        ],
        *[({**LINE, "openings": bad}, "openings must each be whole") for bad in (5, [5], [{}])],
        ({**LINE, "openings": [{**OPENING, "score": None}]}, "score must be a finite number"),
        *[
            ({**LINE, "camera": bad}, "camera must have a name")
            for bad in (5, "front", {"name": 1})
        ],
        ({**LINE, "timings_ms": 5}, "timings_ms must be a mapping"),
        ({**LINE, "timings_ms": {"network": "x"}}, "timings_ms network must be a finite number"),
    ],
)
def test_decision_from_dict(answer: Any, line: str) -> None:
    assert refusal(d3.Decision.from_dict, answer).startswith(line)


def test_decision(decide: d3.Pipeline) -> None:
    known = vars(decide(IMAGE))
    for name in ("selection", "perception", "frame"):
        expected = f"{name} must be a {name.title()}, got None"
        assert refusal(d3.Decision, **{**known, name: None}) == expected
    assert "turn_deg must" in refusal(d3.Decision, **{**known, "turn_deg": math.nan})


def test_pipeline(decide: d3.Pipeline) -> None:
    network, bad_network = decide.network, "must be a network, as load_network returns it, got "
    for bad in (None, 5, "doornet", print):
        assert refusal(d3.Pipeline, bad).startswith(f"network {bad_network}")
    assert refusal(d3.Pipeline.paper, "nyu") == f"classifier {bad_network}'nyu'"
    assert refusal(d3.Pipeline.paper, None, 5) == f"depth {bad_network}5"
    assert "method must be one of opening, paper" in refusal(d3.Pipeline, network, None)
    assert refusal(d3.Pipeline, network, ["opening"]).startswith("method must be one of")
    assert refusal(d3.Pipeline, network, params=5) == "params must be OpeningParams or None, got 5"
    assert refusal(d3.Pipeline, network, gates=None) == "gates must be Gates, got None"
    assert refusal(d3.Pipeline, network, preset=5) == "preset must be a name or None, got 5"
    for bad in (0, -1, math.nan, 1.5, "2"):
        assert "threads must be a whole number" in refusal(d3.Pipeline.default, threads=bad)


def test_calling_a_pipeline(decide: d3.Pipeline, tmp_path: Path) -> None:
    assert refusal(decide, IMAGE, "nao") == "camera must be a Camera or None, got 'nao'"
    assert refusal(decide, IMAGE, None, 5) == "pose must be a Pose or None, got 5"
    assert refusal(decide, b"").startswith("image ")
    assert refusal(decide, tmp_path).endswith("is a folder; expected an image file")
    assert refusal(decide, "no\0file").startswith("no")
    for bad in (0, -1, None, 1.5, math.nan, 10**400):
        assert refusal(decide.each, [IMAGE], workers=bad).startswith("workers must be a whole")
    assert refusal(decide.each, None).startswith("images must be a sequence")
    assert refusal(decide.each, [IMAGE], 5).startswith("camera must be")
    decision = decide(IMAGE)
    for wrong in (decide.perceive, decide.decide):
        assert refusal(wrong, None) == "frame must be a Frame, got None"
    assert (
        refusal(decide.conclude, decision.frame, None)
        == "perception must be a Perception, got None"
    )
    assert refusal(decide.stay, None, 5.0) == "decision must be a Decision, got None"
    assert "expected_deg must be a finite" in refusal(decide.stay, decision, math.nan)
    assert refusal(decide.check_way, None, decision) == "frame must be a Frame, got None"
    assert refusal(decide.check_way, decision.frame, 5) == "decision must be a Decision, got 5"


def test_tracker(decide: d3.Pipeline) -> None:
    tracker = d3.Tracker()
    assert refusal(d3.Tracker, 5) == "params must be TrackerParams or None, got 5"
    assert refusal(tracker.update, None) == "decision must be a Decision, got None"
    assert "turned_deg must be a finite" in refusal(tracker.update, decide(IMAGE), math.nan)
    for bad in (math.nan, -1.0, None, "1"):
        assert refusal(TrackerParams, smooth_s=bad).startswith("smooth_s must be a number of at")


@pytest.mark.parametrize("call", [d3.open_source, d3.watch])
def test_sources(call: Callable[..., Any]) -> None:
    for bad in (None, 5, b"x.jpg", ["x.jpg"]):
        assert refusal(call, bad).startswith("uri must be text or a path, got ")
    assert refusal(call, "").startswith("uri is empty; expected an image, a folder")
    assert refusal(call, "no\0file")
    assert refusal(call, "examples/doorway.jpg", camera=5).startswith("camera must be a Camera")
    assert refusal(call, "examples/doorway.jpg", pose="x").startswith("pose must be a Pose")
    assert refusal(call, "examples", lop=True) == "open_source has no option lop"
    for bad in (0, -1.0, math.nan, math.inf, "5"):
        assert refusal(call, "examples", fps=bad).startswith("fps must be a number from")
    for bad in (-1.0, math.nan, "5"):
        assert refusal(call, "webcam://0", patience_s=bad).startswith("patience_s must be a number")


def test_watch() -> None:
    line = "pipeline must be a Pipeline or None, got 5"
    assert refusal(d3.watch, "examples/doorway.jpg", 5) == line


def test_load_network() -> None:
    for bad in (None, 5, Path("x.onnx")):
        assert refusal(d3.load_network, bad).startswith("name must be the name of a network")
    for bad_name in ("", "+", "nope", "doornet+"):
        assert "expected doornet, cnn-srin" in refusal(d3.load_network, bad_name)
    for bad in (0, -1, 1.5, math.nan):
        assert "threads must be a whole number" in refusal(d3.load_network, "doornet", threads=bad)
    assert "needs must be a sequence" in refusal(d3.load_network, "doornet", needs="depth")


@pytest.mark.parametrize("bad", [None, 5, b"front.yaml"])
def test_read_camera_info(bad: Any, tmp_path: Path) -> None:
    assert refusal(d3.read_camera_info, bad).startswith("path must be a path, got ")
    assert refusal(d3.read_camera_info, "").startswith("cannot read the camera file")
    assert refusal(d3.read_camera_info, tmp_path).startswith("cannot read the camera file")


def test_drawing(decide: d3.Pipeline) -> None:
    for draw in (d3.annotate, d3.overlay):
        for bad in (None, {}, IMAGE):
            assert refusal(draw, bad).startswith("decision must be a Decision, got ")
    for wrong in (None, math.nan, 399, 1e30, 10**9, "800", 800.5):
        assert "width must be a whole number" in refusal(d3.annotate, decide(IMAGE), width=wrong)


def test_driver_and_loop(decide: d3.Pipeline) -> None:
    for bad in (None, 5, "dry"):
        assert refusal(d3.Driver, bad).startswith("robot must follow the protocol Robot, got ")
    assert "limits must be Limits" in refusal(d3.Driver, DryRobot(), limits=5)
    assert "move must be True or False" in refusal(d3.Driver, DryRobot(), move="no")
    driver = d3.Driver(DryRobot())
    for bad in (None, math.nan, math.inf, "5"):
        assert "theta_deg must be a finite number" in refusal(driver.clamp, bad)
        assert "must" in refusal(driver.turn, bad, 0.0)
        assert "stamp_s must be a finite number" in refusal(driver.turn, 5.0, bad)
        assert refusal(Limits, ttl_s=bad).startswith("ttl_s must be ")
        assert refusal(LoopParams, goes=bad).startswith("goes must be a number of at least 0")
    assert refusal(d3.TurnLoop, None, driver).startswith("eyes must look")
    with d3.watch("examples/doorway.jpg", decide) as eyes:
        assert refusal(d3.TurnLoop, eyes, None) == "driver must be a Driver, got None"
        assert "params must be LoopParams" in refusal(d3.TurnLoop, eyes, driver, 5)


def test_reprs_are_one_short_line(decide: d3.Pipeline) -> None:
    driver, tracker = d3.Driver(DryRobot()), d3.Tracker()
    assert repr(tracker) == "<Tracker following none, belief 0.50>"
    assert repr(driver) == "<Driver of dry, may not move>"
    assert repr(DryRobot()) == "<DryRobot dry>"
    with d3.open_source("examples/doorway.jpg") as source:
        assert repr(source) == "<Stills examples/doorway.jpg>"
    with d3.watch("examples/doorway.jpg", decide) as session:
        assert repr(session) == "<Session of examples/doorway.jpg, 0 updates>"
        update = next(iter(session))
        assert repr(session) == "<Session of examples/doorway.jpg, 1 update>"
        assert repr(d3.TurnLoop(session, driver)) == "<TurnLoop of dry, 0 looks>"
    decision = decide(scene(64, 48))
    shown = [update, update.tracked, decision, decision.frame, decision.perception, decide, CAMERA]
    networks = [Joined([decide.network]), Mirrored(decide.network), decide.network]
    for value in [*shown, *networks, d3.Pose(), d3.Opening(**OPENING), d3.Reason.TURN]:  # type: ignore[arg-type]
        assert "\n" not in repr(value) and " object at 0x" not in repr(value)
        assert len(repr(value)) < 420, repr(value)
