"""The one resolver of preset, file, field of view and EXIF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.choice import CameraChoice, choose_camera, default_camera, turned_camera
from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.camera.options import CameraOptions, LensOptions
from doorway3ds.camera.presets import PRESETS
from doorway3ds.errors import CallError, UserError
from doorway3ds.sources.base import View

SENSOR = Camera("phone", 640, 480, 560.0, 561.0, 345.0, 228.0, (-0.12, 0.05, 5e-4, -4e-4, 0.0))
MEASURED = Pose(height_m=0.47, pitch_deg=-11.0, yaw_deg=20.0, forward_m=0.06)


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "front.yaml"
    write_camera_info(Camera.from_fov(640, 480, 70.0, name="front"), path)
    return str(path)


def test_a_file_gives_intrinsics_and_leaves_the_measured_pose(file: str) -> None:
    choice = choose_camera(CameraOptions(file))
    frame = View(choice.fit, choice.pose_of).frame(
        np.zeros((240, 320, 3), np.uint8),
        1.0,
        camera=Camera.from_fov(320, 240, 56.3),
        pose=MEASURED,
    )
    assert frame.camera.name == "front"
    assert frame.camera.hfov_deg == pytest.approx(70.0)
    assert frame.pose == MEASURED


@pytest.mark.parametrize(
    ("options", "measured", "expected"),
    [
        (CameraOptions(), None, Pose()),
        (CameraOptions(), MEASURED, MEASURED),
        # a preset's pose is of a robot that stands; what the robot measured is better
        (CameraOptions("nao-v5-top"), None, PRESETS["nao-v5-top"][1]),
        (CameraOptions("nao-v5-top"), MEASURED, MEASURED),
        # what the user says outranks both, and only that
        (
            CameraOptions("pepper-top", pitch_deg=-6.0),
            None,
            Pose(height_m=1.15, forward_m=0.049, pitch_deg=-6.0),
        ),
        (
            CameraOptions(height_m=0.5),
            MEASURED,
            Pose(height_m=0.5, pitch_deg=-11.0, yaw_deg=20.0, forward_m=0.06),
        ),
    ],
)
def test_who_says_the_pose(options: CameraOptions, measured: Pose | None, expected: Pose) -> None:
    assert choose_camera(options).pose_of(measured) == expected


def test_a_field_of_view_is_across_the_width_and_none_is_assumed() -> None:
    choice = choose_camera(LensOptions(fov_deg=80))
    assert choice.given
    assert choice.fit(320, 240).hfov_deg == pytest.approx(80.0)
    unknown = choose_camera(LensOptions())
    assert not unknown.given
    assert unknown.fit(320, 240).assumed
    assert unknown.fit(320, 240, 27.0).name == "EXIF 27 mm"


def test_what_names_no_camera_is_a_wrong_call(tmp_path: Path) -> None:
    with pytest.raises(CallError, match="neither a preset"):
        choose_camera(LensOptions("nao-v9"))
    (tmp_path / "bad.yaml").write_text("image_width: wide\n")
    with pytest.raises(CallError, match=r"bad\.yaml"):
        choose_camera(LensOptions(str(tmp_path / "bad.yaml")))
    with pytest.raises(CallError, match="give one of them"):
        CameraOptions("nao-v5-top", fov_deg=60)
    with pytest.raises(CallError, match="fov_deg must be a number from 1 to 179, got nan"):
        CameraOptions(fov_deg=float("nan"))
    with pytest.raises(UserError, match="aspect"):
        CameraChoice(camera=PRESETS["pepper-top"][0]).fit(100, 300)


def fit(width: int, height: int, _: float | None) -> Camera:
    return SENSOR.scaled_to(width, height)


@pytest.mark.parametrize(
    ("orientation", "size", "centre"),
    [
        (1, (640, 480), (345, 228)),
        (2, (640, 480), (294, 228)),
        (3, (640, 480), (294, 251)),
        (4, (640, 480), (345, 251)),
        (5, (480, 640), (228, 345)),
        (6, (480, 640), (251, 345)),
        (7, (480, 640), (251, 294)),
        (8, (480, 640), (228, 294)),
    ],
)
def test_a_file_turns_with_the_image(
    orientation: int, size: tuple[int, int], centre: tuple[float, float]
) -> None:
    camera = turned_camera(fit, *size, None, orientation)
    assert (camera.width, camera.height) == size
    assert (camera.cx, camera.cy) == pytest.approx(centre)
    half = turned_camera(fit, size[0] // 2, size[1] // 2, None, orientation)
    assert (half.cx, half.cy) == pytest.approx([(v + 0.5) / 2 - 0.5 for v in centre])


def test_a_file_for_the_upright_image_is_taken_as_it_is() -> None:
    upright = replace(SENSOR, width=480, height=640)
    assert turned_camera(lambda w, h, _: upright.scaled_to(w, h), 480, 640, None, 6) == upright


def test_an_assumed_camera_is_that_of_the_upright_image() -> None:
    for orientation in range(1, 9):
        assert turned_camera(default_camera, 480, 640, 27.0, orientation) == default_camera(
            480, 640, 27.0
        )
