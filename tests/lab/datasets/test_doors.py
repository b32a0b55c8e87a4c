from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.doors import read_door_pictures
from doorway3ds.lab.datasets.places import Choice
from doorway3ds.lab.train.paper.srinrun import wanted_rows
from tests.factories import classes, room, save


def test_two_folders(tmp_path: Path) -> None:
    found = read_door_pictures(classes(tmp_path, 3))
    assert found.labels.count("open-door") == found.labels.count("no-door") == 3
    assert found.grouping.startswith("near-duplicates")


def test_corrupt_doubled_and_contradicting_files_are_left_out_and_named(tmp_path: Path) -> None:
    classes(tmp_path, 4)
    (tmp_path / "open-door" / "bad.jpg").write_bytes(b"\xff\xd8\xff nothing more")
    shutil.copy(tmp_path / "open-door" / "00.png", tmp_path / "open-door" / "twin.png")
    shutil.copy(tmp_path / "open-door" / "01.png", tmp_path / "no-door" / "same.png")
    found = read_door_pictures(tmp_path)
    assert found.left_out["open-door/twin.png"] == "the same file as open-door/00.png"
    assert "in another class" in found.left_out["open-door/01.png"]
    assert "in another class" in found.left_out["no-door/same.png"]
    assert "bad.jpg" in found.left_out["open-door/bad.jpg"]
    assert len(found.samples) == 7


def test_an_empty_class_is_refused(tmp_path: Path) -> None:
    classes(tmp_path, 2)
    for file in (tmp_path / "open-door").iterdir():
        file.write_bytes(b"no image")
    with pytest.raises(UserError, match=r"no readable image of class open-door.*left out"):
        read_door_pictures(tmp_path)
    shutil.rmtree(tmp_path / "open-door")
    with pytest.raises(UserError, match="no readable image of class open-door"):
        read_door_pictures(tmp_path)


def test_one_picture_only(tmp_path: Path) -> None:
    one = save(tmp_path / "open-door" / "a.png", room(np.random.default_rng(0), is_open=True))
    with pytest.raises(UserError, match="no readable image of class no-door"):
        read_door_pictures(tmp_path)
    save(tmp_path / "no-door" / "a.png", room(np.random.default_rng(1), is_open=False))
    with pytest.raises(UserError, match="expected at least 2"):
        read_door_pictures(tmp_path).split(0.2, 0)
    assert one.is_file()


def test_three_doorway_classes_and_half_open_ones(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    for name in ("Closed_Door", "Open-Door", "semi-open", "no-door"):
        for index in range(2):
            save(tmp_path / name / f"{index}.png", room(rng, is_open=False))
    assert sorted(read_door_pictures(tmp_path).labels) == ["no-door"] * 4 + ["open-door"] * 2
    left = read_door_pictures(tmp_path).left_out
    assert set(left.values()) == {"half open"} and len(left) == 2
    kept = read_door_pictures(tmp_path, Choice(half_open="open"))
    assert kept.labels.count("open-door") == 4


def test_a_csv_with_places(tmp_path: Path) -> None:
    classes(tmp_path, 3)
    rows = ["image,class,place"]
    for index in range(3):
        rows += [
            f"no-door/{index:02d}.png,no-door,p{index}",
            f"open-door/{index:02d}.png,1,p{index}",
        ]
    table = tmp_path / "list.csv"
    table.write_text("\n".join(rows))
    found = read_door_pictures(table)
    assert found.groups == ("p0", "p0", "p1", "p1", "p2", "p2")
    split = found.split(0.34, 0)
    assert len(split.held) == 2
    table.write_text("image,class\nno-door/00.png,ajar?")
    with pytest.raises(UserError, match=r"list\.csv line 2: expected a class"):
        read_door_pictures(table)
    table.write_text("picture,class\n")
    with pytest.raises(UserError, match="needs the columns image and class"):
        read_door_pictures(table)


def test_limit_is_per_class_and_follows_the_seed(tmp_path: Path) -> None:
    classes(tmp_path, 5)
    names = [
        [s.name for s in read_door_pictures(tmp_path, Choice(limit=2, seed=seed)).samples]
        for seed in (0, 0, 1)
    ]
    assert names[0] == names[1] != names[2]
    assert len(names[0]) == 4


def test_neither_copies_nor_near_duplicates_cross_the_split(tmp_path: Path) -> None:
    """Every picture is there four times, mirrored and lit otherwise; groups hold them together."""
    rng = np.random.default_rng(4)
    for index in range(8):
        is_open = index % 2 == 0
        plain = room(rng, is_open=is_open)
        views = (plain, plain[:, ::-1], np.clip(plain * 1.05, 0, 255).astype(np.uint8), plain[:, :])
        for number, view in enumerate(views):
            name = "open-door" if is_open else "no-door"
            save(tmp_path / name / f"{index}-{number}.png", view)
    found = read_door_pictures(tmp_path)
    split = found.split(0.25, 0)
    assert split.leaks == ()
    scenes = [
        {found.samples[i].name.split("-door/")[1][0] for i in side}
        for side in (split.train, split.held)
    ]
    assert scenes[0].isdisjoint(scenes[1])

    rows = wanted_rows(found, split.train, copies=3)
    held = {found.samples[i].name for i in split.held}
    assert len(rows) == 4 * len(split.train)
    assert held.isdisjoint(w.sample.name for w in rows)

    careless = read_door_pictures(tmp_path, Choice(pattern=r"(\d-\d)"))
    assert len(careless.split(0.25, 0).leaks) > 0
