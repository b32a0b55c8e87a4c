"""Where things stand and hang in an apartment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from doorway3ds.lab.sim.homes import clutter, furniture
from doorway3ds.lab.sim.homes.apartment import Home, Portal, Room
from doorway3ds.lab.sim.homes.furniture import Item, Maker

Rng = np.random.Generator
Rect = tuple[float, float, float, float]  # x0, y0, x1, y1
YAW_OF_SIDE = (-90.0, 90.0, 0.0, 180.0)


@dataclass(frozen=True)
class Placed:
    """An item in the plan: its origin at (x, y, z), turned by yaw about z."""

    item: Item
    x: float
    y: float
    yaw_deg: float
    room: int
    z: float = 0.0


@dataclass(frozen=True)
class Mirror:
    """A flat mirror: middle of its face, yaw of the facing direction (+y at 0), size."""

    x: float
    y: float
    z: float
    yaw_deg: float
    width: float
    height: float
    room: int


@dataclass(frozen=True)
class Rug:
    """A flat piece of textile on the floor."""

    x: float
    y: float
    yaw_deg: float
    width: float
    depth: float
    room: int
    picture: int


@dataclass(frozen=True)
class Furnished:
    """A home with everything in it. standing: on the floor; hung: on walls and ceilings."""

    home: Home
    standing: tuple[Placed, ...]
    hung: tuple[Placed, ...]
    mirrors: tuple[Mirror, ...]
    rugs: tuple[Rug, ...]
    curtains: tuple[tuple[Portal, int], ...]


def footprint(item: Item, x: float, y: float, yaw_deg: float) -> Rect:
    """Axis-aligned bounds of a turned item."""
    c, s = abs(np.cos(np.radians(yaw_deg))), abs(np.sin(np.radians(yaw_deg)))
    w, d = item.size[0] / 2, item.size[1] / 2
    hx, hy = w * c + d * s, w * s + d * c
    return float(x - hx), float(y - hy), float(x + hx), float(y + hy)


def overlap(a: Rect, b: Rect, gap: float = 0.0) -> bool:
    return a[0] < b[2] + gap and b[0] < a[2] + gap and a[1] < b[3] + gap and b[1] < a[3] + gap


def doormat(portal: Portal, wall: float, side: int) -> Rect:
    """The floor before a doorway that furniture leaves free, on one side of its wall."""
    deep = 0.85
    if portal.swing == side and portal.state in ("open", "half", "closed", "glass_closed"):
        deep = portal.width + 0.12
    half = portal.width / 2 + 0.12
    near, far = sorted((0.0, side * (wall / 2 + deep)))
    a, b = portal.point(-half, near), portal.point(half, far)
    return min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1])


ROOMS: dict[str, tuple[tuple[Maker, float], ...]] = {
    "living": (
        (furniture.sofa, 1.0), (furniture.tv_unit, 0.85), (furniture.bookshelf, 0.7),
        (furniture.armchair, 0.6), (furniture.dresser, 0.5), (furniture.coffee_table, 0.75),
        (furniture.bookshelf, 0.3), (furniture.desk, 0.2),
    ),
    "bedroom": (
        (furniture.bed, 1.0), (furniture.wardrobe, 0.9), (furniture.dresser, 0.7),
        (furniture.dresser, 0.5), (furniture.desk, 0.35), (furniture.chair, 0.4),
        (furniture.bookshelf, 0.3),
    ),
    "kitchen": (
        (furniture.kitchen, 1.0), (furniture.fridge, 0.9), (furniture.dining, 0.55),
        (furniture.washer, 0.3), (furniture.kitchen, 0.3), (furniture.bookshelf, 0.15),
    ),
    "bath": (
        (furniture.basin, 1.0), (furniture.toilet, 0.9), (furniture.bathtub, 0.6),
        (furniture.washer, 0.5),
    ),
    "office": (
        (furniture.desk, 1.0), (furniture.bookshelf, 0.9), (furniture.bookshelf, 0.5),
        (furniture.dresser, 0.4), (furniture.armchair, 0.35), (furniture.desk, 0.3),
        (furniture.wardrobe, 0.2),
    ),
    "dining": (
        (furniture.dining, 1.0), (furniture.dresser, 0.8), (furniture.bookshelf, 0.4),
    ),
    "corridor": (
        (furniture.dresser, 0.35), (furniture.bookshelf, 0.2),
    ),
    "store": (
        (furniture.bookshelf, 0.9), (furniture.washer, 0.4), (furniture.wardrobe, 0.3),
    ),
}  # fmt: skip
"""Furniture of each kind of room, and how likely it is there."""
MIRRORED = {"bath": 0.8, "corridor": 0.5, "bedroom": 0.45, "living": 0.25}
RUGGED = ("living", "bedroom", "dining", "corridor", "office")
_FREE = (furniture.coffee_table, furniture.dining)  # the rest stands against walls


class _Room:
    """Free space of one room while it is being furnished."""

    def __init__(self, home: Home, room: Room, rng: Rng) -> None:
        self.home, self.room, self.rng = home, room, rng
        self.inner: Rect = room.inner(home.wall_m)
        self.taken: list[tuple[Rect, float]] = []
        self.mats = [
            doormat(p, home.wall_m, p.side(room.index))
            for p in home.portals_of(room.index)
            if p.state != "window"
        ]
        self.holes = {s.side: s.holes for s in home.spans() if s.room == room.index}
        self.placed: list[Placed] = []
        self.taken += [(f.rect, home.ceiling_m) for f in home.flights if f.room == room.index]

    def fits(self, rect: Rect, mats: bool = True) -> bool:
        x0, y0, x1, y1 = self.inner
        if rect[0] < x0 or rect[1] < y0 or rect[2] > x1 or rect[3] > y1:
            return False
        if mats and any(overlap(rect, m) for m in self.mats):
            return False
        return not any(overlap(rect, r, 0.02) for r, _ in self.taken)

    def put(self, item: Item, x: float, y: float, yaw: float, mats: bool = True) -> bool:
        rect = footprint(item, x, y, yaw)
        if not self.fits(rect, mats):
            return False
        self.taken.append((rect, item.size[2]))
        self.placed.append(Placed(item, x, y, yaw, self.room.index))
        return True

    def along(self, side: int) -> tuple[float, float, float]:
        """(from, to, wall face) of a side, in plan coordinates."""
        x0, y0, x1, y1 = self.inner
        return ((y0, y1, x0), (y0, y1, x1), (x0, x1, y0), (x0, x1, y1))[side]

    def at_wall(self, side: int, along: float, off: float) -> tuple[float, float]:
        inward = (1, -1, 1, -1)[side]
        face = self.along(side)[2] + inward * off
        return (face, along) if side < 2 else (along, face)

    def against_wall(self, item: Item, tries: int = 14) -> bool:
        w, d, h = item.size
        for _ in range(tries):
            side = int(self.rng.integers(4))
            lo, hi, _ = self.along(side)
            if hi - lo < w + 0.02:
                continue
            low, high = lo + w / 2 + 0.01, hi - w / 2 - 0.01
            along = float(self.rng.uniform(low, high))
            if self.rng.random() < 0.5:  # corners fill first
                along = low if self.rng.random() < 0.5 else high
            holes = (p for p in self.holes[side] if h > p.sill + 0.02)
            if any(abs(p.at - along) < (p.width + w) / 2 for p in holes):
                continue
            x, y = self.at_wall(side, along, d / 2 + 0.015)
            if self.put(item, x, y, YAW_OF_SIDE[side]):
                return True
        return False

    def inside(
        self, item: Item, tries: int = 10, mats: bool = True, yaw: float | None = None
    ) -> bool:
        x0, y0, x1, y1 = self.inner
        for _ in range(tries):
            turn = float(self.rng.choice([0, 90, 180, 270])) if yaw is None else yaw
            x, y = float(self.rng.uniform(x0, x1)), float(self.rng.uniform(y0, y1))
            if self.put(item, x, y, turn, mats):
                return True
        return False


def _decorate(space: _Room, rng: Rng, mirrors_left: int) -> tuple[list[Placed], list[Mirror]]:
    """Pictures, clocks, shelves and mirrors on one room's walls."""
    hung: list[Placed] = []
    mirrors: list[Mirror] = []
    room = space.room
    want_mirror = MIRRORED.get(room.kind, 0.1)
    for side in range(4):
        lo, hi, _ = space.along(side)
        used = [(p.at, p.width / 2 + 0.12, p.sill - 0.1) for p in space.holes[side]]
        for _ in range(int(rng.integers(0, 4 if hi - lo < 3 else 7))):
            is_mirror = len(mirrors) < mirrors_left and rng.random() < want_mirror / 3
            if is_mirror:
                width = float(rng.uniform(0.4, 1.0))
                height = float(rng.choice([0.6, 0.9, 1.4, 1.85]) * rng.uniform(0.85, 1.1))
                middle = max(height / 2 + 0.03, 1.45 if height < 1.1 else 0.0)
                item = None
            else:
                item = clutter.WALL[int(rng.integers(len(clutter.WALL)))](rng)
                width, height = item.size[0], item.size[2]
                middle = float(rng.uniform(1.45, 1.7))
            if hi - lo < width + 0.2:
                continue
            along = float(rng.uniform(lo + width / 2 + 0.08, hi - width / 2 - 0.08))
            bottom = middle - height / 2 - (0.9 if item is not None and item.name == "coats" else 0)
            if any(abs(along - a) < w + width / 2 and middle + height / 2 > z for a, w, z in used):
                continue
            x, y = space.at_wall(side, along, 0.0)
            probe = footprint(Item("", (width, 0.3, 0), ()), x, y, YAW_OF_SIDE[side])
            if any(overlap(probe, r) and top > bottom for r, top in space.taken):
                continue
            used.append((along, width / 2 + 0.06, 0.0))
            if item is None:
                x, y = space.at_wall(side, along, 0.03)
                mirrors.append(Mirror(x, y, middle, YAW_OF_SIDE[side], width, height, room.index))
                want_mirror /= 3
            else:
                hung.append(Placed(item, x, y, YAW_OF_SIDE[side], room.index, middle))
    return hung, mirrors


