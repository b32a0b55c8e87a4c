"""From a selection to a decision: the gates, in the order in which they speak."""

from __future__ import annotations

from dataclasses import dataclass, replace

from doorway3ds.decide.options import ALIGNED_DEG
from doorway3ds.types import Decision, Frame, Perception, Reason, Selection


@dataclass(frozen=True)
class Gates:
    """Limits of the decision.

    open_from: p_open from which on a doorway is open.
    aligned_deg: a bearing of at most this needs no turn.
    max_unseen_m: floor must come into view at this distance or nearer; None accepts whatever
        the image's lower edge hides.
    """

    open_from: float = 0.5
    aligned_deg: float = ALIGNED_DEG
    max_unseen_m: float | None = None


def decide(
    perception: Perception,
    selection: Selection,
    frame: Frame,
    method: str,
    gates: Gates | None = None,
) -> Decision:
    """The first gate that holds gives the reason; only `turn` and `aligned` carry an angle."""
    gates = gates or Gates()
    is_open = perception.p_open >= gates.open_from
    unseen = _unseen(selection, gates)
    if is_open and selection.unsure is None and unseen is not None:
        selection = replace(selection, unsure=unseen, look=_side(selection))

    turn_deg: float | None = None
    if not is_open:
        reason = Reason.NO_DOOR
    elif selection.clear is False:
        reason = Reason.BLOCKED
    elif selection.unsure is not None or selection.bearing_deg is None:
        reason = Reason.UNSURE
    elif method != "paper" and abs(selection.bearing_deg) <= gates.aligned_deg:
        reason, turn_deg = Reason.ALIGNED, 0.0
    else:
        reason, turn_deg = Reason.TURN, selection.bearing_deg
    return Decision(
        reason=reason,
        turn_deg=turn_deg,
        p_open=perception.p_open,
        open=is_open,
        selection=selection,
        perception=perception,
        frame=frame,
        method=method,
        timings_ms=dict(perception.timings_ms),
    )


def _side(selection: Selection) -> str | None:
    if selection.bearing_deg is None:
        return None
    return "left" if selection.bearing_deg > 0 else "right"


def _unseen(selection: Selection, gates: Gates) -> str | None:
    """Why too much floor is unseen, in words, or None."""
    if gates.max_unseen_m is None:
        return None
    if selection.floor_from_m is None:
        return "the floor is not in view"
    if selection.floor_from_m > gates.max_unseen_m:
        return f"the floor is in view only from {selection.floor_from_m:.2f} m on"
    return None
