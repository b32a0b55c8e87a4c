"""Answers to images without a doorway, by what they show instead.

An image shows a kind (closed door, window, mirror ...) whose classes cover 2 % of it or more, or
that its data set names; it may show several. `goes` and `p_open` are the whole image's: what is
shown need not be what led to them. `on it` looks at the best candidate, listed from the lowest
score on and whatever the gate says: of the classes under its columns, in the middle tenth of the
rows, the kind's together are the most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.decide.gates import Gates
from doorway3ds.lab.datasets.samples import NYU_KINDS, bearing_to_column
from doorway3ds.lab.evaluate.direction import GO_REASONS, DirectionRecord
from doorway3ds.lab.evaluate.intervals import Interval, by_place, mean, plain
from doorway3ds.types import Frame

ANY = "all without a doorway"
NONE = "none of these kinds"


@dataclass(frozen=True)
class KindScore:
    """Shares of the images that show one kind. on_it: unknown (nan) without labels; for ANY,
    on any of the kinds.
    """

    pictures: int
    places: int
    goes: Interval
    p_open: Interval
    on_it: Interval

    def to_dict(self) -> dict[str, Any]:
        return {
            "pictures": self.pictures,
            "places": self.places,
            "goes": plain(self.goes),
            "p_open_from_0.5": plain(self.p_open),
            "best_candidate_on_it": plain(self.on_it),
        }


def candidate_deg(answer: Mapping[str, Any]) -> tuple[float, float] | None:
    """Left and right bearing of the best candidate of an answer as `--save-answers` writes it.

    Where only a bearing is known it is both; None where nothing is listed or pointed at.
    """
    if answer["openings"]:
        best = answer["openings"][0]
        middle = best["bearing_deg"]
        return float(best.get("left_deg", middle)), float(best.get("right_deg", middle))
    pointed = answer.get("selection", answer)["bearing_deg"]
    return None if pointed is None else (float(pointed), float(pointed))


def kind_under(labels: NDArray[np.uint8], frame: Frame, left_deg: float, right_deg: float) -> str:
    """The kind of NYU_KINDS that most of a candidate lies on; "" where it is another class.

    labels: (H, W), of the frame's whole image.
    """
    height, width = labels.shape
    scale = width / frame.camera.width
    edges = [(bearing_to_column(frame, b) + 0.5) * scale - 0.5 for b in (left_deg, right_deg)]
    # What is narrower than a column, or ends beyond the image, still lies on one.
    first = min(max(math.ceil(edges[0]), 0), width - 1)
    last = max(min(math.floor(edges[1]), width - 1), first)
    rows = slice(round(0.45 * height), max(round(0.55 * height), round(0.45 * height) + 1))
    counts = np.bincount(labels[rows, first : last + 1].ravel(), minlength=256)
    of_kind = {kind: int(counts[list(ids)].sum()) for kind, ids in NYU_KINDS.items()}
    counts[[k for ids in NYU_KINDS.values() for k in ids]] = 0
    best = max(of_kind, key=of_kind.__getitem__)
    return best if of_kind[best] > counts.max() else ""


def score(records: Sequence[DirectionRecord], repeats: int = 2000) -> dict[str, KindScore]:
    """By kind, ANY first and NONE last; intervals by resampling the places of all records.

    Empty where no image names a kind.
    """
    shown = [set(r.truth.kinds) if r.truth.is_open is False else set() for r in records]
    known = [k for k in NYU_KINDS if any(k in kinds for kinds in shown)]
    others = sorted(set().union(*shown) - set(known))
    if not known and not others:
        return {}
    places = [r.truth.place for r in records]
    without = np.array([r.truth.is_open is False for r in records])
    members = {ANY: without}
    members |= {k: np.array([k in kinds for kinds in shown]) for k in (*known, *others)}
    members[NONE] = without & np.array([not kinds for kinds in shown])
    goes = np.array([float(r.reason in GO_REASONS) for r in records])
    p_open = np.array([r.p_open for r in records], float)
    called = np.where(np.isnan(p_open), math.nan, p_open >= Gates.open_from)
    measures = {}
    for kind, member in members.items():
        on_it = [_on_it(r, kind) for r in records]
        for name, values in (("goes", goes), ("p_open", called), ("on_it", on_it)):
            measures[f"{name} {kind}"] = mean(np.where(member, values, math.nan))
    found = by_place(measures, places, repeats, shares=measures)
    return {
        kind: KindScore(
            int(member.sum()),
            len({place for place, inside in zip(places, member, strict=True) if inside}),
            *(found[f"{name} {kind}"] for name in ("goes", "p_open", "on_it")),
        )
        for kind, member in members.items()
        if member.any()
    }


def _on_it(record: DirectionRecord, kind: str) -> float:
    if record.lies_on is None or kind == NONE:
        return math.nan
    return float(record.lies_on != "" if kind == ANY else record.lies_on == kind)
