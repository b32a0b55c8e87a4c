"""Closer marks for a data set that tells less: exact openings where it has only boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.csvfile import csv_rows
from doorway3ds.lab.train.doornet.data.samples import CONFIDENCE, Sample, Span

_COLUMNS = ("image", "open", "left", "right", "clear", "confidence")
_WEIGHT = {str(sure): weight for sure, weight in CONFIDENCE.items()}


@dataclass(frozen=True)
class Mark:
    """What somebody saw in one image: its openings, as fractions of the width; none = closed."""

    spans: tuple[tuple[float, float, int | None], ...]
    weight: float


def read_marks(path: Path) -> dict[str, Mark]:
    """Marks by image: a CSV with image, open, left, right, clear and confidence.

    left and right are fractions of the image's width, cut at its edges; several rows of one
    image are several openings. clear is 1, 0 or empty, confidence 3 (certain) to 1 (guess).
    Raises UserError naming the first line that is none of this.
    """
    found: dict[str, Mark] = {}
    for where, row in csv_rows(path, _COLUMNS):
        try:
            mark = _mark(row)
        except (ValueError, KeyError) as error:
            raise UserError(
                f"{where}: expected open 0 or 1, left < right within 0..1, clear 0, 1 or empty "
                f"and confidence 1..3, got {row}"
            ) from error
        seen = found.get(row["image"])
        if seen is not None:
            mark = Mark(seen.spans + mark.spans, min(seen.weight, mark.weight))
        found[row["image"]] = mark
    return found


def _mark(row: Mapping[str, str]) -> Mark:
    weight = _WEIGHT[row["confidence"]]
    if row["open"] == "0":
        return Mark((), weight)
    left, right = float(row["left"]), float(row["right"])
    if row["open"] != "1" or not 0 <= left < right <= 1:
        raise ValueError
    clear = {"": None, "0": 0, "1": 1}[row["clear"]]
    return Mark(((left, right, clear),), weight)


def apply_marks(samples: Sequence[Sample], marks: Mapping[str, Mark]) -> list[Sample]:
    """The samples with the openings of `marks` where there are any for an image of that name.

    An image that its data set calls open and the marks do not shows an open door to no other
    room, a closet's: nobody knows what to call it, and it is left out of the opening labels.

    Raises UserError where no image has a mark.
    """

    def marked(sample: Sample) -> Sample:
        mark = marks.get(sample.name)
        if mark is None:
            return sample
        if sample.spans and not mark.spans:
            return replace(sample, spans=(), open=None, weight=0.0)
        width = sample.image.shape[1]
        spans = tuple(
            Span(left * width - 0.5, right * width - 0.5, clear=clear)
            for left, right, clear in mark.spans
        )
        is_open, extra = sample.open, sample.extra
        if is_open == 0 and spans:
            is_open, extra = 1, {key: value for key, value in extra.items() if key != "leaf"}
        return replace(sample, open=is_open, spans=spans, weight=mark.weight, extra=extra)

    if not any(sample.name in marks for sample in samples):
        raise UserError(f"none of the {len(marks)} marked images is in the data sets")
    return [marked(sample) for sample in samples]
