"""A picture in, a decision out: the parts put together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.decide.gates import Gates
from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.errors import UserError
from doorway3ds.networks.doornet import DoorNet
from doorway3ds.types import Frame, Perception, Reason
from tests import factories
from tests.factories import encode, scene


@dataclass(frozen=True)
class Truth:
    """A network that knows the answer: an opening from 40 % to 50 % of the width, a wall at 3 m."""

    p_open: float = 0.9
    gives: frozenset[str] = frozenset({"p_open", "columns", "depth"})
    name: str = "truth"

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        height, width = image.shape[:2]
        return Perception(
            p_open=self.p_open if "p_open" in self.gives else math.nan,
            columns=columns_from_spans([(0.4 * width, 0.5 * width)], width),
            depth_m=np.full((height, width), 3.0, np.float32),
            network=self.name,
            timings_ms={"prepare": 1.0, "network": 2.0},
        )


IMAGE = np.zeros((480, 640, 3), np.uint8)


def test_array_frame_path_and_bytes_give_the_same_answer(tmp_path: Path) -> None:
    pipeline = Pipeline(Truth())
    data = encode(IMAGE, "PNG")
    path = tmp_path / "a.png"
    path.write_bytes(data)
    decision = pipeline(IMAGE)
    frame = decision.frame
    answers = [pipeline(source).to_dict() for source in (IMAGE, frame, path, str(path), data)]
    for answer in answers:
        answer.pop("timings_ms")
    assert answers.count(answers[0]) == len(answers)
    assert decision.reason is Reason.TURN
    # (0.45 * 640 - 319.5) px left of the axis at 60.9 deg over 640 columns
    focal = 320 / math.tan(math.radians(60.9 / 2))
    assert decision.turn_deg == pytest.approx(math.degrees(math.atan(31.5 / focal)), abs=0.1)


def test_timings_cover_every_stage() -> None:
    stages = ["prepare", "network", "selection", "decision"]
    assert list(Pipeline(Truth())(IMAGE).timings_ms) == stages
    timings = Pipeline(Truth())(encode(IMAGE)).timings_ms
    assert list(timings) == ["decode", *stages]
    assert all(ms >= 0 for ms in timings.values())


def test_the_camera_is_exif_s_or_assumed_or_given() -> None:
    pipeline = Pipeline(Truth())
    assert pipeline(IMAGE).frame.camera.assumed
    exif = pipeline(encode(scene(720, 480), focal_35mm=24)).frame.camera
    assert exif.assumed
    assert exif.fx == pytest.approx(720 * 24 / 36)
    given = Camera.from_fov(320, 240, 50.0)
    used = pipeline(IMAGE, camera=given).frame.camera
    assert (used.width, used.height, used.assumed) == (640, 480, False)
    assert used.hfov_deg == pytest.approx(50.0)
    with pytest.raises(UserError, match="640x480"):
        pipeline(IMAGE, camera=Camera.from_fov(320, 320, 50.0))


def test_a_yawed_pose_shifts_the_bearing() -> None:
    pipeline = Pipeline(Truth())
    straight = pipeline(IMAGE).selection.bearing_deg
    turned = pipeline(IMAGE, pose=Pose(yaw_deg=10)).selection.bearing_deg
    assert straight is not None
    assert turned == pytest.approx(straight + 10, abs=1e-6)


def test_gates_are_passed_on() -> None:
    assert Pipeline(Truth(p_open=0.49))(IMAGE).reason is Reason.NO_DOOR
    wide = Pipeline(Truth(), gates=Gates(aligned_deg=20))(IMAGE)
    assert wide.reason is Reason.ALIGNED


def test_paper_takes_any_classifier_and_depth_network() -> None:
    classifier = Truth(p_open=0.7, gives=frozenset({"p_open"}), name="mine")
    depth = Truth(gives=frozenset({"depth"}), name="far")
    decision = Pipeline.paper(classifier, depth)(IMAGE)
    assert decision.method == "paper"
    assert decision.perception.network == "mine+far"
    assert decision.p_open == 0.7
    # A wall at 3 m everywhere: the run of equal depths is the whole row, its middle column 159.
    assert decision.selection.evidence["best_pixel"] == (120, 159)
    assert decision.selection.bearing_deg == pytest.approx(60.9 / 320, abs=1e-6)


def test_a_method_says_what_its_network_lacks() -> None:
    with pytest.raises(UserError, match="method opening needs columns, which network half"):
        Pipeline(Truth(gives=frozenset({"p_open", "depth"}), name="half"))
    with pytest.raises(UserError, match="method paper needs p_open"):
        Pipeline(Truth(gives=frozenset({"depth"})), method="paper")
    with pytest.raises(ValueError, match="method must be one of opening, paper"):
        Pipeline(Truth(), method="magic")  # type: ignore[arg-type]


def test_limits_come_with_the_network(tmp_path: Path) -> None:
    metadata = factories.METADATA | {"thresholds": {"sure_score": 0.7, "floor": {}}}
    network = DoorNet(factories.doornet(tmp_path / "n.onnx", metadata=metadata), threads=1)
    params = Pipeline(network).params
    assert params is not None
    assert params.sure_score == 0.7
    bad = factories.METADATA | {"thresholds": {"nonsense": 1}}
    network = DoorNet(factories.doornet(tmp_path / "b.onnx", metadata=bad), threads=1)
    with pytest.raises(UserError, match="no limit 'nonsense'"):
        Pipeline(network)


def test_a_preset_sets_limits_and_gate(tmp_path: Path) -> None:
    presets = {"eager": {"open_from": 0.3, "limits": {"sure_score": 0.1}}, "odd": 3}
    metadata = {**factories.METADATA, "presets": presets}
    network = DoorNet(factories.doornet(tmp_path / "a.onnx", p_open=-0.5, metadata=metadata))
    pipeline = Pipeline(network, gates=Gates(aligned_deg=1.0), preset="eager")
    assert pipeline.gates == Gates(open_from=0.3, aligned_deg=1.0)
    assert pipeline.params is not None and pipeline.params.sure_score == 0.1
    picture = np.zeros((240, 320, 3), np.uint8)
    assert pipeline(picture).open and not Pipeline(network)(picture).open
    with pytest.raises(UserError, match="no preset 'bold'; it has eager, odd"):
        Pipeline(network, preset="bold")
    with pytest.raises(UserError, match="not an object of limits"):
        Pipeline(network, preset="odd")
    with pytest.raises(UserError, match="names none"):
        Pipeline(Truth(), preset="eager")


def test_same_picture_same_answer_bit_for_bit(tmp_path: Path) -> None:
    data = encode(np.random.default_rng(1).integers(0, 256, (480, 640, 3), dtype=np.uint8))
    pipeline = Pipeline(DoorNet(factories.doornet(tmp_path / "n.onnx")))
    answers = [pipeline(data).to_dict() for _ in range(3)]
    for answer in answers:
        answer.pop("timings_ms")
    assert answers[0] == answers[1] == answers[2]


def test_frames_check_their_camera() -> None:
    with pytest.raises(ValueError, match="the camera is for 320x240"):
        Frame(IMAGE, Camera.from_fov(320, 240, 60.0))
