"""From records to the report of each task: tables, plots, worst cases, and the JSON object."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.decide.gates import Gates
from doorway3ds.lab.datasets.samples import Sample
from doorway3ds.lab.evaluate import classifier, depth, direction, kinds
from doorway3ds.lab.evaluate.classifier import ClassifierMetrics, ClassifierRecord
from doorway3ds.lab.evaluate.depth import DepthMetrics, DepthRecord
from doorway3ds.lab.evaluate.direction import METRICS, DirectionMetrics, DirectionRecord, Outcome
from doorway3ds.lab.evaluate.intervals import Interval, wilson
from doorway3ds.lab.evaluate.kinds import KindScore
from doorway3ds.lab.evaluate.metrics import DEPTH_LIMITS_M
from doorway3ds.lab.evaluate.report import plots, sheets
from doorway3ds.lab.evaluate.report.html import Report, Table, cell
from doorway3ds.lab.evaluate.runners import Protocol
from doorway3ds.lab.evaluate.stored import Label

WORST = 16  # images on a contact sheet
UNITS = {"rmse": "m"}
INTERVALS = (
    "In brackets: 95 % intervals by resampling places (cluster bootstrap, percentile)"
    ", but those named Wilson, and those of shares of 0 and 100 %, of which resampling says "
    "nothing: they are Wilson's, which take images as independent. n: images."
)

DEPTH_NOTE = (
    "Sheets: image, true depth; predicted depth on the same scale, relative error (white "
    "from 50 % on). Depth is compared at the truth's size, predictions resized bilinearly "
    "and clipped to the limits; pixels whose truth is unknown or at the upper limit are "
    "left out. A value is the mean over images unless it says pooled."
)


def direction_table(scored: Mapping[Label, DirectionMetrics]) -> Table:
    rows = [
        _row(metric.title, metric.about, [s[name] for s in scored.values()], metric.unit)
        for name, metric in METRICS.items()
    ]
    return Table("Direction and way", [str(label) for label in scored], rows)


def difference_table(differences: Mapping[Label, Mapping[str, Interval]], first: Label) -> Table:
    """Differences to the first column, paired by image."""
    rows = [
        _row(m.title, f"{m.better} is better", [d[name] for d in differences.values()], m.unit)
        for name, m in METRICS.items()
    ]
    return Table(f"Minus {first}", [str(label) for label in differences], rows)


def kind_tables(by_kind: Mapping[Label, Mapping[str, KindScore]]) -> list[Table]:
    """A table for each column of the direction table whose data set tells kinds."""
    tables = []
    for label, scored in by_kind.items():
        if not scored:
            continue
        labelled = any(math.isfinite(s.on_it.value) for s in scored.values())
        columns = ["images", "places", "false turns", f"p_open ≥ {Gates.open_from:g}"]
        rows = []
        for kind, s in scored.items():
            cells = [str(s.pictures), str(s.places), cell(s.goes, "share"), cell(s.p_open, "share")]
            rows.append((kind, "", [*cells, cell(s.on_it, "share")] if labelled else cells))
        if labelled:
            columns.append("best candidate on it")
        tables.append(Table(f"No doorway, by what is shown: {label}", columns, rows))
    return tables


def direction_json(
    scored: Mapping[Label, DirectionMetrics],
    differences: Mapping[Label, Mapping[str, Interval]],
    by_kind: Mapping[Label, Mapping[str, KindScore]],
) -> dict[str, Any]:
    """`no_doorway_by_kind` is there only where the data set tells kinds."""
    runs = []
    for label, s in scored.items():
        run = {"method": label.method, "network": label.network, **vars(s)}
        if by_kind[label]:
            told = {kind: k.to_dict() for kind, k in by_kind[label].items()}
            run["no_doorway_by_kind"] = told
        runs.append(run)
    return {
        "task": "direction",
        "rule": " ".join((direction.__doc__ or "").split()),
        "runs": runs,
        "differences_to_first": [
            {
                "method": label.method,
                "network": label.network,
                "metrics": values,
            }
            for label, values in differences.items()
        ],
    }


def add_direction_pictures(
    report: Report,
    samples: Mapping[str, Sample],
    records: Mapping[Label, Sequence[DirectionRecord]],
    scored: Mapping[Label, DirectionMetrics],
) -> None:
    """Plots, and each column's worst images."""
    by_name = {str(label): r for label, r in records.items()}
    report.add_plot("bearing", "Bearing errors", plots.bearing_errors(by_name))
    report.add_plot("shares", "Shares", plots.shares({str(k): s for k, s in scored.items()}))
    for number, (label, column) in enumerate(records.items(), 1):
        sheet = worst_directions(samples, column)
        if sheet is not None:
            report.add_sheet(f"worst-{number}", f"Worst of {label}", sheet)
    report.notes.append(" ".join((direction.__doc__ or "").split()))
    if any(r.truth.kinds for column in records.values() for r in column):
        report.notes.append(" ".join((kinds.__doc__ or "").split()))
    report.notes.append(INTERVALS)
    report.notes.append(
        "Contact sheets: marked openings green; the answer's bearing amber where within 5 "
        "degrees, red where not. A turn past the opening comes before a turn without a doorway, "
        "that before a turn along a blocked way, that before a missed or an inexact opening."
    )


