"""Scores of answers against marked doorways: direction, way, and when to go.

The rule of comparison. An answer's bearing is that of its first listed opening, whatever the
reason says (`unsure` counts by its bearing; the `paper` method lists none and counts by its
selected pixel). It is compared with the nearest of the image's marked openings, further
(`second`) ones included. An image with a doorway and without any listed opening is wrong in
`within` and `inside`, and is left out of the error's median and percentile, which stand
beside the share `listed`. The way counts as that to the same, nearest, marked opening; where
nothing is listed, as that to the main one. Bearing and way are the geometry's, also where
the gate is closed (`no_door`). An image that shows a doorway, and nobody marked where, counts
for p_open alone: neither as a doorway to point at nor as none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import wrapped_deg
from doorway3ds.lab.datasets.truth import PictureTruth
from doorway3ds.lab.evaluate import intervals, metrics
from doorway3ds.lab.evaluate.intervals import Indices, Interval, Measure

FloatArray = NDArray[np.floating[Any]]

TOLERANCE_DEG = 5.0
GO_REASONS = ("turn", "aligned")


@dataclass(frozen=True)
class DirectionRecord:
    """One image's truth beside one answer.

    listed: (bearing_deg, range_m) of the listed openings, best first. reason: value of
    `types.Reason`. p_open nan = not given. lies_on: the kind of thing under the first listed
    opening, "" = none that is asked for, None = not known.
    """

    truth: PictureTruth
    listed: tuple[tuple[float, float | None], ...]
    reason: str
    p_open: float
    clear: bool | None
    lies_on: str | None = None


@dataclass(frozen=True)
class Metric:
    """One row of the table. unit: "share", "deg", "m" or "" (a number without unit)."""

    title: str
    unit: str
    better: str
    about: str


METRICS: dict[str, Metric] = {
    "bearing_median_deg": Metric(
        "bearing error, median", "deg", "low", "doorway images with a listed opening"
    ),
    "bearing_p90_deg": Metric(
        "bearing error, 90th percentile", "deg", "low", "doorway images with a listed opening"
    ),
    "listed": Metric("an opening is listed", "share", "high", "doorway images"),
    "within_5deg": Metric(
        f"bearing within {TOLERANCE_DEG:g} deg",
        "share",
        "high",
        "doorway images; none listed counts as wrong",
    ),
    "inside": Metric(
        "bearing inside the opening",
        "share",
        "high",
        "doorway images; none listed counts as wrong",
    ),
    "turns_inside": Metric(
        "turns that end inside an opening",
        "share",
        "high",
        "all answers `turn` or `aligned`, unless to a doorway that is not marked",
    ),
    "range_median_m": Metric("range error, median", "m", "low", "listed and true range both known"),
    "range_median_share": Metric(
        "range error over true range, median", "share", "low", "listed and true range both known"
    ),
    "go_without_door": Metric(
        "false turns (no doorway)", "share", "low", "images without a doorway"
    ),
    "go_when_blocked": Metric("turns when blocked", "share", "low", "doorway images, way blocked"),
    "go_when_clear": Metric("turns when clear", "share", "high", "doorway images, way clear"),
    "clear_agreement": Metric(
        "agrees on clear", "share", "high", "doorway images, way known and answered"
    ),
    "clear_answered": Metric("answers on clear", "share", "high", "doorway images, way known"),
    "auc": Metric("p_open, AUC", "", "high", "images open or not"),
}


@dataclass(frozen=True)
class DirectionMetrics:
    """Scores by the names in `METRICS`, each with its interval by place."""

    pictures: int
    doorway_pictures: int
    places: int
    metrics: Mapping[str, Interval] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Interval:
        return self.metrics[name]


@dataclass(frozen=True)
class Outcome:
    """One record judged. nan = does not apply; shares are 0 or 1.

    error_deg: signed, answer minus truth. matched: index of the marked opening compared with.
    """

    matched: int | None
    error_deg: float
    within: float
    inside: float
    range_error_m: float
    range_error_share: float
    way_clear: float
    clear_right: float
    go: float


def record_from_json(truth: PictureTruth, answer: Mapping[str, Any]) -> DirectionRecord:
    """The record of one object as `3ds look --json` and `--save-answers` write it.

    The latter adds `selection`: what the geometry says where the gate is closed. Without it an
    image that is `no_door` has no way and, by the `paper` method, nothing listed. Raises
    KeyError, TypeError or ValueError on an object of another kind.
    """
    listed = tuple(
        (float(o["bearing_deg"]), _optional(o.get("range_m"))) for o in answer["openings"]
    )
    found = answer.get("selection", answer)
    pointed = _optional(found["bearing_deg"])
    if not listed and pointed is not None:
        listed = ((pointed, _optional(found["range_m"])),)
    p_open, clear = answer["p_open"], found["clear"]
    return DirectionRecord(
        truth,
        listed,
        str(answer["reason"]),
        math.nan if p_open is None else float(p_open),
        None if clear is None else bool(clear),
    )


def judge(record: DirectionRecord, tolerance_deg: float = TOLERANCE_DEG) -> Outcome:
    """One record by the rule at the top of this module."""
    nan = math.nan
    openings = record.truth.openings
    go = float(record.reason in GO_REASONS)
    if not openings:
        return Outcome(None, nan, nan, nan, nan, nan, nan, nan, go)
    matched, error, within, inside, range_error = 0, nan, 0.0, 0.0, nan
    if record.listed:
        bearing, range_m = record.listed[0]
        errors = [wrapped_deg(bearing - o.bearing_deg) for o in openings]
        matched = int(np.argmin(np.abs(errors)))
        error = errors[matched]
        truth = openings[matched]
        within = float(abs(error) <= tolerance_deg)
        inside = float(truth.right_deg <= bearing <= truth.left_deg)
        if range_m is not None and truth.range_m is not None:
            range_error = abs(range_m - truth.range_m)
    way, true_range = openings[matched].clear, openings[matched].range_m
    agrees = nan if way is None or record.clear is None else float(way == record.clear)
    return Outcome(
        matched=matched if record.listed else None,
        error_deg=error,
        within=within,
        inside=inside,
        range_error_m=range_error,
        range_error_share=range_error / true_range if true_range else nan,
        way_clear=nan if way is None else float(way),
        clear_right=agrees,
        go=go,
    )


def score(records: Sequence[DirectionRecord], repeats: int = 2000) -> DirectionMetrics:
    """All of `METRICS` over the records; intervals by resampling places.

    `repeats` 0 leaves the intervals out (nan), for use during training.
    """
    places = [record.truth.place for record in records]
    shares = [name for name, metric in METRICS.items() if metric.unit == "share"]
    return DirectionMetrics(
        pictures=len(records),
        doorway_pictures=sum(bool(record.truth.openings) for record in records),
        places=len(set(places)),
        metrics=intervals.by_place(measures(records), places, repeats, shares),
    )


def difference(
    first: Sequence[DirectionRecord],
    second: Sequence[DirectionRecord],
    repeats: int = 2000,
) -> dict[str, Interval]:
    """`second - first` per metric, paired by image and place.

    Raises ValueError unless both hold the same images in the same order.
    """
    places = paired_places(first, second)
    return intervals.paired_difference(measures(first), measures(second), places, repeats)


def paired_places(first: Sequence[DirectionRecord], second: Sequence[DirectionRecord]) -> list[str]:
    """Each image's place; ValueError unless both hold the same images in the same order."""
    if [r.truth.image for r in first] != [r.truth.image for r in second]:
        raise ValueError("paired records must be of the same images in the same order")
    return [record.truth.place for record in first]


