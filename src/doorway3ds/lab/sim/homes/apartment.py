"""The plan of an apartment from a seed: rooms, what joins them, windows, mirrors.

Plan coordinates are metres, x and y along the walls, z up from the floor. Rooms are
rectangles between wall centre lines; a wall is `Home.wall_m` thick.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise, product

import numpy as np

from doorway3ds.lab.sim.homes.stairs import Flight

Rng = np.random.Generator

# States that count as an open doorway (the definition is in docs/sim.md).
OPEN_STATES = ("open", "half", "no_leaf", "archway", "sliding_open")
MIN_OPEN_DEG = 30.0


@dataclass(frozen=True)
class Room:
    """One room. light: RGB factor on everything in it; lamps: (x, y) of its ceiling lights."""

    index: int
    kind: str
    x0: float
    y0: float
    x1: float
    y1: float
    light: tuple[float, float, float] = (1.0, 1.0, 1.0)
    lamps: tuple[tuple[float, float], ...] = ()

    @property
    def area(self) -> float:
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    @property
    def centre(self) -> tuple[float, float]:
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    def inner(self, wall_m: float) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 between the faces of walls that thick."""
        t = wall_m / 2
        return self.x0 + t, self.y0 + t, self.x1 - t, self.y1 - t

    @property
    def sides(self) -> tuple[tuple[int, float, float, float], ...]:
        """Of each side, low x, high x, low y, high y: axis and place of its wall, where it runs."""
        along_x, along_y = (self.x0, self.x1), (self.y0, self.y1)
        return (
            (0, self.x0, *along_y), (0, self.x1, *along_y),
            (1, self.y0, *along_x), (1, self.y1, *along_x),
        )  # fmt: skip

    def holds(self, x: float, y: float, margin: float = 0.0) -> bool:
        return (
            self.x0 + margin <= x <= self.x1 - margin and self.y0 + margin <= y <= self.y1 - margin
        )


@dataclass(frozen=True)
class Portal:
    """An opening in a wall: doorway, archway, sliding door or window.

    axis: 0 if the wall is at x = `wall`, running along y; 1 if at y = `wall`, along x.
    at, width, sill, height: middle along the wall, free width, lower edge, upper edge (metres).
    rooms: index on the low side of the wall and on the high side; -1 is outdoors.
    state: open, half, closed, no_leaf, archway, sliding_open, sliding_closed, window,
        glass_closed, curtain.
    hinge: -1 / +1, the jamb the leaf hangs on; swing: the side of the wall it opens to.
    """

    axis: int
    wall: float
    at: float
    width: float
    sill: float
    height: float
    rooms: tuple[int, int]
    state: str
    hinge: int = 1
    swing: int = 1
    angle_deg: float = 0.0
    style: int = 0
    sill_top_m: float = 0.004

    @property
    def is_open(self) -> bool:
        return self.state in OPEN_STATES

    def point(self, along: float, across: float = 0.0) -> tuple[float, float]:
        """Plan point `along` the wall from the middle, `across` it from the centre line."""
        if self.axis == 0:
            return self.wall + across, self.at + along
        return self.at + along, self.wall + across

    def side(self, room: int) -> int:
        """The side of the wall on which one of its rooms lies: -1 low, 1 high."""
        return 1 if self.rooms[1] == room else -1

    @property
    def free(self) -> tuple[float, float]:
        """What is passable, along the wall from the middle (a sliding door covers half)."""
        half = self.width / 2
        if self.state == "sliding_open":
            return (-half, 0.0) if self.hinge > 0 else (0.0, half)
        return -half, half


@dataclass(frozen=True)
class WallSpan:
    """One room's side of one wall, room-facing: side 0..3 = low x, high x, low y, high y."""

    room: int
    side: int
    holes: tuple[Portal, ...]


@dataclass(frozen=True)
class Hazard:
    """A kind of `hazards.KINDS`. at: portal that it is about, or room of a mirror or closet."""

    kind: str
    at: int


@dataclass(frozen=True)
class Home:
    seed: int
    rooms: tuple[Room, ...]
    portals: tuple[Portal, ...]
    ceiling_m: float
    wall_m: float
    style: dict[str, float] = field(default_factory=dict)
    flights: tuple[Flight, ...] = ()
    hazards: tuple[Hazard, ...] = ()

    def room_at(self, x: float, y: float) -> Room | None:
        return next((r for r in self.rooms if r.holds(x, y)), None)

    def portals_of(self, room: int) -> list[Portal]:
        return [p for p in self.portals if room in p.rooms]

    def spans(self) -> list[WallSpan]:
        out = []
        for room in self.rooms:
            own = self.portals_of(room.index)
            for side, (axis, wall, _, _) in enumerate(room.sides):
                holes = [p for p in own if p.axis == axis and abs(p.wall - wall) < 1e-6]
                out.append(WallSpan(room.index, side, tuple(holes)))
        return out