def worst_directions(
    samples: Mapping[str, Sample], records: Sequence[DirectionRecord]
) -> NDArray[np.uint8] | None:
    """A contact sheet of the worst answers, (H, W, 3) RGB; None where all are right."""
    judged = [(direction.judge(r), r) for r in records]
    worst = sorted(judged, key=lambda pair: -badness(*pair))[:WORST]
    tiles = [
        sheets.direction_tile(samples[r.truth.image], r, outcome)
        for outcome, r in worst
        if badness(outcome, r) > 0
    ]
    return sheets.contact_sheet(tiles) if tiles else None


def badness(outcome: Outcome, record: DirectionRecord) -> float:
    """How much harm an answer would do, for ordering; 0 = right."""
    if record.truth.unmarked:
        return 0.0
    error = 0.0 if math.isnan(outcome.error_deg) else abs(outcome.error_deg)
    if not record.truth.openings:
        sure = 0.0 if math.isnan(record.p_open) else record.p_open
        return outcome.go * (100 + sure)
    if outcome.go and not (outcome.within or outcome.inside):
        return 200 + error
    if outcome.go and outcome.way_clear == 0:
        return 90
    if outcome.matched is None:
        return 40
    return error if not outcome.within else 0.0


def classifier_table(scored: Mapping[str, ClassifierMetrics]) -> Table:
    """Scores, confusion counts, and false alarms by kind of negative."""
    columns = list(scored.values())
    rows = [
        _row(title, about, [c.metrics[name] for c in columns], unit)
        for name, title, about, unit in (
            ("accuracy", "accuracy", f"at p_open {columns[0].threshold:g}", "share"),
            ("balanced_accuracy", "balanced accuracy", "mean of both classes", "share"),
            ("auc", "AUC", "", ""),
            ("ece", "calibration error (ECE)", f"{classifier.ECE_BINS} bins", ""),
        )
    ]
    rows += [
        _row(f"{name}, Wilson", about, [c.wilson[name] for c in columns], "share")
        for name, about in (
            ("accuracy", "all images"),
            ("sensitivity", "open, called open"),
            ("specificity", "not open, called not open"),
        )
    ]
    for name, about in (
        ("tp", "open, called open"),
        ("fn", "open, called not open"),
        ("fp", "not open, called open"),
        ("tn", "not open, called not open"),
    ):
        rows.append((about, "images", [str(getattr(c.confusion, name)) for c in columns]))
    for kind in sorted({kind for c in columns for kind in c.false_open_by_kind}):
        values = [c.false_open_by_kind.get(kind, wilson(0, 0)) for c in columns]
        rows.append(_row(f"called open: {kind}, Wilson", "not open, showing it", values, "share"))
    return Table("Open or not", list(scored), rows)


