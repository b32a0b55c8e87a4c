import json
import math
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest

from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import UserError
from doorway3ds.lab.datasets import readers, truth
from doorway3ds.lab.datasets import samples as datasets
from doorway3ds.lab.datasets.readers import read_dataset
from tests.factories import HEADER, write_picture


def truth_of(sample):
    frame = datasets.load_frame(sample)
    return truth.picture_truth(sample, frame, datasets.load_depth(sample))


def test_nyu_is_cut_and_its_camera_moves_along(nyu):
    data = read_dataset(nyu)
    assert (data.layout, data.places_known) == ("nyu", True)
    assert [s.place for s in data.samples] == ["000", "000", "001"]
    sample = data.samples[0]
    frame = datasets.load_frame(sample)
    assert frame.image.shape == (460, 620, 3)
    depth = datasets.load_depth(sample)
    assert depth[0, 0] == pytest.approx(51 * 9.9955 / 255)
    assert depth[0, 290] == 10  # or more; column 300 of the uncut picture
    first, second = truth_of(sample).openings
    # By the uncut camera: atan((325.58 - 350) / 518.86)
    assert first.bearing_deg == pytest.approx(math.degrees(math.atan2(325.58 - 350, 518.86)))
    assert first.left_deg == pytest.approx(math.degrees(math.atan2(325.58 - 300, 518.86)))
    assert (first.clear, first.second, second.clear, second.second) == (True, False, False, True)


def test_range_comes_from_the_jambs_not_from_what_lies_behind(nyu):
    sample = read_dataset(nyu).samples[0]
    z = 51 * 9.9955 / 255
    first, second = truth_of(sample).openings
    # strips of 3.1 to 15.5 px outside columns 300 and 400; 346 to 354 on average
    assert first.range_m == pytest.approx(z * math.hypot(1, (350 - 325.58) / 518.86), rel=0.002)
    assert second.range_m is None  # cut by the picture's edge


def test_the_eigen_box_is_the_published_one(nyu):
    top, bottom, left, right = read_dataset(nyu).samples[0].eigen_box
    assert (top + 10, bottom + 10, left + 10, right + 10) == (45, 470, 41, 601)


def test_kinds_come_from_the_labels(nyu):
    sample = read_dataset(nyu).samples[2]
    labels = datasets.load_labels(sample)
    assert labels.shape == (460, 620)
    assert datasets.kinds_shown(sample, labels) == ("closed door",)


def test_a_kind_counts_from_two_percent_of_the_picture_on(nyu):
    """Its classes together, and of what remains after the frame is cut."""
    sample = read_dataset(nyu).samples[2]
    labels = np.zeros((460, 620), np.uint8)
    labels[:, :7] = 12  # blinds
    labels[:, 7:13] = 15  # curtain
    assert datasets.kinds_shown(sample, labels) == ("window",)
    labels[:, 12] = 39
    assert datasets.kinds_shown(sample, labels) == ()


def test_labels_that_are_no_labels_are_one_line(nyu):
    file = nyu / "labels" / "0045.png"
    cv2.imwrite(str(file), np.zeros((480, 640, 3), np.uint8))
    with pytest.raises(UserError, match=r"0045\.png is not a one-channel 8-bit label image"):
        datasets.load_labels(read_dataset(nyu).samples[2])


def test_confidence_leaves_pictures_and_further_openings_out(nyu):
    data = datasets.at_least(read_dataset(nyu), 2)
    assert [len(s.openings) for s in data.samples] == [1, 1, 0]
    assert len(datasets.at_least(data, 3).samples) == 2


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0002.jpg,1,abc,400,1,3,0", "line 2: expected a number for left_px, got 'abc'"),
        ("0002.jpg,1,400,300,1,3,0", "line 2: an open row needs left_px below right_px"),
        ("0002.jpg,1,,,1,3,0", "line 2: an open row needs left_px"),
        ("0002.jpg,2,300,400,1,3,0", "line 2: expected 0, 1 or nothing for open, got '2'"),
        ("0002.jpg,,300,400,1,3,0", "line 2: expected open 0 or 1"),
        ("0002.jpg,1,300,400,yes,3,0", "expected 0, 1 or nothing for clear, got 'yes'"),
        ("0002.jpg,1,300,400,1,4,0", "expected a confidence of 1, 2 or 3, got '4'"),
        ("0002.jpg,1,300,400", "line 2: expected 7 fields"),
        ("0002.jpg,1,300,400,1,3,0,9,9", "line 2: expected 7 fields"),
        ("0002.jpg,1,nan,400,1,3,0", "expected a number for left_px, got 'nan'"),
        ("0002.jpg,1,700,800,1,3,0", "line 2: the opening lies outside the image"),
        ("9999.jpg,0,,,,3,0", "line 2: there is no image 9999.jpg"),
        (",0,,,,3,0", "line 2: names no image"),
        ("../0002.jpg,0,,,,3,0", "line 2: expected an image's name below the folder"),
        ('0002.jpg,0,,,,3,"0', "not a CSV file"),
        ("", "holds no marked images"),
    ],
)
def test_a_damaged_table_is_one_line_that_says_where(nyu, row, message):
    (nyu / "doorways.csv").write_text(HEADER + "\n" + row + "\n")
    with pytest.raises(UserError) as caught:
        read_dataset(nyu)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "lacks the column image"),
        (b"image,left_px,right_px\n", "lacks the column open"),
        (b"\xffimage", "not a CSV file in UTF-8"),
        (b"image,open\x00", "lacks the column"),
    ],
)
def test_a_table_of_another_kind_is_refused(nyu, content, message):
    (nyu / "doorways.csv").write_bytes(content)
    with pytest.raises(UserError, match=message):
        read_dataset(nyu)


