"""What a user may say of the images that are measured, and of the report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from doorway3ds.camera.options import LensOptions
from doorway3ds.options import MANY, Options, setting


@dataclass(frozen=True)
class DataOptions(LensOptions):
    """Which images of a data set are measured; the camera is of those that bring none."""

    panel: ClassVar[str] = "Images"

    layout: str | None = setting(
        None, "nyu, rendered, plain, boxes or folders; default: recognised from the files."
    )
    split: str | None = setting(
        None, "Evaluate fold K of N of the places only, K from 1.", metavar="K/N"
    )
    folds: int | None = setting(
        None,
        "Evaluate all N folds, each by its own network ({k} in --network).",
        low=2,
        high=1000,
        metavar="N",
    )
    images: Path | None = setting(
        None, "Evaluate only the images named in this file, one per line.", metavar="FILE"
    )
    places: Path | None = setting(
        None, "CSV with columns image, place, to tell which images belong together.", metavar="FILE"
    )


@dataclass(frozen=True)
class MarkOptions(DataOptions):
    """The same of images with marks of several confidences."""

    min_confidence: int = setting(1, "Leave out marks below this confidence.", low=1, high=3)
    marks: Path | None = setting(
        None, "Marks of a bag's images; default: doorways.csv beside the bag.", metavar="FILE"
    )


@dataclass(frozen=True)
class ReportOptions(Options):
    """What is reported, and where."""

    panel: ClassVar[str] = "Report"

    repeats: int = setting(2000, "Bootstrap resamples; 0 = no intervals.", low=0, high=MANY)
    out: Path | None = setting(
        None, "Write report.html, report.json and PNGs there.", metavar="DIR"
    )
    json_file: Path | None = setting(
        None, "Write the numbers as JSON; - for stdout.", metavar="FILE", names=("--json",)
    )
