"""Whether the straight way to a doorway's sill is free, as a person would answer.

One rule labels `clear` in rendered images and decides how a stage of a trial should end.
"""

from __future__ import annotations

import numpy as np

from doorway3ds.compat import StrEnum
from doorway3ds.lab.sim.homes.apartment import Portal
from doorway3ds.lab.sim.homes.plan import Float, Plan

STEP_M = 0.01
BLOCKING_SHARE = 0.5  # of the robot's width
SPARE_M = 0.05  # on each side of a free way


class Way(StrEnum):
    """What a robot meets on the straight way from its turning axis to a sill."""

    FREE = "free"  # nothing within the robot's width and SPARE_M on each side
    GRAZING = "grazing"  # something, but it leaves more than half of the width
    BLOCKED = "blocked"  # obstacles cover at least half of the robot's width


def way_to(plan: Plan, start: Float, sill: Float, portal: Portal, width_m: float) -> Way:
    """The way from a place (x, y) to a point (x, y) on the middle line of a portal's wall.

    Obstacles are whatever the plan holds: furniture, people, leaves, walls, door frames, steps
    and drops. Those behind the wall's middle line, in the next room, do not count.
    """
    run = sill - start
    length = max(float(np.hypot(*run)), 1e-9)
    ahead = run / length
    left = np.array([-ahead[1], ahead[0]])
    reach = width_m / 2 + SPARE_M
    aside = np.arange(-reach + STEP_M / 2, reach, STEP_M)
    along = np.arange(STEP_M / 2, length, STEP_M)
    points = start + along[:, None, None] * ahead + aside[None, :, None] * left
    before = (points[..., portal.axis] - portal.wall) * (start[portal.axis] - portal.wall) > 0
    covered = (plan.taken_at(points) & before).any(axis=0)
    if covered[np.abs(aside) < width_m / 2].mean() >= BLOCKING_SHARE:
        return Way.BLOCKED
    return Way.GRAZING if covered.any() else Way.FREE
