"""What homes have that robots fall down, drive into or take for a doorway.

A plain home is changed, never made anew: with no hazard asked for it stays what its seed gives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from doorway3ds.lab.sim.homes.apartment import Hazard, Home, Portal, Room
from doorway3ds.lab.sim.homes.furnish import Furnished, Rect, doormat, overlap
from doorway3ds.lab.sim.homes.stairs import Flight

Rng = np.random.Generator
Point = tuple[float, float]

KINDS = ("stairs_down", "stairs_up", "step", "threshold", "floor", "glass", "mirror", "curtain",
         "closet", "clutter", "pet", "person")  # fmt: skip
PLACES = ("corridor", "room", "behind")
"""Stairs at a corridor's end, open in a room, and behind an open doorway."""
FLOORS = ("dark", "shiny", "patterned")
THROUGH_M = 1.5  # stairs that begin this near behind a sill are told with its doorway
CLEAR_OF_DOORS = 0.25


def with_hazards(home: Home, rng: Rng, kinds: Sequence[str] | None = None) -> Home:
    """The home with some hazards in it; by default two to four kinds, drawn by `rng`."""
    if kinds is None:
        drawn = rng.permutation(len(KINDS))[: int(rng.integers(2, 5))]
        kinds = [KINDS[k] for k in drawn]
    # Stairs take doors away, which would shift the numbers that other hazards hold.
    for kind in sorted(kinds, key=lambda k: k not in ("stairs_down", "stairs_up", "step")):
        home = _ADD[kind](home, rng)
    return home


def marks(furnished: Furnished) -> list[tuple[int, Point]]:
    """(room, plan point) of what to look at: every hazard from every room that it is seen from."""
    home = furnished.home
    out: list[tuple[int, Point]] = []
    for flight in home.flights:
        out.append((flight.room, flight.start))
        for portal in home.portals_of(flight.room):
            if portal.is_open and flight.distance(*portal.point(0.0)) < THROUGH_M:
                out += [(r, portal.point(0.0)) for r in portal.rooms if r not in (-1, flight.room)]
    for hazard in home.hazards:
        if hazard.kind in ("mirror", "closet"):
            continue
        portal = home.portals[hazard.at]
        out += [(r, portal.point(0.0)) for r in portal.rooms if r >= 0]
    out += [(m.room, (m.x, m.y)) for m in furnished.mirrors if m.height > 1.5]
    out += [(p.room, (p.x, p.y)) for p in furnished.standing if p.item.name == "closet"]
    return out


def beyond(home: Home, portal: Portal, room: int) -> tuple[str, ...]:
    """What lies at or behind a portal's sill, seen from a room: threshold, step, stairs."""
    found = ["threshold"] if portal.sill_top_m >= 0.015 else []
    for flight in home.flights:
        near = flight.distance(*portal.point(0.0)) < THROUGH_M
        if near and flight.room != room and flight.room in portal.rooms:
            found.append(flight.kind)
    return tuple(found)


def add_stairs(home: Home, rng: Rng, kind: str, place: str) -> Home | None:
    """The home with one flight of a kind in a place of PLACES; None where it has no room."""
    spots = {"corridor": _corridor_end, "room": _in_room, "behind": _behind}[place](home, rng)
    if spots is None:
        return None
    room, rect, side, rails = spots
    length = rect[2] - rect[0] if side < 2 else rect[3] - rect[1]
    down = kind == "stairs_down" or (kind == "step" and rng.random() < 0.4)
    run, rise = float(rng.uniform(0.24, 0.3)), float(rng.uniform(0.15, 0.19))
    most = int(length / run)
    count = int(rng.integers(1, 3)) if kind == "step" else max(3, int(rng.uniform(0.7, 1) * most))
    if most < count:
        return None
    paint = f"wood{rng.integers(3)}" if rng.random() < 0.6 else str(
        rng.choice(["#8f8b85", "#c9c4bb", "#4a4642", "#6e5a48"])
    )  # fmt: skip
    flight = Flight(
        room.index, *rect, side, count, -rise if down else rise, run,
        rails if kind != "step" and rng.random() < 0.6 else (), paint,
    )  # fmt: skip
    portals = tuple(p for p in home.portals if not _stranded(home, p, flight))
    return replace(home, flights=(*home.flights, flight), portals=portals)


