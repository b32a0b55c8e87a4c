"""Scores of p_open against open / not open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from doorway3ds.lab.evaluate import metrics
from doorway3ds.lab.evaluate.intervals import Indices, Interval, Measure, by_place, mean, wilson
from doorway3ds.lab.evaluate.metrics import Calibration, Confusion

ECE_BINS = 10


@dataclass(frozen=True)
class ClassifierRecord:
    """One image: whether it shows an open doorway, and the probability given.

    kinds: what a negative shows instead ("closed door", "window"); may be several or none.
    """

    image: str
    place: str
    is_open: bool
    p_open: float
    kinds: tuple[str, ...] = ()


@dataclass(frozen=True)
class ClassifierMetrics:
    """Scores at `threshold`. wilson: shares as of independent images; metrics: intervals by
    resampled places; false_open_by_kind: share of each kind of negative that is called open
    (Wilson).
    """

    pictures: int
    places: int
    threshold: float
    confusion: Confusion
    metrics: Mapping[str, Interval]
    wilson: Mapping[str, Interval]
    false_open_by_kind: Mapping[str, Interval]
    calibration: Calibration


def score(
    records: Sequence[ClassifierRecord],
    threshold: float = 0.5,
    repeats: int = 2000,
) -> ClassifierMetrics:
    """Accuracy, balanced accuracy, AUC, calibration error and the rest; open = p >= threshold."""
    truth = np.array([r.is_open for r in records], bool)
    p = np.array([r.p_open for r in records], float)
    if np.isnan(p).any():
        raise ValueError("every record needs a probability; leave images without one out")
    answer = p >= threshold
    places = [r.place for r in records]

    def balanced(indices: Indices) -> float:
        return metrics.confusion(truth[indices], answer[indices]).balanced_accuracy

    def ece(indices: Indices) -> float:
        return metrics.calibration(truth[indices], p[indices], ECE_BINS).ece

    measures = {
        "accuracy": mean(answer == truth),
        "balanced_accuracy": Measure(balanced, len(records)),
        "auc": Measure(lambda indices: metrics.auc(truth[indices], p[indices]), len(records)),
        "ece": Measure(ece, len(records)),
    }
    c = metrics.confusion(truth, answer)
    kinds = sorted({kind for r in records if not r.is_open for kind in r.kinds})
    false_open = {}
    for kind in kinds:
        members = np.array([not r.is_open and kind in r.kinds for r in records], bool)
        false_open[kind] = wilson(int(answer[members].sum()), int(members.sum()))
    return ClassifierMetrics(
        threshold=threshold,
        pictures=len(records),
        places=len(set(places)),
        confusion=c,
        wilson={
            "accuracy": wilson(c.tp + c.tn, len(records)),
            "sensitivity": wilson(c.tp, c.tp + c.fn),
            "specificity": wilson(c.tn, c.tn + c.fp),
        },
        metrics=by_place(measures, places, repeats, ["accuracy", "balanced_accuracy"]),
        calibration=metrics.calibration(truth, p, ECE_BINS),
        false_open_by_kind=false_open,
    )