def add_classifier_pictures(
    report: Report,
    samples: Mapping[str, Sample | NDArray[np.uint8]],
    records: Mapping[str, Sequence[ClassifierRecord]],
    scored: Mapping[str, ClassifierMetrics],
) -> None:
    report.add_plot("roc", "ROC", plots.roc(records))
    report.add_plot("reliability", "Calibration", plots.reliability(scored))
    for number, (name, column) in enumerate(records.items(), 1):
        wrong = [r for r in column if (r.p_open >= scored[name].threshold) != r.is_open]
        wrong.sort(key=lambda r: -abs(r.p_open - r.is_open))
        tiles = [
            sheets.picture_tile(
                samples[r.image],
                f"{r.image}: {'open' if r.is_open else 'not open'}, p {r.p_open:.2f}",
            )
            for r in wrong[:WORST]
        ]
        if tiles:
            report.add_sheet(f"worst-{number}", f"Worst of {name}", sheets.contact_sheet(tiles))
    report.notes.append(INTERVALS)


def depth_table(scored: Mapping[Protocol, DepthMetrics]) -> Table:
    columns = list(scored.values())
    rows = [
        _row(name, _depth_about(name), [c.metrics[name] for c in columns], UNITS.get(name, ""))
        for name in depth.MEASURES
    ]
    rows += [
        (f"{name}, pooled", "over all pixels together", [f"{c.pooled[name]:.3f}" for c in columns])
        for name in ("delta1", "rmse")
    ]
    return Table("Depth", [str(p) for p in scored], rows)


def depth_json(scored: Mapping[Protocol, DepthMetrics]) -> dict[str, Any]:
    low, high = DEPTH_LIMITS_M
    return {
        "task": "depth",
        "limits_m": [low, high],
        "runs": [
            {"network": p.network, "crop": p.crop, "mirrored": p.mirrored, **vars(s)}
            for p, s in scored.items()
        ],
    }


def add_depth_pictures(
    report: Report,
    records: Mapping[Protocol, Sequence[DepthRecord]],
    worst: Mapping[str, Sequence[tuple[Sample, NDArray[np.float32], DepthRecord]]],
) -> None:
    """worst: by network, the images to show with the map predicted for each."""
    report.add_plot(
        "delta1", "delta1 by image", plots.depth_spread({str(p): r for p, r in records.items()})
    )
    for number, (name, cases) in enumerate(worst.items(), 1):
        tiles = [
            sheets.depth_tile(sample, predicted, depth_caption(r)) for sample, predicted, r in cases
        ]
        report.add_sheet(f"worst-{number}", f"Worst of {name}", sheets.contact_sheet(tiles))
    report.notes.append(INTERVALS)
    report.notes.append(DEPTH_NOTE)


def depth_caption(record: DepthRecord) -> str:
    errors = record.errors
    return f"{record.image}: delta1 {errors.delta1:.2f}, RMSE {errors.rmse:.2f} m"


def _depth_about(name: str) -> str:
    if name.startswith("delta"):
        return f"share of pixels within a factor of 1.25^{name[-1]}"
    return {"abs_rel": "mean |error| / truth", "rmse": "metres", "log10": "mean |log10 error|"}[
        name
    ]


def _row(
    title: str, about: str, values: Sequence[Interval], unit: str
) -> tuple[str, str, list[str]]:
    """A row with the images that its values rest on in the title."""
    low, high = min(v.n for v in values), max(v.n for v in values)
    counts = f"n = {low}" if low == high else f"n = {low} to {high}"
    return f"{title}, {counts}", about, [cell(v, unit) for v in values]
