"""The marks in marks/, and the data sets that marks/build.py makes of them."""

from __future__ import annotations

import csv
import importlib.util
import itertools
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doorway3ds.images.codec import read_image, write_image
from doorway3ds.lab.datasets.readers import read_dataset

MARKS = Path(__file__).resolve().parents[1] / "marks"
spec = importlib.util.spec_from_file_location("marks_build", MARKS / "build.py")
marks_build = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(marks_build)

PHOTOGRAPHS = "repository,path,open,left,right,clear,confidence,aside"
VIEWS = "repository,scene,hfov_deg,yaw_deg,open,left,right,clear,confidence,aside"
SIDE = 512
COLOURS = {"f": (200, 40, 40), "r": (40, 200, 40), "b": (40, 40, 200), "l": (200, 200, 40)}
LINE_DEG = 105  # azimuth of a white line, on the right face


def rows(table: str) -> list[dict[str, str]]:
    with (MARKS / table).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(
    ("table", "columns", "image"),
    [("photographs.csv", PHOTOGRAPHS, 2), ("views.csv", VIEWS, 4)],
)
def test_every_committed_line_is_sane(table: str, columns: str, image: int) -> None:
    commits = {row["repository"]: row["commit"] for row in rows("sources.csv")}
    assert all(re.fullmatch(r"[0-9a-f]{40}", commit) for commit in commits.values())
    found = rows(table)
    assert list(found[0]) == columns.split(",")
    for row in found:
        assert None not in row.values(), row
        assert row["repository"] in commits
        assert row["open"] in ("0", "1"), row
        assert row["clear"] in (("", "0", "1") if row["open"] == "1" else ("",)), row
        assert row["confidence"] in ("1", "2", "3"), row
        assert row["aside"] in ("0", "1"), row
        if row["open"] == "1":
            assert 0 <= float(row["left"]) < float(row["right"]) <= 1, row
        else:
            assert row["left"] == row["right"] == "", row
    images = [list(group) for _, group in itertools.groupby(found, lambda r: [*r.values()][:image])]
    keys = [tuple(group[0].values())[:image] for group in images]
    assert len(set(keys)) == len(keys)
    assert [key[:2] for key in keys] == sorted(key[:2] for key in keys)
    for group in images:
        assert len({row["aside"] for row in group}) == 1, group
        assert len(group) == 1 or all(row["open"] == "1" for row in group), group


def test_views_of_one_repository_are_all_aside_or_none() -> None:
    aside = {(row["repository"], row["aside"]) for row in rows("views.csv")}
    assert len(aside) == len({repository for repository, _ in aside})


def git(folder: Path, *arguments: str) -> str:
    call = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org", *arguments]
    ran = subprocess.run(call, cwd=folder, check=True, capture_output=True, text=True)
    return ran.stdout.strip()


def commit(folder: Path) -> str:
    git(folder, "init", "-q")
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "-m", "images")
    return git(folder, "rev-parse", "HEAD")


def paint_faces(scene: Path, level: int) -> None:
    """A cube's faces, each of one colour, as `level` times `level` tiles; a line on the right."""
    for name, colour in COLOURS.items():
        face = np.full((SIDE, SIDE, 3), colour, np.uint8)
        if name == "r":
            middle = (math.tan(math.radians(LINE_DEG - 90)) + 1) / 2 * SIDE - 0.5
            face[:, round(middle) - 2 : round(middle) + 3] = 255
        for row, band in enumerate(np.split(face, level)):
            for column, tile in enumerate(np.split(band, level, axis=1)):
                write_image(scene / f"{level}/{name}/{row}/{column}.jpg", tile.copy(), quality=98)


