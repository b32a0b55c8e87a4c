"""What files of networks are worth on places that they were not trained on, set by set.

A training with `--hold-out` lists the images that it kept to itself in `held-out.csv`; this
measures any files on them, by one rule for all sets, and the differences to the first, paired.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from doorway3ds.decide.gates import Gates
from doorway3ds.decide.pipeline import operating_point
from doorway3ds.errors import UserError
from doorway3ds.images.codec import write_image
from doorway3ds.lab.datasets.csvfile import csv_rows
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import Dataset, Sample
from doorway3ds.lab.evaluate import direction, intervals, metrics, runners
from doorway3ds.lab.evaluate.classifier import ECE_BINS
from doorway3ds.lab.evaluate.direction import DirectionRecord
from doorway3ds.lab.evaluate.intervals import Indices, Interval, Measure
from doorway3ds.lab.evaluate.report.html import cell, markdown
from doorway3ds.lab.evaluate.report.pages import worst_directions
from doorway3ds.networks.base import Network
from doorway3ds.types import Reason

ROBOT_LOW_M = 0.65  # a robot's camera is below

# of `direction.METRICS`, and of p_open alone
COLUMNS: dict[str, str] = {
    "within_5deg": "within 5 deg",
    "inside": "inside",
    "auc": "p_open AUC",
    "go_without_door": "false turns (no doorway)",
    "go_when_blocked": "turns when blocked",
    "go_when_clear": "turns when clear",
    "closed_open": "called open where none is",
    "open_open": "called open where one is",
    "ece": "ECE",
    "ece_chance": "ECE by chance",
}
_OF_P_OPEN = ("auc", "closed_open", "open_open", "ece", "ece_chance")


@dataclass(frozen=True)
class HeldSet:
    """Held-out images of one kind. rough: marks are boxes, which tell no bearing and no way.

    halves: 1 or 2 of each place. whole: False for images that are in another set already.
    """

    name: str
    samples: tuple[Sample, ...]
    rough: bool = False
    halves: Mapping[str, int] = field(default_factory=dict)
    whole: bool = True

    def half(self, which: int) -> HeldSet:
        """The images of one half of the places."""
        own = tuple(s for s in self.samples if self.halves[s.place] == which)
        return replace(self, samples=own)


@dataclass(frozen=True)
class Row:
    """values: by the names in COLUMNS, those that the set tells."""

    name: str
    file: str
    pictures: int
    doorways: int
    values: Mapping[str, Interval]


def source_of(dataset: Dataset) -> str:
    """What training calls the images of a folder."""
    if dataset.layout in ("plain", "folders"):
        return dataset.path.resolve().name
    return "doors" if dataset.layout == "boxes" else dataset.layout


def read_held(path: Path) -> dict[str, dict[str, tuple[str, int]]]:
    """The images that a training kept to itself, by source: place, and half of the places."""
    found: dict[str, dict[str, tuple[str, int]]] = {}
    for where, row in csv_rows(path, ("source", "image", "place", "half")):
        if row["half"] not in ("1", "2"):
            raise UserError(f"{where}: expected half 1 or 2, got '{row['half']}'")
        found.setdefault(row["source"], {})[row["image"]] = row["place"], int(row["half"])
    return found


def held_sets(
    folders: Sequence[Path], held: Mapping[str, Mapping[str, tuple[str, int]]]
) -> list[HeldSet]:
    """The held-out images of each folder; of rendered ones also those of a low camera.

    Raises UserError where a folder holds none.
    """
    found = []
    for folder in folders:
        dataset = read_dataset(folder)
        told = held.get(source_of(dataset), {})
        own = tuple(replace(s, place=told[s.name][0]) for s in dataset.samples if s.name in told)
        if not own:
            raise UserError(f"none of the held-out images is in {folder}")
        name = folder.resolve().name
        found.append(HeldSet(name, own, dataset.layout == "boxes", dict(told.values())))
        low = tuple(s for s in own if (s.pose.height_m or math.inf) < ROBOT_LOW_M)
        if low and len(low) < len(own):
            title = f"{name}, camera below {ROBOT_LOW_M} m"
            found.append(replace(found[-1], name=title, samples=low, whole=False))
    return found


def score(
    records: Sequence[DirectionRecord],
    rough: bool,
    repeats: int = 2000,
    before: Sequence[DirectionRecord] | None = None,
) -> dict[str, Interval]:
    """Each of COLUMNS that the set tells, or with `before` the difference to it."""
    if before is None:
        found = dict(direction.score(records, repeats).metrics)
    else:
        found = direction.difference(before, records, repeats)
    wanted = {name: found[name] for name in COLUMNS if name in found}
    places = [r.truth.place for r in records]
    if before is None:
        wanted |= intervals.bootstrap(_of_p_open(records), places, repeats)
        wanted["ece_chance"] = _ece_by_chance(records)
    else:
        was, now = _of_p_open(before), _of_p_open(records)
        wanted |= intervals.paired_difference(was, now, places, repeats)
    return {
        name: wanted[name]
        for name in COLUMNS
        if name in wanted and (name in _OF_P_OPEN or not rough)
    }


def _ece_by_chance(records: Sequence[DirectionRecord]) -> Interval:
    """What the calibration error would be if p_open were true: its median and 95 %."""
    p_open = [r.p_open for r in records if r.truth.is_open is not None]
    if not p_open:
        return Interval(math.nan, math.nan, math.nan, 0)
    drawn = metrics.calibration_by_chance(p_open, ECE_BINS)
    low, middle, high = np.percentile(drawn, [2.5, 50, 97.5])
    return Interval(float(middle), float(low), float(high), len(p_open))


def _of_p_open(records: Sequence[DirectionRecord]) -> dict[str, Measure]:
    told = np.array([r.truth.is_open is not None for r in records], bool)
    is_open = np.array([bool(r.truth.is_open) for r in records], bool)
    p_open = np.array([r.p_open for r in records], float)
    called = np.array([r.reason != Reason.NO_DOOR.value for r in records], float)

    def share(members: NDArray[np.bool_]) -> Measure:
        return Measure(intervals.mean(np.where(members, called, np.nan)).of, len(records))

    def ece(indices: Indices) -> float:
        known = indices[told[indices]]
        return metrics.calibration(is_open[known], p_open[known], ECE_BINS).ece

    return {
        "closed_open": share(told & ~is_open),
        "open_open": share(told & is_open),
        "ece": Measure(ece, len(records)),
    }


def compare(
    part: HeldSet,
    names: Sequence[str],
    load: Callable[[str], Network],
    preset: str | None = None,
    repeats: int = 2000,
    sheets: Path | None = None,
    progress: Callable[[Sequence[Sample]], Iterable[Sample]] = lambda samples: samples,
) -> list[Row]:
    """A row for each network, and one for each further network's difference to the first.

    names: files or known names; {k} in one stands for the half of the places that it looks at.
    sheets: folder for contact sheets of each network's worst images.
    """
    rows: list[Row] = []
    first: list[DirectionRecord] = []
    order = {sample.name: number for number, sample in enumerate(part.samples)}
    for number, name in enumerate(names):
        halves = [part.half(k).samples for k in (1, 2)] if "{k}" in name else [part.samples]
        records: list[DirectionRecord] = []
        for k, samples in enumerate(halves, 1):
            if not samples:
                continue
            network = load(name.replace("{k}", str(k)))
            params, gates = operating_point(network, preset) if preset else (None, Gates())
            answer = runners.methods_on(network, name, ["opening"], params=params, gates=gates)
            runs = runners.run_direction(progress(samples), answer)
            records += next(iter(runs.records.values()))
        records.sort(key=lambda record: order[record.truth.image])
        size = (len(records), sum(bool(r.truth.openings) for r in records))
        rows.append(Row(part.name, name, *size, score(records, part.rough, repeats)))
        if number:
            told = score(records, part.rough, repeats, first)
            rows.append(Row(part.name, f"{name} minus {names[0]}", *size, told))
        else:
            first = records
        if sheets is not None:
            sheet = worst_directions({s.name: s for s in part.samples}, records)
            if sheet is not None:
                write_image(sheets / f"{part.name}-{number}.png", sheet)
    return rows


def table(rows: Iterable[Row]) -> str:
    """Markdown: set, file, doorways, COLUMNS."""
    heads = ["places held out", "file", "images", "doorways", *COLUMNS.values()]
    unknown = Interval(math.nan, math.nan, math.nan, 0)

    def told(row: Row, key: str) -> str:
        unit = "" if key in ("auc", "ece", "ece_chance") else "share"
        return cell(row.values.get(key, unknown), unit, to=" to ")

    return markdown(
        heads,
        [
            [r.name, r.file, str(r.pictures), str(r.doorways), *(told(r, key) for key in COLUMNS)]
            for r in rows
        ],
    )