def _split(
    rng: Rng, rect: tuple[float, float, float, float], least: float, depth: int
) -> list[tuple[float, float, float, float]]:
    x0, y0, x1, y1 = rect
    w, h = x1 - x0, y1 - y0
    if depth == 0 or max(w, h) < 2 * least + 0.3 or (w * h < 14 and rng.random() < 0.6):
        return [rect]
    axis = 0 if w >= h else 1
    low, size = rect[axis], (w, h)[axis]
    at = float(np.clip(low + rng.uniform(0.36, 0.64) * size, low + least, rect[axis + 2] - least))
    a, b = (
        ((x0, y0, at, y1), (at, y0, x1, y1)) if axis == 0 else ((x0, y0, x1, at), (x0, at, x1, y1))
    )
    return _split(rng, a, least, depth - 1) + _split(rng, b, least, depth - 1)


def _rectangles(rng: Rng) -> tuple[list[tuple[float, float, float, float]], int]:
    """Rectangles and the index of the corridor (-1: none)."""
    width, depth = rng.uniform(8.0, 13.5), rng.uniform(7.0, 11.0)
    if rng.random() < 0.3:
        return _split(rng, (0.0, 0.0, width * 0.8, depth * 0.8), 2.4, 3), -1
    corridor = rng.uniform(1.15, 1.9)
    low = rng.uniform(0.36, 0.58) * (depth - corridor)
    end = width if rng.random() < 0.5 else width * rng.uniform(0.5, 0.75)
    strips = []
    for y0, y1 in ((0.0, low), (low + corridor, depth)):
        parts = int(np.clip(round(width / rng.uniform(2.8, 4.6)), 2, 4))
        cuts = np.cumsum(rng.uniform(0.8, 1.4, parts))
        xs = np.concatenate([[0.0], cuts / cuts[-1] * width])
        strips += [(float(a), y0, float(b), y1) for a, b in pairwise(xs)]
    rects = [(0.0, low, end, low + corridor), *strips]
    if end < width:
        rects.append((end, low, width, low + corridor))
        # The stub behind the corridor joins the room above it where their sides agree.
        above = next((i for i, r in enumerate(rects[1:-1], 1) if r[1] > low and r[2] == width), 0)
        x0 = rects[above][0]
        if above and x0 > 1.8:
            rects[0] = (0.0, low, x0, low + corridor)
            rects[above] = (x0, low, width, depth)
            rects.pop()
    return rects, 0


def _kinds(rng: Rng, rects: list[tuple[float, float, float, float]], corridor: int) -> list[str]:
    areas = [(r[2] - r[0]) * (r[3] - r[1]) for r in rects]
    kinds = [""] * len(rects)
    order = list(np.argsort(areas)[::-1])
    pool = ["living", "bedroom", "kitchen", "bedroom", "bath", "office", "dining", "bedroom"]
    if corridor >= 0:
        kinds[corridor] = "corridor"
        order.remove(corridor)
    for i in order:
        if areas[i] < 4.5:
            kinds[i] = str(rng.choice(["bath", "store", "bath"]))
        else:
            kinds[i] = pool.pop(0) if pool else str(rng.choice(["bedroom", "office", "living"]))
    return kinds


def _shared(a: Room, b: Room) -> tuple[int, float, float, float, tuple[int, int]] | None:
    """(axis, wall, from, to, (low room, high room)) of the wall two rooms share."""
    for low, high in ((a, b), (b, a)):
        for side in (0, 2):
            (axis, wall, *ours), (_, other, *theirs) = low.sides[side + 1], high.sides[side]
            lo, hi = max(ours[0], theirs[0]), min(ours[1], theirs[1])
            if abs(wall - other) < 1e-6 and hi - lo > 1.0:
                return axis, wall, lo, hi, (low.index, high.index)
    return None


def _door(
    rng: Rng,
    wall: tuple[int, float, float, float, tuple[int, int]],
    kinds: tuple[str, str],
    ceiling: float,
) -> Portal:
    axis, at_wall, lo, hi, rooms = wall
    span = hi - lo - 0.36
    social = {"living", "dining", "kitchen", "corridor"}
    roll = rng.random()
    height = float(rng.uniform(1.96, 2.12))
    state, angle = "closed", 0.0
    width = float(rng.uniform(0.68, 0.98))
    if set(kinds) <= social and roll < 0.42 and span > 1.1:
        width = float(rng.uniform(0.9, min(2.2, span)))
        height = float(rng.uniform(2.0, min(2.35, ceiling - 0.12)))
        state = "archway"
    elif roll < 0.58:
        state, angle = "open", float(rng.uniform(60, 120))
    elif roll < 0.68:
        state, angle = "half", float(rng.uniform(MIN_OPEN_DEG, 60))
    elif roll < 0.78:
        state = "no_leaf"
    else:
        # Ajar by a hand's width is still closed to a robot.
        angle = float(rng.uniform(2, 14)) if rng.random() < 0.15 else 0.0
    width = min(width, span)
    side = rng.random()
    if side < 0.6 and span > width + 0.4:
        near = lo if rng.random() < 0.5 else hi
        at = near + np.sign((lo + hi) / 2 - near) * (0.18 + width / 2 + rng.uniform(0.05, 0.35))
    else:
        at = rng.uniform(lo + 0.18 + width / 2, hi - 0.18 - width / 2 + 1e-6)
    hinge, swing = int(rng.choice([-1, 1])), int(rng.choice([-1, 1]))
    hung = (state, hinge, swing, angle, int(rng.integers(6)))
    return Portal(axis, at_wall, float(at), width, 0.0, height, rooms, *hung)


