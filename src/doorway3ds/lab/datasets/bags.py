"""Marked images of a bag, with the calibration and pose that the bag holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote, urlsplit

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.images.codec import write_image
from doorway3ds.lab.datasets.csvfile import csv_rows
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import Dataset
from doorway3ds.sources.uri import open_source


def read_bag(
    uri: str, marks: Path | None, folder: Path, places: Mapping[str, str] | None = None
) -> Dataset:
    """The images of a bag:// URI that are marked, written to `folder` as PNG.

    marks: a doorways.csv that names images as `3ds live URI --log DIR` does: 0001.png is the first.
    Default: doorways.csv beside the bag. places: as in `read_dataset`.

    Raises UserError if the bag or the marks cannot be read, or if a marked image is not in the bag.
    """
    parts = urlsplit(uri)
    bag = Path(unquote(parts.netloc + parts.path))
    marks = marks or bag.parent / "doorways.csv"
    wanted = {row["image"] for _, row in csv_rows(marks, ["image"])}
    seen: dict[str, tuple[Camera | None, Pose]] = {}
    number = 0
    with open_source(uri) as source:
        for number, frame in enumerate(source, 1):
            name = f"{number:04d}.png"
            if name in wanted:
                write_image(folder / name, frame.image)
                seen[name] = (None if frame.camera.assumed else frame.camera, frame.pose)
    if missing := sorted(wanted - seen.keys()):
        raise UserError(
            f"{marks} marks {missing[0]}; expected images of {bag}, 0001.png to {number:04d}.png"
        )
    write_bytes(folder / "doorways.csv", marks.read_bytes())
    found = read_dataset(folder, "plain", places)
    samples = tuple(
        replace(one, camera=seen[one.name][0], pose=seen[one.name][1]) for one in found.samples
    )
    return Dataset(bag, "bag", samples, found.places_known)