def measures(records: Sequence[DirectionRecord]) -> dict[str, Measure]:
    """Each of METRICS."""
    outcomes = [judge(record) for record in records]

    def column(values: Iterable[float]) -> FloatArray:
        return np.array(list(values), float)

    error = column(abs(o.error_deg) for o in outcomes)
    doorway = column(float(bool(r.truth.openings)) for r in records)
    go = column(o.go for o in outcomes)
    way = column(o.way_clear for o in outcomes)
    inside = column(o.inside for o in outcomes)
    clear_right = column(o.clear_right for o in outcomes)
    unmarked = column(float(r.truth.unmarked) for r in records)
    p_open = column(r.p_open for r in records)
    is_open = np.array([bool(r.truth.is_open) for r in records], bool)
    scored = np.array([r.truth.is_open is not None for r in records], bool) & ~np.isnan(p_open)

    def where(condition: NDArray[np.bool_], values: FloatArray) -> FloatArray:
        return np.where(condition, values, math.nan)

    def auc(indices: Indices) -> float:
        known = indices[scored[indices]]
        return metrics.auc(is_open[known], p_open[known])

    # Each a column with nan outside its denominator, so that a mean is a share.
    means = {
        "listed": where(doorway == 1, (~np.isnan(error)).astype(float)),
        "within_5deg": column(o.within for o in outcomes),
        "inside": inside,
        "turns_inside": where((go == 1) & (unmarked == 0), np.nan_to_num(inside, nan=0.0)),
        "go_without_door": where((doorway == 0) & (unmarked == 0), go),
        "go_when_blocked": where(way == 0, go),
        "go_when_clear": where(way == 1, go),
        "clear_agreement": clear_right,
        "clear_answered": where(~np.isnan(way), (~np.isnan(clear_right)).astype(float)),
    }
    range_error = column(o.range_error_m for o in outcomes)
    found = {
        "bearing_median_deg": intervals.quantile(error, 0.5),
        "bearing_p90_deg": intervals.quantile(error, 0.9),
        "range_median_m": intervals.quantile(range_error, 0.5),
        "range_median_share": intervals.quantile([o.range_error_share for o in outcomes], 0.5),
        "auc": Measure(auc, int(scored.sum())),
        **{name: intervals.mean(values) for name, values in means.items()},
    }
    return {name: found[name] for name in METRICS}


def _optional(value: Any) -> float | None:
    return None if value is None else float(value)
