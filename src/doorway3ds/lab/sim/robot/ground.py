"""The floor of a simulated home under a robot: how far it can walk, and what its sonars hear."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.homes.plan import CELL_M, Plan

STEP_M = 0.01
CONE_DEG = 30.0
RAYS = 13
_FAR_M = 10.0


class Ground:
    """Walls, leaves and things as seen from above. What lies beyond the plan is free.

    plan: makes the plan, once, when something first walks or listens.
    """

    def __init__(self, plan: Callable[[], Plan]) -> None:
        self._make = plan

    @cached_property
    def _plan(self) -> Plan:
        return self._make()

    @cached_property
    def _gap(self) -> NDArray[np.float32]:
        """(rows, columns) of the plan's cells: metres to the nearest thing or wall."""
        free = np.uint8(1) - (self._plan.occupied | self._plan.walls)
        away = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(away * CELL_M, np.float32)

    def gap(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres from (N, 2) plan points to the nearest thing or wall, to a cell."""
        column, row = np.floor((points - self._plan.origin) / CELL_M).astype(int).T
        rows, columns = self._gap.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        out = np.full(len(points), _FAR_M)
        out[inside] = self._gap[row[inside], column[inside]]
        return out

    def reach(self, way: NDArray[np.float64], radius_m: float) -> tuple[int, float | None]:
        """How far a round footprint can go along (N, 2) plan points: the index of the last one,
        and the plan bearing in degrees of what it then touches, None if all of the way is free.

        A footprint that touches something already may still leave it.
        """
        gap = self.gap(way)
        stuck = np.flatnonzero((gap[1:] < radius_m) & (gap[1:] < gap[:-1] - 1e-6))
        if not len(stuck):
            return len(way) - 1, None
        at = int(stuck[0])
        return at, self._towards(way[at], way[at + 1] - way[at])

    def _towards(self, at: NDArray[np.float64], by: NDArray[np.float64]) -> float:
        """The bearing of the nearest thing ahead."""
        ahead = math.atan2(by[1], by[0])
        angles = ahead + np.radians(np.linspace(-90.0, 90.0, 37))
        nearest = int(np.argmin([self._ray(at, a, 1.0) for a in angles]))
        return math.degrees(float(angles[nearest]))

    def range(self, x: float, y: float, heading_deg: float, most_m: float) -> float:
        """What an ultrasonic sensor hears: metres to the nearest thing in its cone, or `most_m`."""
        at = np.array([x, y])
        angles = np.radians(heading_deg + np.linspace(-CONE_DEG, CONE_DEG, RAYS))
        return min(self._ray(at, float(a), most_m) for a in angles)

    def _ray(self, at: NDArray[np.float64], angle: float, most_m: float) -> float:
        along = np.arange(0.0, most_m, STEP_M)
        run = np.array([math.cos(angle), math.sin(angle)])
        hits = np.flatnonzero(self.gap(at + along[:, None] * run) <= 0.0)
        return float(along[hits[0]]) if len(hits) else most_m
