"""What a person says of one image, and the same as rows of `doorways.csv`.

The columns are those that `lab.datasets.readers` reads. `left_px` and `right_px`
are an opening's edges at mid-height in the image's own pixels, turned upright as its EXIF
orientation says; -0.5 and width - 0.5 where the image's edge cuts it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.csvfile import MARKS, Row, flag, number
from doorway3ds.lab.datasets.readers import HALF_OPEN, confidence

COLUMNS = (*MARKS, "state", "place")
NEEDED = MARKS[:4]
MAX_OPENINGS = 20
# The states of an open row, and of a row without an opening; nothing: not told apart.
_OPEN_STATES = ("", "open", HALF_OPEN)
_SHUT_STATES = ("", "none", "closed")


@dataclass(frozen=True)
class MarkedOpening:
    """One opening. clear: whether the way to it is free, None = cannot be told.

    confidence: 3 certain, 2 likely, 1 guess.
    """

    left_px: float
    right_px: float
    half_open: bool = False
    clear: bool | None = None
    confidence: int = 3

    def __post_init__(self) -> None:
        if not (math.isfinite(self.left_px) and math.isfinite(self.right_px)):
            raise ValueError("an opening's edges must be finite numbers")
        if not self.left_px < self.right_px:
            raise ValueError(
                f"an opening's left edge must lie left of its right one, "
                f"got {self.left_px:g} and {self.right_px:g}"
            )
        _require_confidence(self.confidence)


@dataclass(frozen=True)
class Marks:
    """One image: its openings, the main one first; or, where it has none, why.

    closed: without openings, a closed door is shown. confidence: of an image without openings.
    """

    openings: tuple[MarkedOpening, ...] = ()
    closed: bool = False
    confidence: int = 3

    def __post_init__(self) -> None:
        if self.openings and self.closed:
            raise ValueError("an image with an opening is not one of a closed door")
        if len(self.openings) > MAX_OPENINGS:
            raise ValueError(f"an image has at most {MAX_OPENINGS} openings")
        _require_confidence(self.confidence)

    @property
    def state(self) -> Literal["open", "half", "closed", "none"]:
        """Of the image as a whole: one opening that is open makes it open."""
        if not self.openings:
            return "closed" if self.closed else "none"
        return "half" if all(o.half_open for o in self.openings) else "open"


def _require_confidence(value: int) -> None:
    if value not in (1, 2, 3):
        raise ValueError(f"confidence must be 1, 2 or 3, got {value}")


def to_rows(name: str, marks: Marks, place: str, before: Sequence[Row] = ()) -> list[Row]:
    """The rows of one image. before: those it had; their further columns stay.

    place: for an image that names none yet.
    """
    rows = []
    for index, opening in enumerate(marks.openings or (None,)):
        old = dict(before[index]) if index < len(before) else {}
        main = before[0] if before else {}
        row = {**old, "image": name, "second": "1" if index else "0"}
        row["place"] = main.get("place") or place
        if opening is None:
            row |= {"open": "0", "left_px": "", "right_px": "", "clear": ""}
            row |= {"confidence": str(marks.confidence), "state": marks.state}
        else:
            row |= {"open": "1", "state": HALF_OPEN if opening.half_open else "open"}
            row |= {"left_px": f"{opening.left_px:.1f}", "right_px": f"{opening.right_px:.1f}"}
            row["clear"] = "" if opening.clear is None else str(int(opening.clear))
            row["confidence"] = str(opening.confidence)
        rows.append(row)
    return rows


def from_rows(rows: Sequence[tuple[str, Row]]) -> Marks:
    """The marks of one image's ("file line N", row) pairs.

    Raises UserError, one line that names the row, where they are none of `to_rows`' kind.
    """
    where, main = rows[0]
    if flag(main, "open", where):
        openings = sorted(rows, key=lambda pair: bool(flag(pair[1], "second", pair[0])))
        return Marks(tuple(_opening(row, at) for at, row in openings))
    if flag(main, "open", where) is None:
        raise UserError(f"{where}: expected open 0 or 1, got nothing")
    if len(rows) > 1:
        raise UserError(f"{rows[1][0]}: a second row of an image without an opening")
    return Marks((), _state(main, where, _SHUT_STATES) == "closed", confidence(main, where))


def _opening(row: Mapping[str, str], where: str) -> MarkedOpening:
    if not flag(row, "open", where):
        raise UserError(f"{where}: a row without an opening beside one with an opening")
    left, right = number(row, "left_px", where), number(row, "right_px", where)
    if left is None or right is None:
        raise UserError(f"{where}: an open row needs left_px and right_px")
    half = _state(row, where, _OPEN_STATES) == HALF_OPEN
    try:
        return MarkedOpening(left, right, half, flag(row, "clear", where), confidence(row, where))
    except ValueError as error:
        raise UserError(f"{where}: {error}") from error


def _state(row: Mapping[str, str], where: str, known: tuple[str, ...]) -> str:
    state = row.get("state", "")
    if state not in known:
        raise UserError(f"{where}: expected a state of {', '.join(known[1:])}, got '{state}'")
    return state
