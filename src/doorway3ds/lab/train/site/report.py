"""The report of a qualification: before and after, and the images that changed sides."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from doorway3ds.lab.datasets.samples import Sample
from doorway3ds.lab.evaluate import classifier, direction
from doorway3ds.lab.evaluate.classifier import ClassifierRecord
from doorway3ds.lab.evaluate.direction import DirectionRecord
from doorway3ds.lab.evaluate.report import pages, plots, sheets
from doorway3ds.lab.evaluate.report.html import Report
from doorway3ds.lab.train.engine import outcome
from doorway3ds.lab.train.site import score
from doorway3ds.lab.train.site.score import is_right

if TYPE_CHECKING:
    from doorway3ds.lab.train.site.qualify import SiteTraining

_SHOWN = (
    "command",
    "date",
    "machine",
    "data",
    "network",
    "parts",
    "places_by",
    "near_copies_across_the_split",
    "replayed",
    "options",
    "learned",
    "recalibrated",
    "left_out",
)


def site_page(done: SiteTraining, card: Mapping[str, Any]) -> Report:
    """Verdict and measures first, then the images that changed sides."""
    facts = {"verdict": ("better: " if done.verdict.better else "not better: ") + done.verdict.why}
    facts |= outcome.facts({key: card[key] for key in _SHOWN if card.get(key)})
    report = Report(f"Qualification on {Path(str(card['data'])).name}", facts)
    report.tables.append(score.table(done.comparison))
    _add_p_open(report, done)
    marked = any(r.truth.openings for r in done.records["before"])
    if marked:
        report.add_plot("bearing", "Bearing errors", plots.bearing_errors(done.records))
    for stage, history in done.tuned.history.items():
        title = f"Losses while the {stage} learned"
        report.add_plot(f"curve-{stage}", title, outcome.curves(history, "loss"))
    _add_sheets(report, done)
    report.notes += [
        score.RULE,
        pages.INTERVALS,
        f"Depth changed by {100 * done.depth_change:.2f} % on average.",
        "Contact sheets: marked openings green; the answer's bearing amber where within 5 "
        "degrees, red where not.",
    ]
    return report


def _add_p_open(report: Report, done: SiteTraining) -> None:
    """Scores of open or not, ROC and calibration of both networks."""
    pictures = {p.name: p for p in done.parts.held}
    records = {
        name: [
            ClassifierRecord(
                r.truth.image,
                r.truth.place,
                bool(r.truth.is_open),
                r.p_open,
                pictures[r.truth.image].kinds,
            )
            for r in column
        ]
        for name, column in done.records.items()
    }
    scored = {name: classifier.score(column) for name, column in records.items()}
    report.tables.append(pages.classifier_table(scored))
    report.add_plot("roc", "ROC", plots.roc(records))
    report.add_plot("reliability", "Calibration", plots.reliability(scored))


def _add_sheets(report: Report, done: SiteTraining) -> None:
    pictures = {p.name: p for p in done.parts.held}
    pairs = list(zip(done.records["before"], done.records["after"], strict=True))
    sides = {
        "spoiled": ("Right before, wrong after", True, False),
        "mended": ("Wrong before, right after", False, True),
        "wrong": ("Wrong before and after", False, False),
    }
    for stem, (title, was, becomes) in sides.items():
        chosen = [b for a, b in pairs if (is_right(a), is_right(b)) == (was, becomes)]
        if chosen:
            shown = chosen[: pages.WORST]
            tiles = [_tile(record, pictures[record.truth.image]) for record in shown]
            said = f"{title}: {len(chosen)} of {len(pairs)} held-out images"
            report.add_sheet(stem, f"{said} (answers: after)", sheets.contact_sheet(tiles))


def _tile(record: DirectionRecord, picture: Sample) -> sheets.Tile:
    """Marked openings with the answer; of an image that is only sorted, what p_open said."""
    if record.truth.openings or not record.truth.is_open:
        return sheets.direction_tile(picture, record, direction.judge(record))
    said = f"{picture.name}: {record.reason}, p {record.p_open:.2f}; a doorway, not marked"
    return sheets.picture_tile(picture, said)