class Site:
    """Two clones, one of them bare, and marks of their images."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.clones, self.out = folder, folder / "clones", folder / "out"
        work, tour = folder / "work", self.clones / "owner" / "tour"
        ramp = np.repeat(np.linspace(0, 255, 256).astype(np.uint8)[None, :, None], 256, axis=0)
        write_image(work / "hall/a b.jpg", np.repeat(ramp, 3, axis=2))
        write_image(work / "hall/c.jpg", np.repeat(ramp, 3, axis=2)[:, ::-1].copy())
        paint_faces(tour / "tiles/0-hall", 2)
        paint_faces(tour / "tiles/1-closet", 1)
        commits = {"owner/rooms": commit(work), "owner/tour": commit(tour)}
        git(folder, "clone", "-q", "--bare", str(work), str(self.clones / "owner" / "rooms"))
        lines = [f"{repository},{sha}" for repository, sha in commits.items()]
        self.write("sources.csv", "repository,commit", *lines)
        self.write(
            "photographs.csv",
            PHOTOGRAPHS,
            "owner/rooms,hall/a b.jpg,1,0.250,0.500,1,3,0",
            "owner/rooms,hall/a b.jpg,1,0.000,0.125,,1,0",
            "owner/rooms,hall/c.jpg,0,,,,2,1",
        )
        self.write(
            "views.csv",
            VIEWS,
            "owner/tour,tiles/0-hall,60.00,90,1,0.700,1.000,0,2,0",
            "owner/tour,tiles/0-hall,60.00,315,0,,,,3,0",
            "owner/tour,tiles/1-closet,60.00,90,0,,,,3,0",
        )

    def write(self, table: str, *lines: str) -> None:
        path = self.folder / "marks" / table
        path.parent.mkdir(exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def build(self) -> int:
        return marks_build.main([str(self.clones), str(self.out)])

    def image(self, name: str) -> Any:
        return read_image(self.out / name).image.astype(float)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    monkeypatch.setattr(marks_build, "MARKED", tmp_path / "marks")
    return Site(tmp_path)


def test_photographs_are_stretched_and_keep_their_openings(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    assert site.build() == 0
    assert capsys.readouterr().out.splitlines() == [
        "photographs: 1 images, 2 openings",
        "photographs-aside: 1 images, 0 openings",
        "views: 3 images, 1 openings",
    ]
    shown = site.image("photographs/images/owner/rooms/hall/a b.jpg")
    assert shown.shape == (264, 352, 3)
    assert shown[132, [88, 264], 0] == pytest.approx([64, 191], abs=3)
    (sample,) = read_dataset(site.out / "photographs", "plain").samples
    assert (sample.name, sample.is_open, sample.confidence) == ("owner/rooms/hall/a b.jpg", True, 3)
    found = [(m.left_px, m.right_px, m.clear, m.second) for m in sample.openings]
    assert found == [(87.5, 175.5, True, False), (-0.5, 43.5, None, True)]
    (aside,) = read_dataset(site.out / "photographs-aside", "plain").samples
    assert (aside.is_open, aside.confidence, aside.openings) == (False, 2, ())


def test_a_view_shows_its_direction_to_the_pixel(site: Site) -> None:
    assert site.build() == 0
    focal = 240 / math.tan(math.radians(30))
    column = 239.5 + focal * math.tan(math.radians(LINE_DEG - 90))
    for scene in ("0-hall", "1-closet"):
        right = site.image(f"views/images/owner/tour/tiles/{scene}-090.jpg")
        assert right.shape == (360, 480, 3)
        assert right[[5, 180, 355], 240] == pytest.approx(np.tile(COLOURS["r"], (3, 1)), abs=4)
        bright = right[..., 0] - COLOURS["r"][0]
        bright[bright < 40] = 0
        for line in (bright[20], bright[180], bright[340]):
            assert np.average(np.arange(480), weights=line) == pytest.approx(column, abs=1)
    seam = site.image("views/images/owner/tour/tiles/0-hall-315.jpg")
    assert seam[180, [0, 230]] == pytest.approx(np.tile(COLOURS["l"], (2, 1)), abs=4)
    assert seam[180, [249, 479]] == pytest.approx(np.tile(COLOURS["f"], (2, 1)), abs=4)
    samples = read_dataset(site.out / "views", "plain").samples
    assert {sample.place for sample in samples} == {"owner/tour"}
    assert [(m.left_px, m.right_px, m.clear) for s in samples for m in s.openings] == [
        (335.5, 479.5, False)
    ]


def lacks_a_clone(site: Site) -> str:
    (site.clones / "owner" / "rooms").rename(site.clones / "elsewhere")
    return "expected a clone of https://github.com/owner/rooms"


def lacks_the_commit(site: Site) -> str:
    site.write("sources.csv", "repository,commit", f"owner/tour,{'0' * 40}")
    return f"does not hold commit {'0' * 40}"


def lacks_a_file(site: Site) -> str:
    site.write("views.csv", VIEWS, "owner/tour,tiles/none,60.00,0,0,,,,3,0")
    return "lacks the file tiles/none/1/f/0/0.jpg"


def is_there_already(site: Site) -> str:
    site.out.mkdir()
    return f"{site.out} exists; expected a new folder"


@pytest.mark.parametrize("fault", [lacks_a_clone, lacks_the_commit, lacks_a_file, is_there_already])
def test_what_is_missing_is_one_line_and_leaves_nothing(
    fault: Any, site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    said = fault(site)
    before = sorted(site.folder.iterdir())
    assert site.build() == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert sorted(site.folder.iterdir()) == before
