from __future__ import annotations

import io
import time
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import CallError, UserError
from doorway3ds.sources import open_source
from tests.factories import encode, scene


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, width in (("b.png", 32), ("a.jpg", 64), ("c.jpg", 48)):
        kind = "PNG" if name.endswith("png") else "JPEG"
        (tmp_path / name).write_bytes(encode(scene(width, 24), kind))
    (tmp_path / "notes.txt").write_text("no image")
    return tmp_path


def test_a_folder_gives_its_images_in_name_order(folder: Path) -> None:
    with open_source(str(folder), fps=5) as source:
        seen = [(frame.image.shape[1], frame.stamp_s, source.frame_name) for frame in source]
    assert [width for width, _, _ in seen] == [64, 32, 48]
    assert [stamp for _, stamp, _ in seen] == pytest.approx([0, 0.2, 0.4])
    assert seen[1][2] == str(folder / "b.png")
    assert not source.live and source.ended and source.read() is None


def test_a_pattern_gives_what_it_matches(folder: Path) -> None:
    with open_source(f"{folder}/*.jpg") as source:
        assert [frame.image.shape[1] for frame in source] == [64, 48]


def test_one_image_with_its_own_focal_length_or_the_given_camera(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(encode(scene(64, 48), focal_35mm=36))
    (frame,) = open_source(str(path))
    assert frame.camera.fx == pytest.approx(64) and frame.camera.assumed
    given = Camera.from_fov(128, 96, 90)
    (frame,) = open_source(str(path), camera=given, pose=Pose(height_m=0.5))
    assert (frame.camera.width, frame.camera.hfov_deg) == (64, pytest.approx(given.hfov_deg, abs=1))
    assert frame.pose.height_m == 0.5
    (frame,) = open_source(str(path), camera=lambda w, h, f: Camera.from_fov(w, h, 50 + f))
    assert frame.camera.hfov_deg == pytest.approx(86)


def test_a_damaged_image_is_left_out_and_named(folder: Path) -> None:
    (folder / "b.png").write_bytes(b"nothing")
    lines: list[str] = []
    with open_source(str(folder)) as source:
        source.notice = lines.append
        assert len(list(source)) == 2
    assert source.damaged == 1
    assert len(lines) == 1 and "b.png" in lines[0]


def test_where_no_image_can_be_used_the_error_says_why(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(b"nothing")
    with open_source(str(path), loop=True) as source, pytest.raises(UserError, match=r"photo\.jpg"):
        list(source)
    with pytest.raises(UserError, match="aspect"):
        path.write_bytes(encode(scene(64, 48)))
        list(open_source(str(path), camera=Camera.from_fov(64, 64, 60)))


def test_paced_and_looped(folder: Path) -> None:
    with open_source(str(folder), fps=20, pace=True, loop=True) as source:
        start = time.monotonic()
        stamps = [source.read().stamp_s for _ in range(7)]
        assert time.monotonic() - start >= 0.29
        assert stamps == pytest.approx([i / 20 for i in range(7)])
        assert source.read(timeout_s=0.0) is None


@pytest.mark.parametrize(
    ("uri", "expected", "error"),
    [
        ("nowhere.jpg", "nowhere.jpg does not exist", UserError),
        ("*.jpg", "matches no file", UserError),
        (".", "holds no image", UserError),
        ("ftp://host/film", "no source is called ftp://", CallError),
        ("webcam://front", "expected webcam://0", CallError),
        ("webcam://0?width=wide", "width must be a whole number, got 'wide'", CallError),
        ("webcam://0?width=-5", "width must be a number from 0 to 1e+09, got -5", CallError),
        ("webcam://0?fps=nan", "fps must be a number from 0 to 1e+09, got nan", CallError),
        ("webcam://0?zoom=2", "no option 'zoom'; expected width, height, fps", CallError),
        ("http:///video", "expected http://HOST", CallError),
        ("http://host:99999/video", "expected http://HOST", CallError),
        ("http://[host/video", "is not an address", CallError),
        ("http://me:secret@host:99999/v", "http://me:***@host:99999/v: expected", CallError),
        ("http://me:secret@[host/v", "http://***@[host/v is not an address", CallError),
    ],
)
def test_what_names_no_source_is_said_in_one_line(
    uri: str,
    expected: str,
    error: type[UserError],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error) as caught:
        open_source(uri)
    assert expected in str(caught.value) and "\n" not in str(caught.value)


def test_images_on_standard_input() -> None:
    data = encode(scene(64, 48)) + encode(scene(32, 24), "PNG") + encode(scene(48, 24))
    with open_source("-", stream=io.BytesIO(data), fps=4) as source:
        seen = [(frame.image.shape[1], frame.stamp_s, source.frame_name) for frame in source]
    assert seen == [(64, 0, "-#1"), (32, 0.25, "-#2"), (48, 0.5, "-#3")]


def test_a_damaged_end_of_standard_input_is_counted() -> None:
    picture = encode(scene())
    with open_source("-", stream=io.BytesIO(picture + picture[:300])) as source:
        assert len(list(source)) == 1
    assert source.damaged == 1


@pytest.mark.parametrize("data", [b"", b"text", encode(scene())[:300]])
def test_standard_input_without_any_image_is_an_error(data: bytes) -> None:
    with pytest.raises(UserError, match="held no image"):
        list(open_source("-", stream=io.BytesIO(data)))


def test_pictures_come_in_natural_order_from_folders_and_patterns(tmp_path: Path) -> None:
    for number in (1, 2, 3, 10, 11, 20):
        (tmp_path / f"{number}.png").write_bytes(encode(scene(), "PNG"))
    for uri in (str(tmp_path), f"{tmp_path}/*.png"):
        with open_source(uri) as source:
            names = [Path(source.frame_name).stem for _ in source]
        assert names == ["1", "2", "3", "10", "11", "20"]


def test_a_picture_that_its_decoder_would_make_up_is_left_out_and_counted(tmp_path: Path) -> None:
    data = encode(scene(320, 240))
    (tmp_path / "1.jpg").write_bytes(data)
    (tmp_path / "2.jpg").write_bytes(data[:2000] + data[2300:])
    (tmp_path / "3.heic").write_bytes(b"\0\0\0\x18ftypheic" + bytes(40))
    lines: list[str] = []
    with open_source(str(tmp_path)) as source:
        source.notice = lines.append
        assert len(list(source)) == 1
        assert source.damaged == 2
    assert ["2.jpg is damaged" in lines[0], "3.heic is" in lines[1]] == [True, True]
    piped = io.BytesIO(data + data[:2000] + data[2300:] + data)
    with open_source("-", stream=piped) as source:
        assert (len(list(source)), source.damaged) == (2, 1)


def test_a_camera_turns_with_pictures_of_other_orientations(tmp_path: Path) -> None:
    camera = Camera("phone", 64, 48, 56.0, 56.0, 35.0, 22.0)
    for orientation in (1, 3, 6, 8):
        upright = scene(48, 64) if orientation > 4 else scene(64, 48)
        turns = {1: 0, 3: 2, 6: 1, 8: 3}[orientation]
        stored = np.ascontiguousarray(np.rot90(upright, turns))
        data = encode(stored, orientation=orientation)
        (tmp_path / f"{orientation}.jpg").write_bytes(data)
    with open_source(str(tmp_path), camera=camera) as source:
        cameras = [frame.camera for frame in source]
    assert [(c.cx, c.cy) for c in cameras] == [(35, 22), (28, 25), (25, 35), (22, 28)]
