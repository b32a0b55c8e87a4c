"""`3ds sim` and the folders it writes."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.sim.pictures import dataset
from tests.conftest import Cli

pytestmark = pytest.mark.sim


def test_render_writes_what_training_reads_and_goes_on_after_a_cut(
    gl: Any, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset, "VIEWS", 2)
    out = tmp_path / "homes"
    call = ("sim", "render", "--out", out, "--count", 4, "--seed", 3, "--size", "128x96")
    done = cli(*call, "--workers", 1)
    assert done.status == 0, done.err
    names = sorted(p.name for p in (out / "images").iterdir())
    assert names == [f"{i:06d}.jpg" for i in range(4)]
    with (out / "doorways.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == dataset.COLUMNS
    assert {r["home"] for r in rows} == {"300000", "300001"}
    depth = cv2.imread(str(out / "depth" / "000001.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16 and depth.shape == (96, 128)
    floor = cv2.imread(str(out / "floor" / "000001.png"), cv2.IMREAD_UNCHANGED)
    assert set(np.unique(floor)) <= {0, 255}
    truth = [json.loads(line) for line in (out / "truth.jsonl").read_text().splitlines()]
    for row, said in zip((r for r in rows if r["second"] == "0"), truth, strict=True):
        assert row["image"] == said["image"]
        assert int(row["open"]) == bool(said["openings"])
        if row["open"] == "1":
            assert float(row["left_px"]) < float(row["right_px"])
            assert float(row["range_m"]) > 0
    assert (out / "contact.jpg").is_file()
    assert len(read_dataset(out).samples) == 4

    before = (out / "images" / "000000.jpg").read_bytes()
    (out / "homes" / "000002.json").unlink()
    (out / "images" / "000003.jpg").unlink()
    kept = (out / "homes" / "000000.json").stat().st_mtime_ns
    assert cli(*call, "--workers", 1).status == 0
    assert (out / "homes" / "000000.json").stat().st_mtime_ns == kept
    assert (out / "images" / "000003.jpg").is_file()
    assert (out / "images" / "000000.jpg").read_bytes() == before


def test_a_share_of_homes_with_hazards_and_of_low_views(gl: Any, cli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "homes"
    call = ("sim", "render", "--out", out, "--count", 10, "--seed", 3, "--size", "128x96")
    done = cli(*call, "--workers", 1, "--hazards", 1, "--low", 1)
    assert done.status == 0, done.err
    with (out / "doorways.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == dataset.COLUMNS
    assert all(0.3 <= float(r["height_m"]) <= 0.6 for r in rows)
    shown = {kind for s in read_dataset(out).samples for kind in s.kinds}
    assert shown & {
        "stairs down", "stairs up", "step", "closet without a leaf", "curtain in a doorway",
        "closed glass door", "mirror", "person", "pet",
    }  # fmt: skip


def test_one_picture_repeats_bit_for_bit(gl: Any, cli: Cli, tmp_path: Path) -> None:
    where = ("--home", 34, "--x", 1.63, "--y", 2.92, "--heading-deg", 321.3, "--size", "160x120")
    for name in ("a", "b"):
        assert cli("sim", "view", "--out", tmp_path / f"{name}.jpg", *where).status == 0
    for of_it in ("{}.jpg", "truth/{}.depth.png", "truth/{}.floor.png"):
        a, b = ((tmp_path / of_it.format(n)).read_bytes() for n in ("a", "b"))
        assert a == b


def test_a_place_outside_the_home_is_refused(cli: Cli) -> None:
    done = cli(
        "sim", "view", "--out", "a.jpg", "--home", 1, "--x", -5, "--y", 0, "--heading-deg", 0
    )
    assert done.status == 1
    assert "in no room of home 1" in done.err


@pytest.mark.parametrize("size", ["320", "320x", "9x9", "4000x3000"])
def test_a_wrong_size_is_refused(cli: Cli, size: str) -> None:
    done = cli("sim", "render", "--out", "x", "--size", size)
    assert done.status == 2
    assert "--size" in done.err