def _block(space: _Room, rng: Rng, portal: Portal) -> None:
    """Something in the way between the room and an open doorway."""
    side = portal.side(space.room.index)
    item = clutter.BLOCKERS[int(rng.integers(len(clutter.BLOCKERS)))](rng)
    for _ in range(6):
        far = space.home.wall_m / 2 + rng.uniform(0.35, 1.6)
        x, y = portal.point(float(rng.normal(0, 0.2)), side * float(far))
        if space.put(item, x, y, float(rng.uniform(0, 360)), mats=False):
            return


def _built_in(space: _Room) -> list[Mirror]:
    """Closets, mirrored wardrobes and tall mirrors of a room's hazards; they come first."""
    room = space.room
    mirrors: list[Mirror] = []
    for k, hazard in enumerate(space.home.hazards):
        if hazard.at != room.index or hazard.kind not in ("mirror", "closet"):
            continue
        rng = np.random.default_rng([0xB17, space.home.seed, k])
        own, space.rng = space.rng, rng
        if hazard.kind == "closet":
            space.against_wall(clutter.closet(rng), 40)
        elif space.against_wall(furniture.wardrobe(rng), 40):
            mirrors.append(_front(space.placed[-1], rng))
        space.rng = own
    return mirrors


def _front(wardrobe: Placed, rng: Rng) -> Mirror:
    """A mirror over a wardrobe's doors, or over one of them."""
    w, d, h = wardrobe.item.size
    whole = rng.random() < 0.6 or w < 1.2
    width, aside = (w - 0.06, 0.0) if whole else (w / 2 - 0.04, float(rng.choice([-1, 1])) * w / 4)
    yaw = np.radians(wardrobe.yaw_deg)
    forward = d / 2 + 0.045  # before the handles
    x = wardrobe.x + aside * np.cos(yaw) - forward * np.sin(yaw)
    y = wardrobe.y + aside * np.sin(yaw) + forward * np.cos(yaw)
    return Mirror(
        float(x), float(y), h / 2 + 0.02, wardrobe.yaw_deg, width, h - 0.12, wardrobe.room
    )