Spot = tuple[Room, Rect, int, tuple[int, ...]]


def _rect(axis: int, along: tuple[float, float], across: tuple[float, float]) -> Rect:
    (a0, a1), (b0, b1) = along, across
    return (a0, b0, a1, b1) if axis == 0 else (b0, a0, b1, a1)


def _mats(home: Home, room: Room, but: Portal | None = None) -> list[Rect]:
    """The floor before a room's doorways, but one."""
    return [
        doormat(p, home.wall_m, p.side(room.index))
        for p in home.portals_of(room.index)
        if p is not but and p.sill < 0.05
    ]


def _stranded(home: Home, portal: Portal, flight: Flight) -> bool:
    """A door that would hang over the steps: it goes, windows stay."""
    if portal.sill > 0.05 or flight.room not in portal.rooms:
        return False
    first = flight.distance(*portal.point(0.0)) > home.wall_m / 2 + CLEAR_OF_DOORS
    ends = [flight.distance(*portal.point(s * portal.width / 2)) for s in (-1, 1)]
    before = np.hypot(*np.subtract(flight.start, portal.point(0.0))) < THROUGH_M
    return not (first or before or min(ends) > home.wall_m / 2 + 0.02)


def _corridor_end(home: Home, rng: Rng) -> Spot | None:
    corridors = [r for r in home.rooms if r.kind == "corridor"]
    if not corridors:
        return None
    room = corridors[int(rng.integers(len(corridors)))]
    x0, y0, x1, y1 = room.inner(home.wall_m)
    axis = 0 if x1 - x0 >= y1 - y0 else 1
    (low, high), across = ((x0, x1), (y0, y1))[:: 1 - 2 * axis]
    if high - low < 4.5:
        return None
    length = float(rng.uniform(1.6, min(3.2, 0.5 * (high - low))))
    if rng.random() < 0.5:  # begins at its low side, ends at the corridor's high end
        return room, _rect(axis, (high - length, high), across), 2 * axis, ()
    return room, _rect(axis, (low, low + length), across), 2 * axis + 1, ()


def _in_room(home: Home, rng: Rng) -> Spot | None:
    """Along a wall, clear of every door."""
    rooms = [r for r in home.rooms if min(r.x1 - r.x0, r.y1 - r.y0) > 2.9]
    for k in rng.permutation(len(rooms)):
        room = rooms[int(k)]
        inner = room.inner(home.wall_m)
        mats = _mats(home, room)
        for _ in range(12):
            wall = int(rng.integers(4))
            wide, long = float(rng.uniform(0.85, 1.15)), float(rng.uniform(2.0, 3.1))
            # Along the wall: steps run in the wall's direction.
            axis = 1 if wall < 2 else 0
            low, high = inner[axis], inner[axis + 2]
            if high - low < long + 0.9:
                continue
            at = float(rng.uniform(low, high - long))
            near = inner[(0, 2, 1, 3)[wall]]
            off = (near, near + wide) if wall % 2 == 0 else (near - wide, near)
            rect = _rect(axis, (at, at + long), off)
            start = int(rng.integers(2))
            room_before = (at - low if start == 0 else high - at - long) > 0.85
            if room_before and not any(overlap(rect, m, 0.1) for m in mats):
                open_side = (1, 0, 3, 2)[wall]
                far = 2 * axis + 1 - start
                return room, rect, 2 * axis + start, (open_side, far)
    return None


def _behind(home: Home, rng: Rng) -> Spot | None:
    """In the next room, from an open doorway's far side on."""
    inside = [p for p in home.portals if p.is_open and -1 not in p.rooms]
    for k in rng.permutation(len(inside)):
        portal = inside[int(k)]
        side = int(rng.integers(2))
        room = home.rooms[portal.rooms[side]]
        inner = room.inner(home.wall_m)
        landing = float(rng.choice([0.0, rng.uniform(0.3, 1.0)]))
        if portal.swing == (1 if side == 1 else -1) and portal.state in ("open", "half"):
            landing = portal.width + 0.1  # the leaf needs a floor to open over
        axis = portal.axis
        deep = inner[axis + 2] - inner[axis] - landing
        if deep < 1.3:
            continue
        long = float(min(deep, rng.uniform(1.6, 3.4)))
        half = portal.width / 2 + float(rng.uniform(0.05, 0.3))
        low = max(portal.at - half, inner[1 - axis])
        high = min(portal.at + half, inner[3 - axis])
        begin = portal.wall + home.wall_m / 2 + landing
        span = (begin, begin + long)
        if side == 0:
            begin = portal.wall - home.wall_m / 2 - landing
            span = (begin - long, begin)
        rect = _rect(axis, span, (low, high))
        if not any(overlap(rect, m) for m in _mats(home, room, portal)):
            return room, rect, 2 * axis + (1 - side), ()
    return None


