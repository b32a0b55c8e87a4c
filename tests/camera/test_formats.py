"""Camera files of other tools: OpenCV, `topic echo`, Kalibr."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.camera import Camera, read_camera_info
from doorway3ds.errors import UserError

LENS = Camera("file", 640, 480, 520.0, 525.0, 325.5, 236.0, (-0.31, 0.12, 0.002, -0.0015, -0.02))
MATRIX = np.array([[520.0, 0, 325.5], [0, 525.0, 236.0], [0, 0, 1]])


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@pytest.mark.parametrize(
    "names",
    [
        ("image_width", "image_height", "camera_matrix", "distortion_coefficients"),
        ("image_Width", "image_Height", "Camera_Matrix", "Distortion_Coefficients"),
        ("width", "height", "cameraMatrix", "distCoeffs"),
    ],
)
def test_opencvs_file_storage(tmp_path: Path, suffix: str, names: tuple[str, ...]) -> None:
    path = tmp_path / f"file{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    values = (640, 480, MATRIX, np.array([LENS.distortion]).T)
    for name, value in zip(names, values, strict=True):
        storage.write(name, value)
    storage.release()
    assert read_camera_info(path) == LENS


def test_opencvs_fisheye_flag_tells_four_coefficients(tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    for flag, model in ((1, "equidistant"), (0, "plumb_bob")):
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        storage.write("image_width", 640)
        storage.write("image_height", 480)
        storage.write("fisheye_model", flag)
        storage.write("camera_matrix", MATRIX)
        storage.write("distortion_coefficients", np.array([[-0.02, 0.01, 0.001, 0.001]]))
        storage.release()
        assert read_camera_info(path).distortion_model == model


@pytest.mark.parametrize("names", ["dk", "DK"])
def test_topic_echo(tmp_path: Path, names: str) -> None:
    d, k = names

    def items(name: str, values: object) -> str:
        return f"{name}:\n" + "".join(f"- {float(v)}\n" for v in np.ravel(values))

    message = (
        "header:\n  stamp:\n    sec: 12\n    nanosec: 34\n  frame_id: camera\n"
        "height: 480\nwidth: 640\ndistortion_model: plumb_bob\n"
        + items(d, LENS.distortion)
        + items(k, MATRIX)
        + "binning_x: 0\n---\n"
    )
    path = tmp_path / "file.yaml"
    path.write_text(message * 2)
    assert read_camera_info(path) == LENS
    path.write_text(message, encoding="utf-16")
    assert read_camera_info(path) == LENS


CHAIN = """cam0:
  camera_model: {kind}
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.7e-05]
  distortion_model: {model}
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
"""


def test_kalibrs_camchain(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    found = Camera(
        "cam0", 752, 480, 458.6, 457.3, 367.2, 248.4, (-0.28, 0.07, 0.0002, 1.7e-05, 0.0)
    )
    path.write_text(CHAIN.format(kind="pinhole", model="radtan"))
    assert read_camera_info(path) == found
    path.write_text(CHAIN.format(kind="pinhole", model="equidistant"))
    assert read_camera_info(path) == replace(
        found, distortion=found.distortion[:4], distortion_model="equidistant"
    )
    path.write_text(CHAIN.format(kind="omni", model="radtan"))
    with pytest.raises(UserError, match="expected Kalibr's pinhole"):
        read_camera_info(path)
    one = CHAIN.format(kind="pinhole", model="radtan")
    path.write_text(one + one.replace("cam0", "cam1"))
    with pytest.raises(UserError, match="holds cam0, cam1; keep the one"):
        read_camera_info(path)