def test_a_damaged_picture_is_named_when_it_is_read(nyu):
    (nyu / "images" / "0003.jpg").write_bytes(b"no image")
    (nyu / "depth" / "0002.png").write_bytes(b"no image")
    first, second, _ = read_dataset(nyu).samples
    with pytest.raises(UserError, match=r"0003\.jpg"):
        datasets.load_frame(second)
    with pytest.raises(UserError, match=r"0002\.png"):
        datasets.load_depth(first)


def test_too_small_a_picture_cannot_be_cut(nyu):
    write_picture(nyu / "images" / "0002.jpg", 320, 240)
    with pytest.raises(UserError, match="320x240; expected at least 630x470"):
        datasets.load_frame(read_dataset(nyu).samples[0])


def test_rendered_pictures_bring_their_camera_pose_and_depth(tmp_path):
    write_picture(tmp_path / "images" / "a.png", 64, 48)
    (tmp_path / "depth").mkdir()
    depth = np.full((48, 64), 2500, np.uint16)
    depth[0, 0] = 0
    cv2.imwrite(str(tmp_path / "depth" / "a.png"), depth)
    (tmp_path / "doorways.csv").write_text(
        HEADER + ",fx_px,pitch_deg,height_m,home,range_m,state\n"
        "a.png,1,10,20,1,3,0,60.5,9.7,0.52,7,2.25,open\n"
    )
    data = read_dataset(tmp_path)
    assert (data.layout, data.places_known) == ("rendered", True)
    (sample,) = data.samples
    assert sample.camera == Camera("rendered", 64, 48, 60.5, 60.5, 31.5, 23.5)
    assert sample.pose == Pose(height_m=0.52, pitch_deg=9.7)
    assert sample.place == "home-7"
    assert sample.kinds == ()
    truth = truth_of(sample)
    assert truth.openings[0].range_m == 2.25
    map_m = datasets.load_depth(sample)
    assert map_m[1, 1] == 2.5
    assert math.isnan(map_m[0, 0])


def test_the_renderers_own_camera_and_pose_win(tmp_path):
    write_picture(tmp_path / "images" / "a.png", 64, 48)
    (tmp_path / "doorways.csv").write_text(HEADER + ",fx_px,state\na.png,0,,,,1,0,60.5,closed\n")
    camera = Camera("lens", 64, 48, 61, 62, 30, 24, (-0.2, 0.01, 0, 0, 0))
    pose = Pose(0.5, 3, roll_deg=2)
    told = {"image": "a.png", "camera": asdict(camera), "pose": asdict(pose)}
    file = tmp_path / "truth.jsonl"
    file.write_text(json.dumps(told) + "\n")
    (sample,) = read_dataset(tmp_path).samples
    assert (sample.camera, sample.pose, sample.kinds) == (camera, pose, ("closed door",))
    in_view = ["sliding_closed", "window", "open", "window"]
    file.write_text(json.dumps({**told, "in_view": in_view}) + "\n")
    (sample,) = read_dataset(tmp_path).samples
    assert sample.kinds == ("closed glass door", "window")
    file.write_text("{}\n")
    with pytest.raises(UserError, match=r"truth\.jsonl line 1"):
        read_dataset(tmp_path)


