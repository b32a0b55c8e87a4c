"""Camera files of other tools: OpenCV, ROS's messages and ost.txt, Kalibr, ORB-SLAM, VINS."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.camera.info import read_camera_info
from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError

LENS = Camera("file", 640, 480, 520.0, 525.0, 325.5, 236.0, (-0.31, 0.12, 0.002, -0.0015, -0.02))
MATRIX = np.array([[520.0, 0, 325.5], [0, 525.0, 236.0], [0, 0, 1]])


@pytest.mark.parametrize("suffix", [".yaml", ".json", ".xml", ".xml.gz"])
@pytest.mark.parametrize(
    "names",
    [
        ("image_width", "image_height", "camera_matrix", "distortion_coefficients"),
        ("image_Width", "image_Height", "Camera_Matrix", "Distortion_Coefficients"),
        ("width", "height", "cameraMatrix", "distCoeffs"),
        ("width", "height", "CameraMatrix", "DistCoeffs"),
        ("width", "height", "mtx", "dist"),
    ],
)
def test_opencvs_file_storage(tmp_path: Path, suffix: str, names: tuple[str, ...]) -> None:
    path = tmp_path / f"file{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    values = (640, 480, MATRIX, np.array([LENS.distortion]).T)
    for name, value in zip(names, values, strict=True):
        storage.write(name, value)
    storage.release()
    assert read_camera_info(path) == replace(LENS, name=path.stem)


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
    with pytest.raises(UserError, match="holds cam0, cam1; keep only the one"):
        read_camera_info(path)


@pytest.mark.parametrize(
    "text",
    [
        # ROS's ost.txt
        "# Camera intrinsics\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[front]\n\n"
        "camera matrix\n520.0 0.0 325.5\n0.0 525.0 236.0\n0.0 0.0 1.0\n\n"
        "distortion\n-0.31 0.12 0.002 -0.0015 -0.02\n\nrectification\n1 0 0\n0 1 0\n0 0 1\n",
        # ORB-SLAM
        '%YAML:1.0\nCamera.type: "PinHole"\nCamera1.fx: 520.0\nCamera1.fy: 525.0\n'
        "Camera1.cx: 325.5\nCamera1.cy: 236.0\nCamera1.k1: -0.31\nCamera1.k2: 0.12\n"
        "Camera1.p1: 0.002\nCamera1.p2: -0.0015\nCamera1.k3: -0.02\n"
        "Camera.width: 640\nCamera.height: 480\n",
        # VINS
        "%YAML:1.0\n---\nmodel_type: PINHOLE\nimage_width: 640\nimage_height: 480\n"
        "distortion_parameters: {k1: -0.31, k2: 0.12, p1: 0.002, p2: -0.0015, k3: -0.02}\n"
        "projection_parameters: {fx: 520.0, fy: 525.0, cx: 325.5, cy: 236.0}\n",
    ],
    ids=["ost", "orb-slam", "vins"],
)
def test_files_that_name_each_number(tmp_path: Path, text: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    assert read_camera_info(path) == LENS


PLAIN = """camera_name: file
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [520, 0, 325.5, 0, 525, 236, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.31, 0.12, 0.002, -0.0015, -0.02]}
"""


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16", "utf-16-le", "utf-32"])
def test_encodings_of_other_editors(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "file.yaml"
    text = "# T\xfcr\r\n" + PLAIN.replace("\n", "\r\n").replace("640", "\t640")
    path.write_bytes(text.encode(encoding))
    assert read_camera_info(path) == LENS


@pytest.mark.parametrize(
    ("said", "model"),
    [
        ("Plumb Bob", "plumb_bob"),
        ("radtan", "plumb_bob"),
        ("fisheye", "equidistant"),
        ("kannala_brandt4", "equidistant"),
    ],
)
def test_other_names_of_the_models(tmp_path: Path, said: str, model: str) -> None:
    path = tmp_path / "file.yaml"
    four = PLAIN.replace(", -0.02]", "]").replace("-0.31, 0.12", "-0.02, 0.01")
    path.write_text(four.replace("plumb_bob", said))
    assert read_camera_info(path).distortion_model == model


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("520, 0, 325.5, 0, 525, 236, 0, 0, 1", "520, 0, 0, 0, 525, 0, 325.5, 236, 1", "be fx 0"),
        ("520, 0, 325.5", "520, 30, 325.5", "must be fx 0 cx"),
        ("520, 0, 325.5, 0, 525, 236, 0, 0, 1", "0, 0, 0, 0, 0, 0, 0, 0, 0", "not been calibrated"),
        ("520, 0, 325.5, 0, 525, 236", "0.81, 0, 0.51, 0, 1.09, 0.49", "are they in pixels"),
        ("640", "320", "outside its image of 320x480"),
        ("camera_name: file", "roi: {width: 300, height: 200}", "cut to a region of 300x200"),
    ],
    ids=["transposed", "skewed", "zero", "normalised", "of another size", "of a region"],
)
def test_what_would_be_read_wrong_in_silence_is_refused(
    tmp_path: Path, old: str, new: str, error: str
) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(PLAIN.replace(old, new))
    with pytest.raises(UserError, match=error):
        read_camera_info(path)
