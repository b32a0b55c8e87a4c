"""Data sets for `3ds train doornet`, made of the marks in this folder and clones of their images.

    python marks/build.py CLONES OUT

CLONES/OWNER/NAME is a clone, bare or not, of each repository in sources.csv. OUT, a new folder,
receives photographs, views, photographs-aside and views-aside, each with images/ and doorways.csv.
"""

from __future__ import annotations

import argparse
import csv
import io
import itertools
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.files import read_text, whole, write_bytes
from doorway3ds.images.codec import read_image, write_image
from doorway3ds.lab.datasets.csvfile import MARKS, csv_bytes
from doorway3ds.networks.adapter import resized

MARKED = Path(__file__).resolve().parent
PHOTOGRAPH = (352, 264)  # collections squeeze theirs to squares, which are stretched to 4:3 again
VIEW = (480, 360)
FACES = "frbl"  # front, right, back, left

Image = NDArray[np.uint8]
Row = dict[str, str]


@dataclass(frozen=True)
class Clone:
    """A repository's files at one commit. Raises UserError if the clone does not hold it."""

    repository: str
    commit: str
    folder: Path

    def __post_init__(self) -> None:
        asked = _git(self.folder, "cat-file", "-e", f"{self.commit}^{{commit}}")
        if asked.returncode:
            why = asked.stderr.decode(errors="replace").strip().partition("\n")[0]
            raise UserError(
                f"{self.folder} does not hold commit {self.commit}; expected a clone of "
                f"https://github.com/{self.repository} ({why})"
            )

    def has_folder(self, path: str) -> bool:
        return bool(_git(self.folder, "ls-tree", self.commit, f"{path}/").stdout)

    def images(self, paths: Sequence[str]) -> list[Image]:
        """The images at these paths. Raises UserError if one is missing or cannot be read."""
        asked = "".join(f"{self.commit}:{path}\n" for path in paths)
        answer = io.BytesIO(_git(self.folder, "cat-file", "--batch", given=asked).stdout)
        found = []
        for path in paths:
            head = answer.readline().split()
            if head[1:2] != [b"blob"]:
                raise UserError(f"{self.folder} lacks the file {path} of commit {self.commit}")
            data = answer.read(int(head[2]))
            answer.read(1)  # the end of the line
            found.append(read_image(data, name=f"{path} of {self.folder}").image)
        return found


def _git(folder: Path, *arguments: str, given: str = "") -> subprocess.CompletedProcess[bytes]:
    try:
        return subprocess.run(
            ["git", "-C", str(folder), *arguments], input=given.encode(), capture_output=True
        )
    except FileNotFoundError as error:
        raise UserError("there is no git; install it") from error


def photograph(clone: Clone, row: Row) -> Image:
    """A photograph as it was marked."""
    image = Pillow.fromarray(clone.images([row["path"]])[0])
    return np.asarray(image.resize(PHOTOGRAPH, Pillow.Resampling.LANCZOS))


def view(clone: Clone, row: Row) -> Image:
    """A view out of a scene as it was marked."""
    return cut_view(read_faces(clone, row["scene"]), float(row["hfov_deg"]), float(row["yaw_deg"]))


def read_faces(clone: Clone, scene: str) -> Image:
    """The front, right, back and left face of a scene's cube beside each other, (S, 4 S, 3).

    Of the tiles' level 2, two by two a face; small scenes have only level 1, one a face.
    """
    level = 2 if clone.has_folder(f"{scene}/2") else 1
    strips = [
        clone.images(
            [
                f"{scene}/{level}/{face}/{row}/{column}.jpg"
                for face in FACES
                for column in range(level)
            ]
        )
        for row in range(level)
    ]
    return np.vstack([np.hstack(strip) for strip in strips])


def cut_view(faces: Image, hfov_deg: float, yaw_deg: float) -> Image:
    """What a level camera that looks to `yaw_deg`, + to the right of the front, sees of a cube.

    Sampled at twice the size, then averaged.
    """
    side = faces.shape[0]
    camera = Camera.from_fov(2 * VIEW[0], 2 * VIEW[1], hfov_deg)
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height) - camera.cy) / camera.fy
    azimuth_deg = yaw_deg + np.degrees(np.arctan(x))
    face = np.floor((azimuth_deg + 45) / 90)
    beside = np.radians(azimuth_deg - 90 * face)  # of the middle of the face
    columns = (face % len(FACES) + (np.tan(beside) + 1) / 2) * side - 0.5
    rows = (y[:, None] / (np.hypot(x, 1) * np.cos(beside)) + 1) / 2 * side - 0.5
    around = np.pad(faces, ((0, 0), (1, 1), (0, 0)), mode="wrap")
    columns = np.broadcast_to(columns + 1, rows.shape)
    fine = cv2.remap(around, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR)
    return resized(np.asarray(fine, np.uint8), *VIEW)


def photograph_name(row: Row) -> str:
    return f"{row['repository']}/{row['path']}"


def view_name(row: Row) -> str:
    return f"{row['repository']}/{row['scene']}-{int(row['yaw_deg']):03d}.jpg"


def repository_of(row: Row) -> str:
    return row["repository"]


@dataclass(frozen=True)
class Kind:
    """One of the tables of marks: name and place of a row's image, and how it is made."""

    table: str
    name: Callable[[Row], str]
    place: Callable[[Row], str]
    make: Callable[[Clone, Row], Image]


KINDS = (
    Kind("photographs", photograph_name, photograph_name, photograph),
    Kind("views", view_name, repository_of, view),
)


def build(clones: Path, out: Path) -> Iterator[str]:
    """Writes the data sets, and says of each how much it holds. Raises UserError."""
    found = {
        row["repository"]: Clone(row["repository"], row["commit"], clones / row["repository"])
        for row in _rows("sources.csv")
    }
    for kind in KINDS:
        sets: dict[str, list[dict[str, Any]]] = {}
        for name, group in itertools.groupby(_rows(f"{kind.table}.csv"), kind.name):
            lines = list(group)
            first = lines[0]
            folder = kind.table + ("-aside" if first["aside"] == "1" else "")
            image = kind.make(found[first["repository"]], first)
            write_image(out / folder / "images" / name, image)
            common = {"image": name, "place": kind.place(first)}
            sets.setdefault(folder, []).extend(
                {**common, **_mark(line, image.shape[1]), "second": int(number > 0)}
                for number, line in enumerate(lines)
            )
        for folder, rows in sets.items():
            write_bytes(out / folder / "doorways.csv", csv_bytes((*MARKS, "place"), rows))
            images = {row["image"] for row in rows}
            shown = sum(row["open"] == "1" for row in rows)
            yield f"{folder}: {len(images)} images, {shown} openings"


def _mark(row: Row, width: int) -> dict[str, Any]:
    """A row in the columns of a marked folder, with pixels for fractions of the width."""
    mark = {column: row[column] for column in ("open", "clear", "confidence")}
    edges = {
        f"{side}_px": round(float(row[side]) * width - 0.5, 2)
        for side in ("left", "right")
        if row[side]
    }
    return {**mark, **edges}


def _rows(table: str) -> list[Row]:
    return list(csv.DictReader(io.StringIO(read_text(MARKED / table))))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("clones", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args(arguments)
    try:
        if given.out.exists():
            raise UserError(f"{given.out} exists; expected a new folder")
        with whole(given.out) as part:
            try:
                for line in build(given.clones, part):
                    print(line)
            except BaseException:
                shutil.rmtree(part, ignore_errors=True)
                raise
    except UserError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
