"""Pictures of doorways in classes: read, checked, grouped and split for training."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.readers import CLASS_FOLDERS, read_dataset
from doorway3ds.lab.datasets.samples import Sample, load_frame

NO_DOOR, OPEN_DOOR = "no-door", "open-door"
HALF_OPEN = ("leave-out", "open", "not-open")
_CLASS_COLUMNS = ("class", "label", "state", "open")
_GROUP_COLUMNS = ("group", "place")


@dataclass(frozen=True)
class DoorPictures:
    """Readable pictures of two classes.

    groups: by picture; what shares one is never split. grouping: how they were found.
    pairs: pictures that show nearly the same. digests: SHA-256 of each file. left_out: why, by
    name.
    """

    samples: tuple[Sample, ...]
    groups: tuple[str, ...]
    grouping: str
    pairs: tuple[tuple[int, int], ...]
    digests: tuple[str, ...]
    left_out: Mapping[str, str]

    @property
    def labels(self) -> list[str]:
        return [OPEN_DOOR if s.is_open else NO_DOOR for s in self.samples]


@dataclass(frozen=True)
class Split:
    """Indices to learn from and held out; leaks: near-copies of which each side has one."""

    train: tuple[int, ...]
    held: tuple[int, ...]
    leaks: tuple[tuple[int, int], ...]


def read_door_pictures(
    path: Path,
    *,
    layout: str | None = None,
    places: Mapping[str, str] | None = None,
    grouping: str = "auto",
    pattern: str | None = None,
    half_open: str = "leave-out",
    limit: int | None = None,
    seed: int = 0,
    seen: Callable[[int, int], None] = lambda done, total: None,
) -> DoorPictures:
    """The pictures of a folder (a folder per class, or any layout of `3ds eval`) or CSV file.

    A CSV has columns image and class (also label, state or open), and may have group or place.
    grouping, pattern: as in `groups.name_groups`. limit: per class at most so many, drawn by
    seed. Unreadable and doubled files are left out.

    Raises UserError where a class is empty.
    """
    require_half_open(half_open)
    if path.suffix.lower() == ".csv" and path.is_file():
        samples, known = _read_csv(path)
        if places is not None:
            samples, known = [replace(s, place=places.get(s.name, s.place)) for s in samples], True
    else:
        data = read_dataset(path, layout, places)
        samples, known = list(data.samples), data.places_known
    return check_pictures(
        samples,
        path,
        places_known=known,
        grouping=grouping,
        pattern=pattern,
        half_open=half_open,
        limit=limit,
        seed=seed,
        seen=seen,
    )


def require_half_open(half_open: str) -> None:
    """CallError for what is none of HALF_OPEN."""
    if half_open not in HALF_OPEN:
        raise CallError(f"--half-open must be {', '.join(HALF_OPEN)}, got {half_open!r}")


def check_pictures(
    samples: Sequence[Sample],
    path: Path,
    *,
    places_known: bool,
    grouping: str = "auto",
    pattern: str | None = None,
    half_open: str = "leave-out",
    limit: int | None = None,
    seed: int = 0,
    seen: Callable[[int, int], None] = lambda done, total: None,
) -> DoorPictures:
    """The same of samples at hand; path: what messages call their data set."""
    if half_open != "leave-out":
        samples = [
            replace(s, is_open=half_open == "open") if s.is_open is None else s for s in samples
        ]
    half = {s.name: "half open" for s in samples if s.is_open is None}
    wanted = _limited([s for s in samples if s.is_open is not None], limit, seed)
    _require_classes(wanted, path)
    kept, hashes, digests, left_out = _checked(wanted, seen)
    _require_classes(kept, path, left_out)
    pairs = groups.near_pairs(hashes)
    found, how = groups.name_groups(
        kept, pairs, places_known=places_known, grouping=grouping, pattern=pattern
    )
    return DoorPictures(tuple(kept), found, how, tuple(pairs), tuple(digests), half | left_out)


def split_pictures(pictures: DoorPictures, share: float, seed: int) -> Split:
    """Whole groups held out, near `share` of each class."""
    train, held = groups.split(pictures.groups, pictures.labels, share, seed)
    return Split(tuple(train), tuple(held), tuple(groups.leaks(pictures.pairs, held)))


def _checked(
    samples: Sequence[Sample], seen: Callable[[int, int], None]
) -> tuple[list[Sample], NDArray[np.bool_], list[str], dict[str, str]]:
    """Readable samples once each, their hashes and digests, and why others are left out."""
    left_out: dict[str, str] = {}
    first: dict[str, Sample] = {}
    found: dict[str, tuple[Sample, NDArray[np.bool_], str]] = {}
    for number, sample in enumerate(samples):
        seen(number, len(samples))
        try:
            digest = hashlib.sha256(sample.image_path.read_bytes()).hexdigest()
            if digest in first:
                twin = first[digest]
                left_out[sample.name] = f"the same file as {twin.name}"
                if twin.is_open != sample.is_open:
                    left_out[sample.name] += ", in another class"
                    left_out[twin.name] = f"the same file as {sample.name}, in another class"
                    found.pop(twin.name, None)
                continue
            first[digest] = sample
            image = load_frame(sample).image
        except UserError as error:
            left_out[sample.name] = str(error)
            continue
        except OSError as error:
            left_out[sample.name] = f"cannot be read: {error.strerror}"
            continue
        found[sample.name] = (sample, groups.perceptual_hash(image), digest)
    kept = [sample for sample, _, _ in found.values()]
    hashes = np.array([code for _, code, _ in found.values()], bool).reshape(-1, 2, groups.BITS)
    return kept, hashes, [digest for _, _, digest in found.values()], left_out


def _require_classes(
    samples: Sequence[Sample], path: Path, left_out: Mapping[str, str] | None = None
) -> None:
    for wanted, name in ((False, NO_DOOR), (True, OPEN_DOOR)):
        if not any(s.is_open is wanted for s in samples):
            why = f"; {len(left_out)} were left out, such as " if left_out else ""
            if left_out:
                why += "{}: {}".format(*next(iter(left_out.items())))
            raise UserError(
                f"{path} has no readable picture of class {name}; two classes are needed{why}"
            )


def _limited(samples: list[Sample], limit: int | None, seed: int) -> list[Sample]:
    if limit is None:
        return samples
    rng = np.random.default_rng(seed)
    chosen: list[Sample] = []
    for is_open in (False, True):
        own = [s for s in samples if s.is_open is is_open]
        chosen += [own[i] for i in sorted(rng.permutation(len(own))[:limit])]
    return chosen


def _read_csv(path: Path) -> tuple[list[Sample], bool]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path} is no CSV file in UTF-8: {error}") from error
    columns = list(rows[0]) if rows else []
    label = next((c for c in _CLASS_COLUMNS if c in columns), None)
    group = next((c for c in _GROUP_COLUMNS if c in columns), None)
    if "image" not in columns or label is None:
        raise UserError(
            f"{path} needs the columns image and class; it has {', '.join(columns) or 'none'}"
        )
    samples = []
    for number, row in enumerate(rows, 2):
        name, value = (row["image"] or "").strip(), (row[label] or "").strip().lower()
        key = {"1": "open", "0": "no-door"}.get(value, value.replace("_", "-").replace(" ", "-"))
        if key not in CLASS_FOLDERS:
            raise UserError(
                f"{path} line {number}: expected a class such as {OPEN_DOOR} or {NO_DOOR}, "
                f"got {value!r}"
            )
        place = (row[group] or "").strip() if group else ""
        file_path = next(
            (p for p in (path.parent / name, path.parent / "images" / name) if p.is_file()),
            path.parent / name,
        )
        samples.append(
            Sample(
                name=name,
                place=place or name,
                image_path=file_path,
                is_open=CLASS_FOLDERS[key],
                kinds=(key,) if CLASS_FOLDERS[key] is False else (),
            )
        )
    return samples, group is not None
