"""Training samples from marked pictures of every layout."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import load_frame
from doorway3ds.lab.evaluate.overview import source_of
from doorway3ds.lab.train.doornet.data.samples import (
    UNKNOWN,
    cluster_places,
    from_frame,
    read_samples,
)
from tests.factories import classes, write_site


def test_nyu_is_cut_scaled_and_labelled(nyu: Path) -> None:
    two, three, other = read_samples(nyu)
    assert [s.place for s in (two, three, other)] == ["nyu-000", "nyu-000", "nyu-001"]
    assert two.image.shape == (261, 352, 3) and two.depth_m is not None
    # 255 says "10 m or more": a bound, not a distance
    assert np.isnan(two.depth_m[130, 190])
    assert two.depth_m[130, 20] == pytest.approx(51 * 9.9955 / 255)
    assert two.segments is not None
    assert (two.segments[0, 0], two.segments[0, -1]) == (3, 1)  # a leaf, a wall
    assert two.camera[0] == pytest.approx(518.86 * 352 / 620)
    assert two.open == 1 and len(two.spans) == 2 and three.open == 1 and other.spans == ()


def test_rendered_depth_ends_at_ten_metres_and_what_is_glimpsed_counts_nothing(
    rendered: Path,
) -> None:
    depth = cv2.imread(str(rendered / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
    depth[0, 0], depth[0, 1] = 0, 10_000
    cv2.imwrite(str(rendered / "depth" / "000000.png"), depth)
    table = rendered / "doorways.csv"
    table.write_text(table.read_text().replace("000001.png,0,,,,3", "000001.png,0,,,,1"))
    first, second, *_ = read_samples(rendered)
    assert first.depth_m is not None and np.isnan(first.depth_m[0, :2]).all()
    assert first.depth_m[0, 2] == 2.0
    assert first.segments is not None and first.segments[0, 0] == UNKNOWN
    assert first.segments[-1, 0] == 2 and first.extra["floor"][-1, 0]
    assert (first.weight, second.weight) == (1.0, 0.0)
    assert (first.place, first.source, first.draws) == ("home-0", "rendered", 1.0)


def test_any_layout_is_told_by_its_files(rendered: Path, nyu: Path, tmp_path: Path) -> None:
    site = write_site(tmp_path / "site", marked=False, rooms=2, each=2)
    sorted_ = classes(tmp_path / "sorted", 2)
    told = ((rendered, "rendered"), (nyu, "nyu"), (site, "site"), (sorted_, "sorted"))
    for folder, source in told:
        samples = read_samples(folder)
        assert {s.source for s in samples} == {source}
        assert source_of(read_dataset(folder)) == source
        assert {s.open for s in samples} == {0, 1}


def test_photographs_marked_by_hand_are_samples_without_depth(marked: Path) -> None:
    samples = read_samples(marked)
    assert [s.open for s in samples] == [1, 0, None, 1, 0, None, 1, 0]
    assert [s.weight for s in samples[:3]] == [1.0, 0.8, 0.4]
    assert [s.place for s in samples[:3]] == ["site-room0", "site-room0", "site-room1"]
    assert all(s.depth_m is None and s.segments is None for s in samples)
    assert {s.source for s in samples} == {"site"}
    # taken from within the doorway, which covers most of the picture
    text = (marked / "doorways.csv").read_text().replace("79.5,119.5", "9.5,119.5")
    (marked / "doorways.csv").write_text(text)
    assert [s.weight for s in read_samples(marked)[:3]] == pytest.approx([0.3, 0.8, 0.12])
    whole = samples[0]
    stored = read_dataset(marked).samples[3]
    halved = from_frame(stored, load_frame(stored), "site", longer=200)
    assert (whole.image.shape, halved.image.shape) == ((120, 160, 3), (150, 200, 3))
    assert (whole.spans[0].left, whole.spans[0].right) == (79.5, 119.5)
    assert (halved.spans[0].left, halved.spans[0].right) == (99.5, 149.5)
    # the camera file is for 640x480: a quarter of it, by pixel centres
    assert whole.camera == pytest.approx((150, 152.5, 320.5 / 4 - 0.5, 240.5 / 4 - 0.5))


def test_places_are_those_told_and_those_that_look_alike(marked: Path) -> None:
    rng = np.random.default_rng(1)
    lines = ["image,open,left_px,right_px,place"]
    for index in range(8):
        image = cv2.resize(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8), (160, 120))
        if index == 0:
            first = image
        if index == 7:  # the first again, mirrored and larger
            image = cv2.resize(np.ascontiguousarray(first[:, ::-1]), (320, 240))
        name = f"room{index // 2}/{index}.png"
        cv2.imwrite(str(marked / name), image)
        lines.append(f"{name},1,10,90,{'attic' if index in (2, 5) else ''}")
    (marked / "doorways.csv").write_text("\n".join(lines) + "\n")
    (marked / "camera.yaml").unlink()
    places = [s.place for s in read_samples(marked)]
    assert places[0] == places[7]
    assert places[2] == places[5]
    assert len(set(places)) == 6


def test_places_are_found_by_likeness() -> None:
    rng = np.random.default_rng(0)
    centres = rng.normal(0, 1, (5, 64))
    one = centres[np.arange(20) % 5] + rng.normal(0, 0.1, (20, 64))
    mirrored = rng.normal(0, 1, (20, 64))
    mirrored[0] = one[3]  # picture 0 is the mirror image of picture 3's place
    places = cluster_places(np.stack([one, mirrored], axis=1).astype(np.float32), 0.8)
    assert places[0] == places[3]
    assert len(set(places)) == 4


def test_close_ups_of_closed_doors_count_as_told(tmp_path: Path) -> None:
    rows = ["image,state,left,top,right,bottom"]
    (tmp_path / "images").mkdir()
    for number, state in enumerate(("closed", "open", "semi", "closed")):
        cv2.imwrite(
            str(tmp_path / "images" / f"{number}.png"), np.full((104, 104, 3), 90, np.uint8)
        )
        rows.append(f"{number}.png,{state},0.2,0.1,0.8,0.9")
    rows.append("3.png,open,0.8,0.1,0.9,0.9")
    (tmp_path / "boxes.csv").write_text("\n".join(rows) + "\n")
    samples = read_samples(tmp_path, closed_weight=1.7)
    assert [sample.open for sample in samples] == [0, 1, None, 1]
    assert [sample.weight for sample in samples] == [1.7, 1.0, 1.0, 1.0]
