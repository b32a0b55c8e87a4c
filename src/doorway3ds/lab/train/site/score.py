"""What decides whether a site model is better: measures, their paired difference, the rule.

An image with a doorway is answered rightly where p_open is at least 0.5 and, if its openings
are marked, the answer's bearing lies inside one; an image without where p_open is below 0.5.
The rule: better is what answers more images rightly (the mean of both kinds' shares) so that
the 95 % interval of the paired difference over places lies above 0, finds doorways no more
seldom beyond chance, goes no more often where there is none, and leaves depth as it was.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from doorway3ds.lab.evaluate import direction, intervals
from doorway3ds.lab.evaluate.direction import DirectionRecord, Metric
from doorway3ds.lab.evaluate.intervals import Interval, Measure, mean
from doorway3ds.lab.evaluate.report.html import Table, cell

RULE = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
OPEN = 0.5
MAX_DEPTH_CHANGE = 0.05  # relative; a third of the packaged network's own error

_OF_DIRECTION = (
    "go_without_door",
    "inside",
    "within_5deg",
    "go_when_clear",
    "go_when_blocked",
    "auc",
)
MEASURES: dict[str, Metric] = {
    "right": Metric("answers rightly", "share", "high", "mean of the next two rows"),
    "found": Metric("finds the doorway", "share", "high", "images with an open doorway"),
    "refused": Metric("finds none where none is", "share", "high", "images without one"),
    **{name: direction.METRICS[name] for name in _OF_DIRECTION},
}


@dataclass(frozen=True)
class Comparison:
    """Measures of two networks on the same images, and second minus first."""

    before: Mapping[str, Interval]
    after: Mapping[str, Interval]
    difference: Mapping[str, Interval]
    pictures: int
    places: int


@dataclass(frozen=True)
class Verdict:
    """Whether the second is better, and in words by what."""

    better: bool
    why: str


def is_right(record: DirectionRecord) -> bool:
    """Whether one image is answered rightly."""
    called = record.p_open >= OPEN
    if not record.truth.is_open:
        return not called
    return bool(called and (not record.truth.openings or direction.judge(record).inside == 1))


def compare(
    before: Sequence[DirectionRecord],
    after: Sequence[DirectionRecord],
    repeats: int = 2000,
    seed: int = 0,
) -> Comparison:
    """Both with 95 % intervals by place, and their paired difference with its own.

    Raises ValueError unless both hold the same images in the same order.
    """
    places = direction.paired_places(before, after)
    first, second = _measures(before), _measures(after)
    return Comparison(
        intervals.bootstrap(first, places, repeats, seed),
        intervals.bootstrap(second, places, repeats, seed),
        intervals.paired_difference(first, second, places, repeats, seed),
        len(before),
        len(set(places)),
    )


def judge(comparison: Comparison, depth_change: float) -> Verdict:
    """The rule. depth_change: relative, between both networks' depth of the same images."""
    gain = comparison.difference["right"]
    said = (
        f"answers rightly {100 * gain.value:+.1f} points "
        f"({100 * gain.low:+.1f} to {100 * gain.high:+.1f}) on {comparison.pictures} images "
        f"of {comparison.places} held-out places"
    )
    if not gain.low > 0:
        return Verdict(False, f"{said}: the interval does not exclude that nothing is gained")
    found = comparison.difference["found"]
    if found.high < 0:
        return Verdict(False, f"{said}, but finds {-100 * found.value:.1f} points fewer doorways")
    goes = comparison.difference["go_without_door"].value
    if goes > 0:
        return Verdict(False, f"{said}, but {100 * goes:.1f} points more false turns (no doorway)")
    if not depth_change <= MAX_DEPTH_CHANGE:
        return Verdict(
            False,
            f"{said}, but depth changes by {100 * depth_change:.1f} %, more than "
            f"{100 * MAX_DEPTH_CHANGE:.0f} %",
        )
    return Verdict(True, said)


def table(comparison: Comparison) -> Table:
    """Before, after and the difference; only measures that some image speaks to."""
    rows = []
    for name, metric in MEASURES.items():
        values = [getattr(comparison, side)[name] for side in ("before", "after", "difference")]
        if values[0].n and any(math.isfinite(v.value) for v in values[:2]):
            about = f"{metric.about} (n = {values[0].n}); {metric.better} is better"
            rows.append((metric.title, about, [cell(v, metric.unit) for v in values]))
    return Table("Held-out places", ["before", "after", "after minus before"], rows)


def _measures(records: Sequence[DirectionRecord]) -> dict[str, Measure]:
    """Each of MEASURES."""
    doorway = np.array([bool(r.truth.is_open) for r in records])
    right = np.array([is_right(r) for r in records], float)
    found = mean(np.where(doorway, right, np.nan))
    refused = mean(np.where(doorway, np.nan, right))
    both = Measure(lambda i: (found.of(i) + refused.of(i)) / 2, len(records))
    others = direction.measures(records)
    own = {"right": both, "found": found, "refused": refused}
    return own | {name: others[name] for name in _OF_DIRECTION}
