"""Images of doorways in classes: read, checked, grouped and split for training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.files import digest
from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.csvfile import csv_columns, csv_rows
from doorway3ds.lab.datasets.places import ALL, Choice, Pictures, Seen, unseen
from doorway3ds.lab.datasets.readers import CLASS_FOLDERS, read_dataset
from doorway3ds.lab.datasets.samples import Sample, load_frame

NO_DOOR, OPEN_DOOR = "no-door", "open-door"
_CLASS_COLUMNS = ("class", "label", "state", "open")
_GROUP_COLUMNS = ("group", "place")


@dataclass(frozen=True)
class DoorPictures(Pictures):
    """Images of two classes. digests: SHA-256 of each file."""

    digests: tuple[str, ...]

    @property
    def labels(self) -> list[str]:
        return [OPEN_DOOR if s.is_open else NO_DOOR for s in self.samples]


def read_door_pictures(
    path: Path,
    choice: Choice = ALL,
    *,
    layout: str | None = None,
    places: Mapping[str, str] | None = None,
    seen: Seen = unseen,
) -> DoorPictures:
    """The images of a folder (a folder per class, or any layout of `3ds eval`) or CSV file.

    A CSV has columns image and class (also label, state or open), and may have group or place.
    Unreadable and doubled files are left out.

    Raises UserError where a class is empty.
    """
    if path.suffix.lower() == ".csv" and path.is_file():
        samples, known = _read_csv(path)
        if places is not None:
            samples, known = [replace(s, place=places.get(s.name, s.place)) for s in samples], True
    else:
        data = read_dataset(path, layout, places)
        samples, known = list(data.samples), data.places_known
    return check_pictures(samples, path, choice, places_known=known, seen=seen)


def check_pictures(
    samples: Sequence[Sample],
    path: Path,
    choice: Choice,
    *,
    places_known: bool,
    seen: Seen = unseen,
) -> DoorPictures:
    """The same of samples at hand; path: what messages call their data set."""
    if choice.half_open != "leave-out":
        called = choice.half_open == "open"
        samples = [replace(s, is_open=called) if s.is_open is None else s for s in samples]
    left_out = {s.name: "half open" for s in samples if s.is_open is None}
    drawn = {
        sample.name
        for is_open in (False, True)
        for sample in choice.draw([s for s in samples if s.is_open is is_open])
    }
    wanted = [s for s in samples if s.name in drawn]
    _require_classes(wanted, path)
    read, unreadable = groups.read_each(wanted, _read, seen)
    found, doubled = _once_each(read)
    _require_classes([sample for sample, _ in found], path, unreadable | doubled)
    kept = groups.group(
        [sample for sample, _ in found], [code for _, (_, code) in found], places_known, choice
    )
    digests = tuple(content for _, (content, _) in found)
    return DoorPictures(*kept, left_out | unreadable | doubled, digests)


_Read = tuple[str, NDArray[np.bool_]]  # a file's digest, and its perceptual hash


def _read(sample: Sample) -> _Read:
    image = load_frame(sample).image
    return digest(sample.image_path), groups.perceptual_hash(image)


def _once_each(
    read: Sequence[tuple[Sample, _Read]],
) -> tuple[list[tuple[Sample, _Read]], dict[str, str]]:
    """The first of files that are the same, none of them in two classes; why not the others."""
    first: dict[str, Sample] = {}
    left_out: dict[str, str] = {}
    for sample, (content, _) in read:
        twin = first.setdefault(content, sample)
        if twin is sample:
            continue
        left_out[sample.name] = f"the same file as {twin.name}"
        if twin.is_open != sample.is_open:
            left_out[sample.name] += ", in another class"
            left_out[twin.name] = f"the same file as {sample.name}, in another class"
    return [(sample, what) for sample, what in read if sample.name not in left_out], left_out


def _require_classes(
    samples: Sequence[Sample], path: Path, left_out: Mapping[str, str] | None = None
) -> None:
    for wanted, name in ((False, NO_DOOR), (True, OPEN_DOOR)):
        if not any(s.is_open is wanted for s in samples):
            why = f"; {len(left_out)} were left out, such as " if left_out else ""
            if left_out:
                why += "{}: {}".format(*next(iter(left_out.items())))
            raise UserError(
                f"{path} has no readable image of class {name}; two classes are needed{why}"
            )


def _read_csv(path: Path) -> tuple[list[Sample], bool]:
    columns = csv_columns(path)
    label = next((c for c in _CLASS_COLUMNS if c in columns), None)
    group = next((c for c in _GROUP_COLUMNS if c in columns), None)
    if "image" not in columns or label is None:
        raise UserError(
            f"{path} needs the columns image and class; it has {', '.join(columns) or 'none'}"
        )
    samples = []
    for where, row in csv_rows(path, ("image", label)):
        name, value = row["image"], row[label].lower()
        key = {"1": "open", "0": "no-door"}.get(value, value.replace("_", "-").replace(" ", "-"))
        if key not in CLASS_FOLDERS:
            raise UserError(
                f"{where}: expected a class such as {OPEN_DOOR} or {NO_DOOR}, got {value!r}"
            )
        files = (path.parent / name, path.parent / "images" / name)
        samples.append(
            Sample(
                name=name,
                place=(row[group] if group else "") or name,
                image_path=next((file for file in files if file.is_file()), files[0]),
                is_open=CLASS_FOLDERS[key],
                kinds=(key,) if CLASS_FOLDERS[key] is False else (),
            )
        )
    return samples, group is not None
