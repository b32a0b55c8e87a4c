"""What a training of doornet leaves to look at: its losses, and its file on held-out places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.evaluate import classifier, depth
from doorway3ds.lab.evaluate.classifier import ClassifierRecord
from doorway3ds.lab.evaluate.depth import DepthRecord
from doorway3ds.lab.evaluate.report import pages, plots, sheets
from doorway3ds.lab.evaluate.report.html import Report
from doorway3ds.lab.evaluate.runners import Protocol
from doorway3ds.lab.train.doornet.data.samples import Sample
from doorway3ds.lab.train.doornet.model import CANONICAL_F_PX

_SHOWN = 8  # depth maps, the worst first

Answer = Mapping[str, Any]
"""The file's outputs for an image, with "sample" and "target" of its plain view."""


def add_answers(report: Report, answers: Sequence[Answer], about: str) -> None:
    """Tables and plots of p_open and depth; about: which images the answers are of."""
    if answers:
        report.notes.append(about)
    _add_p_open(report, answers)
    _add_depth(report, answers)


def metres(answer: Answer) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(predicted, true) depth of the plain view in metres of its own camera, nan unknown."""
    sample, target = answer["sample"], answer["target"]
    height, width = target.image.shape[:2]
    reach = min(sample.image.shape[1] / width, sample.image.shape[0] / height)
    scale = sample.camera[0] / reach / CANONICAL_F_PX
    true = np.where(target.depth > 0, target.depth * scale, np.nan)
    return np.asarray(answer["depth"] * scale, np.float32), np.asarray(true, np.float32)


def _add_p_open(report: Report, answers: Sequence[Answer]) -> None:
    """Scores, ROC, calibration and worst mistakes, a column for each source of images."""
    records: dict[str, list[ClassifierRecord]] = {}
    images: dict[str, NDArray[np.uint8]] = {}
    for answer in answers:
        sample: Sample = answer["sample"]
        if sample.open is None or not sample.weight:
            continue
        name = f"{sample.source}/{sample.name}"
        p_open = float(1 / (1 + np.exp(-float(answer["p_open"]))))
        records.setdefault(sample.source, []).append(
            ClassifierRecord(name, sample.place, bool(sample.open), p_open, sample.kinds)
        )
        images[name] = answer["target"].image
    if not records:
        return
    scored = {source: classifier.score(own) for source, own in records.items()}
    report.tables.append(pages.classifier_table(scored))
    pages.add_classifier_pictures(report, images, records, scored)


def _add_depth(report: Report, answers: Sequence[Answer]) -> None:
    """Scores and the worst maps, of images whose depth was measured."""
    records: dict[Protocol, list[DepthRecord]] = {}
    cases: dict[str, list[tuple[float, sheets.Tile]]] = {}
    for answer in answers:
        sample: Sample = answer["sample"]
        predicted, true = metres(answer)
        if answer["target"].depth_weight != 1 or not np.isfinite(true).any():
            continue
        record = depth.compare(f"{sample.source}/{sample.name}", sample.place, predicted, true)
        records.setdefault(Protocol(sample.source, "plain view", False), []).append(record)
        if record.errors.pixels:
            said = pages.depth_caption(record)
            tile = sheets.depth_panels(answer["target"].image, true, predicted, said)
            cases.setdefault(sample.source, []).append((record.errors.delta1, tile))
    if not records:
        return
    report.tables.append(pages.depth_table({p: depth.score(own) for p, own in records.items()}))
    spread = {p.network: own for p, own in records.items()}
    report.add_plot("delta1", "delta1 by image", plots.depth_spread(spread))
    for source, tiles in cases.items():
        worst = sorted(tiles, key=lambda pair: pair[0])[:_SHOWN]
        sheet = sheets.contact_sheet([tile for _, tile in worst])
        report.add_sheet(f"depth-{source}", f"Worst depth of {source}", sheet)
    report.notes.append(pages.DEPTH_NOTE)
