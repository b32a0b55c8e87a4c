"""Where things of a decision stand in the robot's frame: metres, x forward, y left, z up."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from doorway3ds.camera.model import Array
from doorway3ds.types import Decision, Opening, Reason

LINTEL_M = 2.0
"""Height at which a lintel is drawn: that of ordinary doors, as no camera measures it."""


@dataclass(frozen=True)
class Doorway:
    """A doorway on the floor: (2,) its jambs and the middle of its sill; bearing of the middle.

    The wall counts as square to the line of sight.
    """

    left: Array
    right: Array
    middle: Array
    bearing_deg: float

    @property
    def frame(self) -> Array:
        """(4, 3) from the left jamb's foot up, along the lintel, and down to the right one's."""
        corners = [(*self.left, 0.0), (*self.left, LINTEL_M)]
        return np.array([*corners, (*self.right, LINTEL_M), (*self.right, 0.0)])


def doorway(opening: Opening, bearing_deg: float, range_m: float | None) -> Doorway | None:
    """The opening as it stands in the room, at a bearing and range; None without a range."""
    if range_m is None:
        return None
    angle = math.radians(bearing_deg)
    ahead = np.array([math.cos(angle), math.sin(angle)])
    aside = np.array([-ahead[1], ahead[0]])

    def jamb(edge_deg: float) -> Array:
        off = min(max(edge_deg - opening.bearing_deg, -80.0), 80.0)
        return np.asarray(range_m * (ahead + math.tan(math.radians(off)) * aside))

    left, right = jamb(opening.left_deg), jamb(opening.right_deg)
    return Doorway(left, right, range_m * ahead, bearing_deg)


def chosen(decision: Decision) -> Doorway | None:
    """The doorway that the decision speaks of, by its smoothed bearing and range if it has any."""
    opening = _opening(decision)
    if opening is None or decision.selection.bearing_deg is None:
        return None
    return doorway(opening, decision.selection.bearing_deg, decision.selection.range_m)


def candidates(decision: Decision) -> list[Doorway]:
    """The other openings whose range is known."""
    best = _opening(decision)
    others = (other for other in decision.selection.openings if other is not best)
    found = (doorway(other, other.bearing_deg, other.range_m) for other in others)
    return [one for one in found if one is not None]


def _opening(decision: Decision) -> Opening | None:
    """The opening that is meant; with memory it need not be the best one of this frame."""
    bearing, openings = decision.selection.bearing_deg, decision.selection.openings
    if decision.reason in (Reason.NO_DOOR, Reason.LOST) or bearing is None or not openings:
        return None
    return min(openings, key=lambda opening: abs(opening.bearing_deg - bearing))


def corridor(decision: Decision) -> Array | None:
    """(4, 2) corners of the floor that the robot would sweep on its way; None without a way."""
    if decision.reason in (Reason.NO_DOOR, Reason.LOST):
        return None
    corners = decision.selection.evidence.get("corridor_m")
    return None if corners is None else np.asarray(corners, np.float64)
