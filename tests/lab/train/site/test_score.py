"""The rule by which a site model is kept: it can say no."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from doorway3ds.lab.datasets.truth import PictureTruth, TruthOpening
from doorway3ds.lab.evaluate.direction import DirectionRecord
from doorway3ds.lab.train.site.score import compare, judge


def records(answers: str, truth: str, reason: str = "turn") -> list[DirectionRecord]:
    """One place each; o: an opening at 0 degrees, s: one that is not marked, n: none.

    Answers: x: points at it, y: called open but points beside, -: called not open.
    """
    opening = TruthOpening(10, -10, 0, 2.0, True)
    found = []
    for number, (said, is_so) in enumerate(zip(answers, truth, strict=True)):
        shown = PictureTruth(
            f"{number}", f"{number}", is_so != "n", (opening,) if is_so == "o" else ()
        )
        listed = ((0.0 if said == "x" else 40.0, 2.0),)
        p_open, why = (0.1, "no_door") if said == "-" else (0.9, reason)
        found.append(DirectionRecord(shown, listed, why, p_open, True))
    return found


@pytest.mark.parametrize(
    ("before", "after", "truth", "change", "why"),
    [
        ("yyyyxxxxxxxx", "xxxxxx------", "oooosnnnnnnn", 0.0, ""),
        # as it was, and a gain that one place alone brings
        ("xxxxxx------", "xxxxxx------", "ossossnnnnnn", 0.0, "does not exclude"),
        ("yxxxxx------", "xxxxxx------", "ossossnnnnnn", 0.0, "does not exclude"),
        # refuses everything: right more often, and useless
        ("xxxxyyyyxxxxxxxx", "-" * 16, "oooooooonnnnnnnn", 0.0, "fewer doorways"),
        # depth is another's
        ("yyyyxxxxxxxx", "xxxxxx------", "oooossnnnnnn", 0.08, "depth changes by 8.0 %"),
    ],
)
def test_the_rule(before: str, after: str, truth: str, change: float, why: str) -> None:
    first, second = records(before, truth), records(after, truth)
    verdict = judge(compare(first, second, 500), change)
    assert verdict.better is (why == ""), verdict.why
    assert why in verdict.why


def test_going_where_no_doorway_is_spoils_any_gain() -> None:
    truth = "oooooossnnnn"
    before = records("yyyyyyxx----", truth)
    after = records("xxxxxxxx----", truth)
    after[-1] = replace(after[-1], reason="turn")
    compared = compare(before, after, 500)
    verdict = judge(compared, 0.0)
    assert not verdict.better
    assert "but 25.0 points more false turns (no doorway)" in verdict.why
    assert compared.before["found"].value == pytest.approx(2 / 8)
    assert compared.after["inside"].n == 6
    assert compared.after["go_without_door"].n == 4  # what is open and not marked is not among them
    assert math.isnan(compared.after["go_when_blocked"].value)