def _in_doorways(home: Home, room: Room) -> list[Placed]:
    """People, pets and small things on the sill of a doorway, or just before it."""
    out = []
    for k, hazard in enumerate(home.hazards):
        if hazard.kind not in ("person", "pet", "clutter"):
            continue
        portal = home.portals[hazard.at]
        if room.index != max(portal.rooms):
            continue
        rng = np.random.default_rng([0xD00, home.seed, k])
        low, high = portal.free
        middle = (low + high) / 2
        if hazard.kind == "clutter":
            for side in (-1, 1):
                across = side * (home.wall_m / 2 + float(rng.uniform(0.3, 1.0)))
                thing = (clutter.cable, clutter.toys)[int(rng.integers(2))](rng)
                x, y = portal.point(middle + float(rng.normal(0, 0.12)), across)
                out.append(Placed(thing, x, y, float(rng.uniform(0, 360)), room.index))
            continue
        somebody = clutter.person(rng) if hazard.kind == "person" else clutter.pet(rng)
        spread = max((high - low) / 2 - 0.3, 0.02)
        along = middle + float(rng.uniform(-spread, spread)) / 2
        x, y = portal.point(along, float(rng.uniform(-0.05, 0.05)))
        out.append(Placed(somebody, x, y, float(rng.uniform(0, 360)), room.index))
    return out