def _stairs(kind: str) -> Callable[[Home, Rng], Home]:
    def add(home: Home, rng: Rng) -> Home:
        for k in rng.permutation(len(PLACES)):
            changed = add_stairs(home, rng, kind, PLACES[int(k)])
            if changed is not None:
                return changed
        return home

    return add


def changed(home: Home, index: int, kind: str, **values: object) -> Home:
    """The home with one portal changed and named as a hazard."""
    portals = list(home.portals)
    portals[index] = replace(portals[index], **values)  # type: ignore[arg-type]
    hazards = (*home.hazards, Hazard(kind, index))
    return replace(home, portals=tuple(portals), hazards=hazards)


def glazed(portal: Portal) -> dict[str, object]:
    """How a door between rooms becomes one of glass."""
    if portal.width > 1.2:
        return {"state": "sliding_open" if portal.is_open else "sliding_closed"}
    if portal.is_open:
        return {"state": "open", "style": GLASS, "angle_deg": max(portal.angle_deg, 70.0)}
    return {"state": "glass_closed", "style": GLASS, "angle_deg": 0.0}


GLASS = 6  # the style of a leaf that is a pane in a thin frame


def _raised(rng: Rng) -> float:
    """Height of a threshold: one that wheels pass, or one that they do not."""
    return float(rng.uniform(0.015, 0.035) if rng.random() < 0.6 else rng.uniform(0.06, 0.16))


def _floor(home: Home, rng: Rng) -> Home:
    return replace(home, style={**home.style, "floor": float(rng.integers(len(FLOORS)))})


def _in_rooms(kind: str, kinds: tuple[str, ...]) -> Callable[[Home, Rng], Home]:
    def add(home: Home, rng: Rng) -> Home:
        fit = [r.index for r in home.rooms if r.kind in kinds]
        chosen = [fit[int(k)] for k in rng.permutation(len(fit))[:2]]
        return replace(home, hazards=(*home.hazards, *(Hazard(kind, i) for i in chosen)))

    return add


def _at(
    kind: str,
    most: int = 2,
    suits: Callable[[Portal], bool] = lambda portal: portal.is_open,
    values: Callable[[Portal, Rng], dict[str, object]] = lambda portal, rng: {},
) -> Callable[[Home, Rng], Home]:
    """Changes up to `most` portals between rooms that suit."""

    def add(home: Home, rng: Rng) -> Home:
        inside = [i for i, p in enumerate(home.portals) if -1 not in p.rooms and suits(p)]
        for index in [inside[int(k)] for k in rng.permutation(len(inside))[:most]]:
            home = changed(home, index, kind, **values(home.portals[index], rng))
        return home

    return add


_ADD: dict[str, Callable[[Home, Rng], Home]] = {
    "stairs_down": _stairs("stairs_down"),
    "stairs_up": _stairs("stairs_up"),
    "step": _stairs("step"),
    "threshold": _at("threshold", 3, values=lambda _, rng: {"sill_top_m": _raised(rng)}),
    "floor": _floor,
    "glass": _at("glass", 3, lambda p: p.sill == 0, lambda p, _: glazed(p)),
    "mirror": _in_rooms("mirror", ("bedroom", "corridor", "living", "office")),
    "curtain": _at(
        "curtain",
        suits=lambda p: p.sill == 0 and p.width < 1.5,
        values=lambda *_: {"state": "curtain", "angle_deg": 0.0},
    ),
    "closet": _in_rooms("closet", ("bedroom", "corridor", "office", "living")),
    "clutter": _at("clutter"),
    "pet": _at("pet"),
    "person": _at("person"),
}