def _windows(
    rng: Rng, rooms: list[Room], bounds: tuple[float, float, float, float], ceiling: float
) -> list[Portal]:
    """Windows and a balcony door; bounds: of the home at each side, as in `Room.sides`."""
    out = []
    balcony_done = False
    for room in rooms:
        for side, (axis, wall, lo, hi) in enumerate(room.sides):
            if abs(wall - bounds[side]) > 1e-6 or room.kind == "store":
                continue
            pair = (room.index, -1) if side % 2 else (-1, room.index)
            span = hi - lo - 0.7
            if room.kind == "living" and span > 1.9 and not balcony_done and rng.random() < 0.6:
                balcony_done = True
                state = "sliding_open" if rng.random() < 0.6 else "sliding_closed"
                width, top = float(min(span, rng.uniform(1.7, 2.6))), min(2.25, ceiling - 0.15)
                hung = (state, int(rng.choice([-1, 1])))
                out.append(Portal(axis, wall, (lo + hi) / 2, width, 0.0, top, pair, *hung))
                continue
            if rng.random() > (0.35 if room.kind == "corridor" else 0.72) or span < 0.5:
                continue
            width = float(rng.uniform(0.5, min(span, 2.2)))
            higher = 0.4 if room.kind == "bath" else 0
            sill = float(rng.choice([0.15, 0.45, 0.8, 0.9, 1.0])) + higher
            if sill < 0.5 and rng.random() < 0.6:
                sill = 0.9
            at = rng.uniform(lo + 0.35 + width / 2, hi - 0.35 - width / 2 + 1e-6)
            top = float(min(rng.uniform(2.0, 2.3), ceiling - 0.1))
            style = int(rng.integers(4))
            out.append(Portal(axis, wall, float(at), width, sill, top, pair, "window", style=style))
    return out


def _lit(rng: Rng, room: Room, day: bool) -> Room:
    """Brightness, colour of light and lamps of one room."""
    on = rng.random() < (0.55 if day else 0.85)
    level = rng.uniform(*((0.8, 1.0) if on else (0.45, 0.8) if day else (0.12, 0.3)))
    warm = rng.uniform(*((0.0, 0.22) if on else (-0.08, 0.04)))
    light = (level, level * (1 - 0.45 * warm), level * (1 - warm))
    w, h = room.x1 - room.x0, room.y1 - room.y0
    nx, ny = 2 if w > 5 else 1, 2 if h > 5 else 1
    lamps = []
    for i, j in product(range(nx), range(ny)):
        u, v = np.array([i, j]) + 0.5 + rng.uniform(-0.1, 0.1, 2)
        lamps.append((float(room.x0 + w * u / nx), float(room.y0 + h * v / ny)))
    return replace(room, light=(light[0], light[1], min(1.0, light[2])), lamps=tuple(lamps))


def generate(seed: int) -> Home:
    """The apartment of a seed; equal seeds give equal homes."""
    rng = np.random.default_rng([0x3D5, seed])
    rects, corridor = _rectangles(rng)
    kinds = _kinds(rng, rects, corridor)
    if rng.random() < 0.5:
        rects = [(y0, x0, y1, x1) for x0, y0, x1, y1 in rects]
    ceiling = float(rng.uniform(2.35, 2.95))
    day = bool(rng.random() < 0.75)
    rooms = [_lit(rng, Room(i, kinds[i], *rect), day) for i, rect in enumerate(rects)]
    portals: list[Portal] = []
    joined = {0 if corridor < 0 else corridor}
    walls = [wall for a, b in combinations(rooms, 2) if (wall := _shared(a, b))]
    while True:
        grow = [w for w in walls if (w[4][0] in joined) != (w[4][1] in joined)]
        if not grow:
            break
        # Off the corridor first, as in real plans.
        hubs = [w for w in grow if corridor in w[4]] or grow
        wall = hubs[int(rng.integers(len(hubs)))]
        joined |= set(wall[4])
        portals.append(_door(rng, wall, (kinds[wall[4][0]], kinds[wall[4][1]]), ceiling))
        walls.remove(wall)
    for wall in walls:
        if rng.random() < 0.28:
            portals.append(_door(rng, wall, (kinds[wall[4][0]], kinds[wall[4][1]]), ceiling))
    low, high = np.array(rects)[:, :2].min(0), np.array(rects)[:, 2:].max(0)
    bounds = (low[0], high[0], low[1], high[1])
    portals += _windows(rng, rooms, bounds, ceiling)
    sunny = float(day and rng.random() < 0.6)
    style = {
        "day": float(day),
        "sunny": sunny,
        "sun_deg": float(rng.uniform(0, 360)),
        "sun_up_deg": float(rng.uniform(20, 55)),
        "trim": float(rng.random()),
    }
    return Home(seed, tuple(rooms), tuple(portals), ceiling, float(rng.uniform(0.09, 0.2)), style)