def furnish(home: Home) -> Furnished:
    """Everything in a home, from the home's seed."""
    rng = np.random.default_rng([0xF0, home.seed])
    standing: list[Placed] = []
    hung: list[Placed] = []
    mirrors: list[Mirror] = []
    rugs: list[Rug] = []
    full = rng.uniform(0.65, 1.35)
    for room in home.rooms:
        space = _Room(home, room, rng)
        mirrors += _built_in(space)
        for make, chance in ROOMS.get(room.kind, ()):
            if rng.random() < chance * full:
                put = space.inside if make in _FREE else space.against_wall
                put(make(rng))
        for portal in home.portals_of(room.index):
            if portal.is_open and rng.random() < 0.2:
                _block(space, rng, portal)
        for _ in range(int(rng.poisson(2.0 * full))):
            item = clutter.SMALL[int(rng.integers(len(clutter.SMALL)))](rng)
            if rng.random() < 0.6:
                space.against_wall(item, 5)
            else:
                space.inside(item, 4, yaw=float(rng.uniform(0, 360)))
        if rng.random() < 0.13:
            space.inside(clutter.person(rng), 5, mats=False, yaw=float(rng.uniform(0, 360)))
        space.placed += _in_doorways(home, room)
        more, glass = _decorate(space, rng, 3 - len(mirrors))
        hung += more
        mirrors += glass
        standing += space.placed
        for x, y in room.lamps:
            low = rng.random() < 0.35 and room.kind not in ("bath", "corridor", "store")
            lamp = (clutter.pendant if low else clutter.ceiling_disc)(rng)
            hung.append(Placed(lamp, x, y, 0.0, room.index, home.ceiling_m))
        stepped = any(f.room == room.index for f in home.flights)
        if room.kind in RUGGED and rng.random() < 0.5 and not stepped:
            w = (room.x1 - room.x0) * rng.uniform(0.3, 0.6)
            d = (room.y1 - room.y0) * rng.uniform(0.3, 0.6)
            cx, cy = room.centre
            rugs.append(Rug(cx, cy, 0.0, w, d, room.index, int(rng.integers(4))))
    curtains = []
    for portal in home.portals:
        if portal.state in ("window", "sliding_open", "sliding_closed"):
            index = max(portal.rooms)
            side = portal.side(index)
            if portal.sill > 0.5 and rng.random() < 0.6:
                x, y = portal.point(0.0, side * home.wall_m / 2)
                yaw = YAW_OF_SIDE[2 * portal.axis + (side < 0)]
                unit = clutter.radiator(rng, min(portal.width, 1.2))
                rect = footprint(unit, x, y, yaw)
                if not any(overlap(rect, footprint(p.item, p.x, p.y, p.yaw_deg)) for p in standing):
                    hung.append(Placed(unit, x, y, yaw, index, 0.12))
            if rng.random() < 0.55:
                curtains.append((portal, index))
    return Furnished(
        home, tuple(standing), tuple(hung), tuple(mirrors), tuple(rugs), tuple(curtains)
    )
