"""Bags as a source, in all formats."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import CallError, UserError
from doorway3ds.sources import open_source
from tests.conftest import Cli
from tests.factories import scene

pytest.importorskip("rosbags", reason="needs the extra bag")
from tests.ros import bags

CAMERA = Camera("cam", 160, 120, 140.0, 141.0, 81.0, 58.0, (-0.1, 0.02, 0.001, -0.002, 0.003))
POSE = Pose(0.6, pitch_deg=-4.0, yaw_deg=2.0, forward_m=0.1, left_m=0.03)


def pictures(count: int = 3) -> list[np.ndarray]:
    return [np.roll(scene(160, 120), 9 * i, axis=1) for i in range(count)]


@pytest.mark.parametrize("kind", bags.KINDS)
def test_images_camera_and_pose_come_back_bit_for_bit(tmp_path: Path, kind: str) -> None:
    images = pictures()
    path = bags.write(tmp_path / "bag", kind, bags.camera_topics(images, CAMERA, POSE))
    with open_source(f"bag://{path}") as source:
        assert source.fps == pytest.approx(10, rel=0.1)  # the pose comes a little earlier
        frames = list(source)
    assert len(frames) == 3 and source.ended
    for number, (frame, image) in enumerate(zip(frames, images, strict=True)):
        assert np.array_equal(frame.image, image)
        assert frame.stamp_s == pytest.approx(100 + 0.1 * number, abs=1e-6)  # of the header
        assert vars(frame.pose) == pytest.approx(vars(POSE), abs=1e-9)
        assert (frame.camera.fx, frame.camera.distortion) == (CAMERA.fx, CAMERA.distortion)
        assert not frame.camera.assumed
    assert source.frame_name.endswith("/cam/image_raw#3")


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_one_file_of_a_bag_is_enough(tmp_path: Path, kind: str) -> None:
    folder = bags.write(tmp_path / "bag", kind, bags.camera_topics(pictures(), CAMERA))
    file = next(path for path in folder.iterdir() if path.suffix in (".mcap", ".db3"))
    lone = tmp_path / file.name
    file.rename(lone)
    with open_source(f"bag://{lone}") as source:
        assert len(list(source)) == 3


def test_what_the_user_says_outranks_the_bag(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", "mcap", bags.camera_topics(pictures(1), CAMERA, POSE))
    mine = Camera.from_fov(160, 120, 90)
    with open_source(f"bag://{path}", camera=mine, pose=Pose(1.0)) as source:
        frame = next(source)
    assert frame.camera == mine and frame.pose == Pose(1.0)


def test_topics_are_listed_when_none_is_named(tmp_path: Path) -> None:
    entries = bags.camera_topics(pictures(1), CAMERA)
    entries += bags.camera_topics(pictures(2), topic="/rear/image_raw")
    path = bags.write(tmp_path / "bag", "mcap", entries)
    with pytest.raises(CallError, match=r"on /cam/image_raw, /rear/image_raw; name one of them"):
        open_source(f"bag://{path}")
    with pytest.raises(CallError, match=r"no images on /front; it has them on /cam/image_raw"):
        open_source(f"bag://{path}?topic=/front")
    with open_source(f"bag://{path}?topic=/rear/image_raw") as source:
        frames = list(source)
    assert len(frames) == 2 and frames[0].camera.assumed  # the calibration is the other camera's


def test_a_bag_without_images_says_what_it_holds(tmp_path: Path) -> None:
    entries = bags.camera_topics(pictures(1), CAMERA)[:1]
    path = bags.write(tmp_path / "bag", "sqlite3", entries)
    with pytest.raises(UserError, match="holds no images; its topics: /cam/camera_info"):
        open_source(f"bag://{path}")


def test_a_camera_of_another_aspect_is_told_and_left_out(tmp_path: Path) -> None:
    images = [scene(160, 120), scene(160, 90)]
    path = bags.write(tmp_path / "bag", "mcap", bags.camera_topics(images, CAMERA))
    said: list[str] = []
    with open_source(f"bag://{path}") as source:
        source.notice = said.append
        assert len(list(source)) == 1
    assert source.damaged == 1 and "another aspect" in said[0]


def test_it_begins_again(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", "mcap", bags.camera_topics(pictures(2), CAMERA))
    with open_source(f"bag://{path}", loop=True) as source:
        stamps = [next(source).stamp_s for _ in range(5)]
    assert stamps == pytest.approx([100, 100.1, 100, 100.1, 100], abs=1e-6)


@pytest.mark.parametrize("kind", bags.KINDS)
def test_damaged_bags_are_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = bags.write(tmp_path / "bag", kind, bags.camera_topics(pictures(), CAMERA))
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")
    whole = file.read_bytes()
    for share in (0, 0.3, 0.7, 0.99):
        file.write_bytes(whole[: round(share * len(whole))])
        read = 0
        try:
            with open_source(f"bag://{path}") as source:
                read = len(list(source))
        except UserError as error:
            assert "\n" not in str(error) and path.name in str(error)
        else:
            assert 0 < read <= 3


def test_other_files_are_no_bags(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(UserError, match=r"notes.txt is not a bag; expected .bag, .mcap"):
        open_source(f"bag://{tmp_path}/notes.txt")
    with pytest.raises(UserError, match="does not exist"):
        open_source(f"bag://{tmp_path}/missing.bag")
    with pytest.raises(CallError, match="no option 'topik'"):
        open_source(f"bag://{tmp_path}/notes.txt?topik=/a")


@pytest.mark.parametrize(
    ("image", "infos", "expected"),
    [
        ("/cam/image_raw", ["/rear/camera_info", "/cam/camera_info"], "/cam/camera_info"),
        ("/cam/image_raw/compressed", ["/cam/camera_info"], "/cam/camera_info"),
        ("/image_raw", ["/camera_info"], "/camera_info"),
        ("/cam/color/image", ["/cam/depth/camera_info"], None),
        ("/cam/image_raw", [], None),
    ],
)
def test_the_calibration_beside_an_image(
    image: str, infos: list[str], expected: str | None
) -> None:
    from doorway3ds.ros.bag import beside

    assert beside(image, infos) == expected


def test_live_decides_on_a_bag(cli: Cli, tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", "mcap", bags.camera_topics(pictures(), CAMERA, POSE))
    ran = cli("live", f"bag://{path}", "--network", "net.onnx", "--json")
    lines = [json.loads(line) for line in ran.out.splitlines()]
    assert ran.status == 0 and len(lines) == 3
    assert [line["stamp_s"] for line in lines] == pytest.approx([100, 100.1, 100.2], abs=1e-6)
    assert lines[0]["camera"] == {"name": "/cam/camera_info", "assumed": False}


def test_look_answers_each_image_of_a_bag(cli: Cli, tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", "ros1", bags.camera_topics(pictures(), CAMERA, POSE))
    ran = cli("look", f"bag://{path}", "photo.jpg", "--network", "net.onnx", "--out", "out")
    assert ran.status == 0 and len(ran.out.splitlines()) == 4
    assert "/cam/image_raw#3: open door" in ran.out and "4 of 4 answered" in ran.err
    assert sorted(p.name for p in Path("out").iterdir())[:2] == [
        "bag-000001_3ds.jpg",
        "bag-000002_3ds.jpg",
    ]


def test_live_writes_a_bag_that_reads_back(cli: Cli, tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    path = bags.write(tmp_path / "bag", "mcap", bags.camera_topics(pictures(), CAMERA, POSE))
    ran = cli("live", f"bag://{path}", "--network", "net.onnx", "--json", "--bag", "kept")
    assert ran.status == 0, ran.err
    said = [json.loads(line) for line in ran.out.splitlines()]
    with AnyReader([Path("kept")]) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
        topics = [one for one in reader.connections if one.topic == "/doorway3ds/decision"]
        kept = [
            json.loads(reader.deserialize(data, one.msgtype).data)
            for one, _, data in reader.messages(topics)
        ]
        shown = [one for one in reader.connections if one.topic == "/doorway3ds/markers"]
        connection, _, data = next(iter(reader.messages(shown)))
        marks = reader.deserialize(data, connection.msgtype).markers
    assert kept == said
    assert all(counts[f"/doorway3ds/{one}"] == 3 for one in ("decision", "markers", "depth"))
    assert {one.ns for one in marks} >= {"words"}
    assert list(Path("kept").glob("*.mcap")) and not list(Path().glob(".kept*"))
    # The record is itself a source, with the same camera and pose.
    with open_source("bag://kept?topic=/camera/image_raw/compressed") as source:
        frames = list(source)
    assert len(frames) == 3
    assert frames[0].camera.distortion == pytest.approx(CAMERA.distortion)
    assert all(vars(one.pose) == pytest.approx(vars(POSE), abs=1e-9) for one in frames)
    again = cli("live", f"bag://{path}", "--network", "net.onnx", "--bag", "kept")
    assert again.status == 1 and "kept exists; a bag is a new folder" in again.err


MARKS = "image,open,left_px,right_px,clear,confidence,second\n"


def test_eval_scores_marks_of_a_bag_with_its_camera_and_pose(cli: Cli, tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", "mcap", bags.camera_topics(pictures(), CAMERA, POSE))
    looked = cli("look", f"bag://{path}", "--network", "net.onnx", "--json")
    expected = [json.loads(line) for line in looked.out.splitlines()]
    named = cli("live", f"bag://{path}", "--network", "net.onnx", "--json", "--log", "walk")
    assert named.status == 0, named.err
    Path("walk/doorways.csv").write_text(
        f"{MARKS}0001.png,1,{expected[0]['openings'][0]['left_px']},"
        f"{expected[0]['openings'][0]['right_px']},1,3,\n0003.png,0,,,,3,\n"
    )
    call = ["eval", "direction", f"bag://{path}", "--network", "net.onnx", "--method", "opening"]
    call += ["--repeats", "0", "--json", "-", "--save-answers", "answers.jsonl"]
    ran = cli(*call, "--marks", "walk/doorways.csv")
    assert ran.status == 0, ran.err
    answers = [json.loads(line) for line in Path("answers.jsonl").read_text().splitlines()]
    assert [one["image"] for one in answers] == ["0001.png", "0003.png"]
    for answer, of_look in zip(answers, (expected[0], expected[2]), strict=True):
        assert answer["camera"] == {"name": "/cam/camera_info", "assumed": False}
        assert answer["bearing_deg"] == of_look["bearing_deg"]
    # Without --marks, those beside the bag.
    none = cli(*call)
    assert none.status == 1 and "doorways.csv" in none.err
    (tmp_path / "doorways.csv").write_text(f"{MARKS}0009.png,0,,,,3,\n")
    none = cli(*call)
    assert none.status == 1
    assert f"marks 0009.png; expected images of {path}, 0001.png to 0003.png" in none.err