def test_pictures_of_any_size_marked_by_hand(tmp_path):
    sizes = {"a.jpg": (64, 48), "b.jpg": (30, 90), "c.jpg": (80, 20), "hall/d.jpg": (64, 48)}
    for name, size in sizes.items():
        write_picture(tmp_path / name, *size)
    (tmp_path / "doorways.csv").write_text(
        HEADER + ",state,place\n"
        "a.jpg,1,10.5,20,1,3,0,open,\na.jpg,1,40,63.5,,2,1,half,\n"
        "b.jpg,1,-0.5,9,0,1,0,half,\nc.jpg,0,,,,3,0,closed,\nhall/d.jpg,0,,,,3,0,none,hall\n"
    )
    data = read_dataset(tmp_path)
    assert (data.layout, data.places_known) == ("plain", False)
    a, b, c, d = data.samples
    # one opening half open and one open: there is an open doorway
    assert [s.is_open for s in data.samples] == [True, None, False, False]
    assert [s.kinds for s in data.samples] == [(), (), ("closed door",), ()]
    assert [s.place for s in data.samples] == ["a.jpg", "b.jpg", "c.jpg", "hall"]
    assert [(o.left_px, o.right_px, o.clear, o.second) for o in a.openings] == [
        (10.5, 20, True, False),
        (40, 63.5, None, True),
    ]
    # no camera is known: 60.9 deg across the longer side
    assert datasets.load_frame(b).camera.fy == pytest.approx(45 / math.tan(math.radians(30.45)))
    assert truth_of(c).openings == ()
    assert truth_of(d).place == "hall"


def test_a_camera_beside_the_pictures_is_theirs(tmp_path):
    write_picture(tmp_path / "small.jpg", 64, 48)
    write_picture(tmp_path / "tall.jpg", 48, 64)
    (tmp_path / "doorways.csv").write_text(
        HEADER + "\nsmall.jpg,1,10,20,1,3,0\ntall.jpg,0,,,,3,0\n"
    )
    write_camera_info(Camera("lens", 640, 480, 500, 505, 300, 250), tmp_path / "camera.yaml")
    small, tall = read_dataset(tmp_path).samples
    camera = datasets.load_frame(small).camera
    assert (camera.name, camera.fx, camera.cx) == ("lens", 50, pytest.approx(29.55))
    with pytest.raises(UserError, match="another aspect"):
        datasets.load_frame(tall)
    (tmp_path / "camera.yaml").write_text("lens: 50 mm\n")
    with pytest.raises(UserError, match="image_width is missing"):
        read_dataset(tmp_path)


def test_views_tell_how_a_photograph_was_tilted(tmp_path):
    write_picture(tmp_path / "a.jpg", 64, 48)
    write_picture(tmp_path / "b.jpg", 64, 48)
    (tmp_path / "doorways.csv").write_text(HEADER + "\na.jpg,1,10,20,1,3,0\nb.jpg,0,,,,3,0\n")
    (tmp_path / "views.csv").write_text("image,place,pitch_deg,yaw_deg\na.jpg,hall,-6.5,90\n")
    a, b = read_dataset(tmp_path).samples
    assert (a.pose.pitch_deg, b.pose.pitch_deg) == (-6.5, 0.0)
    assert a.pose.height_m is None and a.pose.yaw_deg == 0.0
    (tmp_path / "views.csv").write_text("image,pitch_deg\na.jpg,steep\n")
    with pytest.raises(UserError, match=r"views\.csv"):
        read_dataset(tmp_path)


def test_boxes_are_stretched_back_to_portraits(tmp_path):
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        write_picture(tmp_path / "images" / name, 416, 416)
    (tmp_path / "boxes.csv").write_text(
        "image,state,left,top,right,bottom\n"
        "a.jpg,open,0.5,0.1,1.0,0.9\nb.jpg,closed,0.1,0.1,0.4,0.9\nc.jpg,semi,0.2,0,0.8,1\n"
        "a.jpg,closed,0.0,0.1,0.2,0.9\n"
    )
    data = read_dataset(tmp_path)
    a, b, c = data.samples
    assert [s.is_open for s in data.samples] == [True, False, None]
    assert datasets.load_frame(a).image.shape == (640, 480, 3)
    assert datasets.load_frame(a).camera.hfov_deg == pytest.approx(64)
    # quarter of the width right of the middle: atan(tan(32 deg) / 2)
    expected = -math.degrees(math.atan(math.tan(math.radians(32)) / 2))
    assert truth_of(a).openings[0].bearing_deg == pytest.approx(expected)
    assert len(a.openings) == 1  # the closed door beside it is no opening
    assert (b.openings, b.kinds) == ((), ("closed door",))
    assert len(c.openings) == 1
    with pytest.raises(UserError, match="--places"):
        datasets.held_out(data, 0, 2)


