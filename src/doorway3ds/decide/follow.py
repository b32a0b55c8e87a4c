"""Staying with the doorway that was turned to, where another one would now be chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import OpeningParams, select_opening
from doorway3ds.types import Decision

SAME_DEG = 12.0
"""An opening this near to where the doorway should be is the doorway."""


def follow(
    decision: Decision,
    expected_deg: float | None,
    params: OpeningParams | None = None,
    gates: Gates | None = None,
) -> Decision:
    """The decision about the doorway expected at a bearing; unchanged where that is not in view.

    Between two doorways of equal rank the better one may change with every turn, and the robot
    would turn from one to the other for ever. The way to the followed one is judged anew.
    """
    found = decision.selection.openings
    if expected_deg is None or len(found) < 2 or not decision.open:
        return decision
    near = min(found, key=lambda opening: abs(opening.bearing_deg - expected_deg))
    if near is found[0] or abs(near.bearing_deg - expected_deg) > SAME_DEG:
        return decision
    votes = decision.perception.columns
    if votes is None:
        return decision
    middle = (np.asarray(votes.left_px) + np.asarray(votes.right_px)) / 2
    inside = (middle >= near.left_px) & (middle <= near.right_px)
    columns = replace(votes, score=np.where(inside, votes.score, 0.0))
    alone = replace(decision.perception, columns=columns)
    selection = select_opening(alone, decision.frame, params)
    if not selection.openings:
        return decision
    again = decide(alone, selection, decision.frame, decision.method, gates)
    return replace(again, perception=decision.perception, timings_ms=decision.timings_ms)
