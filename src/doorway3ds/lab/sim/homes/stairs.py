"""Steps in a room: down through the floor or up towards the ceiling."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.homes.furniture import Part
from doorway3ds.lab.sim.homes.mesh import Mesh, box, rod, sheet, steps

Float = NDArray[np.float64]
RISE_THROUGH_M = 1.0  # stairs that end higher go through the ceiling
SHAFT_M = 2.2  # what is seen of the storey above
EAVES_M = 0.3  # of the shaft below the lowest tread
RAIL_M = 0.95


@dataclass(frozen=True)
class Flight:
    """Straight steps that fill a rectangle of a room's floor.

    x0, y0, x1, y1: plan metres. side: where the first step lies, 0..3 = low x, high x, low y,
    high y. rise_m: of one step, negative for steps down. run_m: depth of one tread; the last
    one goes on to the rectangle's end. rails: 0..3, sides of the rectangle with a handrail.
    """

    room: int
    x0: float
    y0: float
    x1: float
    y1: float
    side: int
    steps: int
    rise_m: float
    run_m: float
    rails: tuple[int, ...] = ()
    paint: str = "wood0"

    @property
    def kind(self) -> str:
        """What it is called in truth: one or two steps are no stairs."""
        if self.steps <= 2:
            return "step"
        return "stairs_up" if self.rise_m > 0 else "stairs_down"

    @property
    def rect(self) -> tuple[float, float, float, float]:
        return self.x0, self.y0, self.x1, self.y1

    @property
    def end_m(self) -> float:
        """Height of the last tread over the floor."""
        return self.steps * self.rise_m

    @property
    def start(self) -> tuple[float, float]:
        """Middle of the edge of the first step."""
        x, y = (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2
        return ((self.x0, y), (self.x1, y), (x, self.y0), (x, self.y1))[self.side]

    @property
    def pierces(self) -> str | None:
        """Which of a room's faces it goes through."""
        if self.rise_m < 0:
            return "floor"
        return "ceiling" if self.end_m > RISE_THROUGH_M else None

    def distance(self, x: float, y: float) -> float:
        """Metres from a plan point to the rectangle."""
        dx = max(self.x0 - x, 0.0, x - self.x1)
        dy = max(self.y0 - y, 0.0, y - self.y1)
        return float(np.hypot(dx, dy))

    def holds(self, points: Float) -> NDArray[np.bool_]:
        """Which of the points (..., 2 or 3) lie over the rectangle."""
        x, y = points[..., 0], points[..., 1]
        return np.asarray((x >= self.x0) & (x <= self.x1) & (y >= self.y0) & (y <= self.y1))

    def treads(self) -> list[tuple[tuple[float, float, float, float], float]]:
        """Plan rectangle and height of each tread."""
        x0, y0, x1, y1 = self.rect
        axis = 0 if self.side < 2 else 1
        near, far = (x0, x1) if axis == 0 else (y0, y1)
        out = []
        for k in range(self.steps):
            a = k * self.run_m
            b = abs(far - near) if k == self.steps - 1 else (k + 1) * self.run_m
            low, high = (near + a, near + b) if self.side % 2 == 0 else (far - b, far - a)
            rect = (low, y0, high, y1) if axis == 0 else (x0, low, x1, high)
            out.append((rect, self.rise_m * (k + 1)))
        return out


def pierced(face: Mesh, flights: list[Flight]) -> Mesh:
    """A floor or ceiling without what lies over the flights."""
    middle = face.vertices[face.faces].mean(axis=1)
    keep = np.ones(len(middle), bool)
    for flight in flights:
        keep &= ~flight.holds(middle)
    return Mesh(face.vertices, face.normals, face.uv, face.faces[keep])


def ticks(start: float, stop: float, pitch: float, extra: list[float]) -> Float:
    """Grid lines of a face that also pass through `extra`."""
    inside = [v for v in extra if start < v < stop]
    return np.unique(np.round(np.concatenate([steps(start, stop, pitch), inside]), 6))


def _slab(rect: tuple[float, float, float, float], low: float, high: float) -> Mesh:
    x0, y0, x1, y1 = rect
    return box((x1 - x0, y1 - y0, high - low), ((x0 + x1) / 2, (y0 + y1) / 2, (low + high) / 2))


def _shaft(rect: tuple[float, float, float, float], low: float, high: float) -> list[Mesh]:
    """The four walls of an upright shaft, seen from inside."""
    x0, y0, x1, y1 = rect
    x, y, z = np.eye(3)
    corners = ((x0, y0, y, x), (x1, y0, y, -x), (x0, y0, x, y), (x0, y1, x, -y))
    spans = (y1 - y0, y1 - y0, x1 - x0, x1 - x0)
    return [
        sheet(np.array([cx, cy, low]), along, z, steps(0, span, 0.5), steps(0, high - low, 0.5), n)
        for (cx, cy, along, n), span in zip(corners, spans, strict=True)
    ]


def flight_parts(flight: Flight, ceiling_m: float, wall: str) -> list[Part]:
    """Treads, the shaft they lie in and handrails; wall: paint of the shaft."""
    end = flight.end_m
    bottom = min(0.0, end) - EAVES_M
    parts: list[Part] = []
    for rect, height in flight.treads():
        parts.append((flight.paint, _slab(rect, bottom if flight.rise_m < 0 else 0.0, height)))
    if flight.rise_m < 0:
        parts += [(wall, mesh) for mesh in _shaft(flight.rect, bottom, 0.0)]
    elif flight.pierces == "ceiling":
        top = ceiling_m + SHAFT_M
        parts += [(wall, mesh) for mesh in _shaft(flight.rect, ceiling_m, top)]
        parts.append((wall, _slab(flight.rect, top, top + 0.02)))
    for side in flight.rails:
        parts += _rail(flight, side)
    return parts


def _rail(flight: Flight, side: int) -> list[Part]:
    """Balusters and a handrail on one side; along steps up it rises with them."""
    x0, y0, x1, y1 = flight.rect
    a, b = (
        ((x0, y0), (x0, y1)), ((x1, y0), (x1, y1)), ((x0, y0), (x1, y0)), ((x0, y1), (x1, y1)),
    )[side]  # fmt: skip
    parts: list[Part] = []
    tops = []
    count = max(2, round(float(np.hypot(b[0] - a[0], b[1] - a[1])) / 0.14))
    for k in range(count + 1):
        x, y = a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count
        foot = 0.0
        if flight.rise_m > 0:
            foot = max(h for r, h in [((0, 0, 0, 0), 0.0), *flight.treads()] if h == 0.0 or (
                r[0] - 1e-6 <= x <= r[2] + 1e-6 and r[1] - 1e-6 <= y <= r[3] + 1e-6
            ))  # fmt: skip
        parts.append(("#d9d7d2", rod((x, y, foot), (x, y, foot + RAIL_M), 0.009, 6)))
        tops.append((x, y, foot + RAIL_M))
    parts += [(flight.paint, rod(p, q, 0.022)) for p, q in pairwise(tops)]
    return parts