@pytest.mark.parametrize(
    "row", ["a.jpg,ajar,0,0,1,1", "a.jpg,open,0.8,0,0.2,1", "a.jpg,open,,0,1,1"]
)
def test_damaged_boxes_are_refused(tmp_path, row):
    write_picture(tmp_path / "images" / "a.jpg", 416, 416)
    (tmp_path / "boxes.csv").write_text("image,state,left,top,right,bottom\n" + row + "\n")
    with pytest.raises(UserError, match=r"boxes\.csv line 2: expected"):
        read_dataset(tmp_path)


def test_folders_per_class(tmp_path):
    write_picture(tmp_path / "Open-Doors" / "a.png", 8, 6)
    write_picture(tmp_path / "closed_door" / "b.png", 8, 6)
    write_picture(tmp_path / "no-door" / "b.png", 8, 6)
    write_picture(tmp_path / "half-open" / "c.png", 8, 6)
    (tmp_path / "no-door" / "notes.txt").write_text("no image")
    data = read_dataset(tmp_path)
    assert {s.name: s.is_open for s in data.samples} == {
        "Open-Doors/a.png": True,
        "closed_door/b.png": False,
        "no-door/b.png": False,
        "half-open/c.png": None,
    }
    assert {s.kinds for s in data.samples if s.is_open is False} == {
        ("closed-door",),
        ("no-door",),
    }
    write_picture(tmp_path / "kitchens" / "d.png", 8, 6)
    with pytest.raises(UserError, match="got kitchens/"):
        read_dataset(tmp_path)


def test_a_folder_of_nothing_known_is_refused(tmp_path):
    with pytest.raises(UserError, match="neither"):
        read_dataset(tmp_path)
    with pytest.raises(UserError, match="expected a folder"):
        read_dataset(tmp_path / "missing")


def test_folds_hold_out_each_place_once(nyu):
    data = read_dataset(nyu)
    folds = [datasets.held_out(data, k, 2) for k in range(2)]
    names = [[s.name for s in fold.samples] for fold in folds]
    assert names == [["0002.jpg", "0003.jpg"], ["0045.jpg"]]
    with pytest.raises(UserError, match="2 to 2 folds for 2 places, got 5"):
        datasets.held_out(data, 0, 5)


@pytest.mark.parametrize("text", ["5", "0/5", "6/5", "a/b", "1/", "-1/5"])
def test_a_wrong_split_is_refused(text):
    with pytest.raises(UserError, match=r"K/N"):
        datasets.parse_split(text)


def test_a_split_counts_from_one():
    assert datasets.parse_split("1/5") == (0, 5)


def test_places_from_a_file_win(nyu, tmp_path):
    table = tmp_path / "places.csv"
    table.write_text("image,place\n0002.jpg,a\n0003.jpg,b\n0045.jpg,b\n")
    data = read_dataset(nyu, places=readers.read_places(table))
    assert [s.place for s in data.samples] == ["a", "b", "b"]
    table.write_text("image,place\n0002.jpg,a\n")
    with pytest.raises(UserError, match=r"no place for 0003\.jpg"):
        read_dataset(nyu, places=readers.read_places(table))


def test_only_named_pictures(nyu):
    data = read_dataset(nyu)
    assert len(datasets.only_named(data, ["0003.jpg"]).samples) == 1
    with pytest.raises(UserError, match=r"first '7\.jpg'"):
        datasets.only_named(data, ["7.jpg"])


def test_mirroring_picture_and_marks_mirrors_the_truth(nyu):
    sample = read_dataset(nyu).samples[0]
    frame = datasets.load_frame(sample)
    depth = datasets.load_depth(sample)
    width = frame.camera.width
    marks = tuple(
        replace(m, left_px=width - 1 - m.right_px, right_px=width - 1 - m.left_px)
        for m in sample.openings
    )
    mirrored = truth.picture_truth(
        replace(sample, openings=marks),
        replace(frame, camera=frame.camera.mirrored()),
        depth[:, ::-1],
    )
    for plain, flipped in zip(truth_of(sample).openings, mirrored.openings, strict=True):
        assert flipped.bearing_deg == pytest.approx(-plain.bearing_deg)
        assert flipped.left_deg == pytest.approx(-plain.right_deg)
        assert flipped.range_m == pytest.approx(plain.range_m)
