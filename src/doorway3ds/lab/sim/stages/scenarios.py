"""Scenes for a robot: a home, a place to stand, and how a run there should end.

A scene is found by trying homes, doorways and stands in the order of its seed until the plan and
one exact image agree that it is one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, Pose, wrapped_deg
from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.sim.homes import apartment as homes
from doorway3ds.lab.sim.homes import hazards
from doorway3ds.lab.sim.homes.apartment import Home, Portal, Room
from doorway3ds.lab.sim.homes.furnish import Furnished, Placed, furnish
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures.truth import WIDTH_M, OpeningTruth, Truth
from doorway3ds.lab.sim.pictures.views import standing_place
from doorway3ds.lab.sim.pictures.way import SPARE_M, Way, way_to
from doorway3ds.lab.sim.render.renderer import Eye

Rng = np.random.Generator
Point = NDArray[np.float64]
Truths = Callable[[Home, Eye], Truth]
"""The exact truth of the image that a robot takes from a place in a home."""

SCENES = {
    "doorway": "an open doorway in view, the way free",
    "no_door": "a room whose doors are all closed",
    "blocked": "an open doorway with something in the way",
    "two_doors": "two open doorways in view",
    "cut": "a doorway cut by the image's edge",
    "half_open": "a doorway whose leaf stands half open",
    "distractor": "mirrors or windows in view, and no open doorway",
    "low_box": "something of at most 0.4 m in the way",
    "narrow": "a doorway of 0.5 m",
    "dark": "a doorway with the lights off",
    "tilted": "a doorway with the head raised or lowered and turned",
    "grazing": "an open doorway with something at the edge of the way",
    "stairs_down": "stairs down in view, and no open doorway",
    "stairs_up": "stairs up in view, and no open doorway",
    "glass": "a closed glass door in view, and no open doorway",
    "mirror": "a mirror as tall as a door in view, and no open doorway",
    "person": "an open doorway with a person or a pet in it",
}
ENDS = {
    **dict.fromkeys(("no_door", "distractor", "glass", "mirror"), ("no_door",)),
    **dict.fromkeys(("blocked", "low_box", "person"), ("blocked",)),
    **dict.fromkeys(("stairs_down", "stairs_up"), ("no_door", "blocked")),
    "grazing": ("aligned", "blocked"),
}
"""How a run may end; the others end aligned with the doorway."""
STATES = {
    "stairs_down": {"stairs_down"},
    "stairs_up": {"stairs_up"},
    "glass": {"glass_closed", "sliding_closed"},
    "mirror": {"mirror"},
}
"""What the truth of a first look must name as nearly the nearest thing in view."""
ALIGNED = ("aligned",)

LOW_M = 0.4
PET_SHARE = 0.3
PLAIN_OBSTACLE = 0.005  # of the image: what a person would not overlook
TRIES = 2000


@dataclass(frozen=True)
class Stage:
    """A scene, ready to be played.

    eye: where the robot stands. head: yaw and pitch (+ down) in radians.
    """

    scene: str
    seed: int
    home: Home
    eye: Eye
    head: tuple[float, float] = (0.0, 0.0)

    @property
    def ends(self) -> tuple[str, ...]:
        """The outcomes that are right."""
        return ENDS.get(self.scene, ALIGNED)


def find(scene: str, seed: int, camera: Camera, pose_of: Callable[[float, float], Pose],
         truths: Truths) -> Stage:  # fmt: skip
    """The stage of a scene's seed.

    camera: of the robot; pose_of: its pose for a head's yaw and pitch.
    Raises CallError for an unknown scene, UserError where no home has one (never seen).
    """
    if scene not in SCENES:
        raise CallError(f"expected a scene of {', '.join(SCENES)}, got {scene!r}")
    rng = np.random.default_rng([0x5CE4E, list(SCENES).index(scene), seed])
    head = (0.0, 0.0)
    if scene == "tilted":
        head = (float(np.radians(rng.uniform(-15, 15))), float(np.radians(rng.uniform(-12, 12))))
    pose = pose_of(*head)
    for home, eye in _candidates(scene, rng, camera, pose):
        if _is(scene, truths(home, eye)):
            return Stage(scene, seed, home, eye, head)
    raise UserError(f"no home among {TRIES} shows the scene {scene} for seed {seed}; try another")


def _candidates(scene: str, rng: Rng, camera: Camera, pose: Pose
                ) -> Iterator[tuple[Home, Eye]]:  # fmt: skip
    if scene in STATES or scene == "person":
        yield from islice(_at_hazards(scene, rng, camera, pose), TRIES)
        return
    half = camera.hfov_deg / 2
    for _ in range(TRIES):
        home = homes.generate(int(rng.integers(1 << 30)))
        order = list(home.portals)
        rng.shuffle(order)
        for portal in order:
            inside = [index for index in portal.rooms if index >= 0]
            if not inside or not _suits(scene, portal):
                continue
            room = home.rooms[inside[int(rng.integers(len(inside)))]]
            changed, target = _changed(scene, home, room, portal)
            stand = _stand(scene, rng, changed, room, target, pose, half)
            if stand is not None:
                yield changed, stand
                break


def _at_hazards(scene: str, rng: Rng, camera: Camera, pose: Pose) -> Iterator[tuple[Home, Eye]]:
    """Homes with the hazard and a stand that looks at it from 1.2 to 4.2 m, without end."""
    while True:
        home, rooms = _home(scene, rng)
        if home is None:
            continue
        furnished = furnish(home)
        marks = [m for m in hazards.marks(furnished) if m[0] in rooms]
        if scene == "mirror":
            tall = {(m.x, m.y) for m in furnished.mirrors if m.height > 1.5}
            marks = [m for m in marks if m[1] in tall]
        if not marks:
            continue
        plan = Plan(furnished)
        for _ in range(12):
            index, at = marks[int(rng.integers(len(marks)))]
            place = standing_place(rng, plan, home.rooms[index])
            if place is None:
                continue
            away = np.subtract(at, place)
            if not 1.2 < np.hypot(*away) < 4.2:
                continue
            off = rng.uniform(-0.45, 0.45) * camera.hfov_deg
            heading = float(np.degrees(np.arctan2(away[1], away[0]))) + off - pose.yaw_deg
            yield home, Eye(*place, heading % 360, pose)


def _home(scene: str, rng: Rng) -> tuple[Home | None, set[int]]:
    """A home with the hazard, and the rooms that it is seen from."""
    home = homes.generate(int(rng.integers(1 << 30)))
    if scene in ("stairs_down", "stairs_up"):
        place = ("corridor", "room")[int(rng.integers(2))]
        stepped = hazards.add_stairs(home, rng, scene, place)
        if stepped is None:
            return None, set()
        room = stepped.flights[-1].room
        return _closed(stepped, room), {room}
    if scene == "mirror":
        home = hazards.with_hazards(home, rng, ["mirror"])
        if not home.hazards:
            return None, set()
        room = home.hazards[int(rng.integers(len(home.hazards)))].at
        return _closed(home, room), {room}
    doors = [i for i, p in enumerate(home.portals) if -1 not in p.rooms and p.sill == 0]
    index = doors[int(rng.integers(len(doors)))]
    portal = home.portals[index]
    room = portal.rooms[int(rng.integers(2))]
    home = _closed(home, room, keep=index)
    if scene == "glass":
        shut = replace(portal, state="closed")
        return hazards.changed(home, index, "glass", **hazards.glazed(shut)), {room}
    if not portal.is_open:
        return None, set()
    kind = "pet" if rng.random() < PET_SHARE else "person"
    return hazards.changed(home, index, kind), {room}


def _closed(home: Home, room: int, keep: int = -1) -> Home:
    """The home with all open doorways of a room closed but one."""
    portals = []
    for index, portal in enumerate(home.portals):
        if room in portal.rooms and portal.is_open and index != keep:
            shut = "sliding_closed" if portal.state == "sliding_open" else "closed"
            portal = replace(portal, state=shut, angle_deg=0.0)
        portals.append(portal)
    return replace(home, portals=tuple(portals))


def _suits(scene: str, portal: Portal) -> bool:
    if scene == "distractor":
        return portal.state == "window"
    if scene == "no_door":
        return portal.state == "closed"
    if scene == "half_open":
        return portal.state in ("half", "open")
    if scene == "narrow":
        return portal.state in ("no_leaf", "archway")
    return portal.is_open and -1 not in portal.rooms


def _changed(scene: str, home: Home, room: Room, portal: Portal) -> tuple[Home, Portal]:
    """The home as the scene needs it, and the portal in it that it is about."""
    target = portal
    if scene == "half_open":
        target = replace(portal, state="half", angle_deg=40.0 + portal.angle_deg % 15.0)
    if scene == "narrow":
        target = replace(portal, state="no_leaf", width=0.5, height=min(portal.height, 2.1))
    index = home.portals.index(portal)
    shut = home if scene == "two_doors" else _closed(home, room.index, keep=index)
    portals = (*shut.portals[:index], target, *shut.portals[index + 1 :])
    rooms = home.rooms
    if scene == "dark":
        rooms = tuple(replace(r, light=tuple(0.16 * v for v in r.light)) for r in rooms)  # type: ignore[arg-type]
    return replace(home, portals=portals, rooms=rooms), target


def _stand(scene: str, rng: Rng, home: Home, room: Room, portal: Portal, pose: Pose, half: float
           ) -> Eye | None:  # fmt: skip
    """A place and heading from which the scene should be seen, by the plan alone.

    What costs nothing is asked first: furnishing a home takes longer than all the rest.
    """
    margin = home.wall_m / 2 + 0.22
    aim = _middle(portal)
    plan: Plan | None = None
    for _ in range(200):
        at = np.array([
            rng.uniform(room.x0 + margin, max(room.x1 - margin, room.x0 + margin + 0.01)),
            rng.uniform(room.y0 + margin, max(room.y1 - margin, room.y0 + margin + 0.01)),
        ])  # fmt: skip
        away = aim - at
        distance, across = float(np.hypot(*away)), abs(at[portal.axis] - portal.wall)
        if not 1.5 < distance < 4.2 or across / distance < 0.55:
            continue
        visible = float(np.degrees(np.arctan2(portal.width / 2, distance)))
        reach = max(2.0, half - visible - 2.0)
        off = rng.uniform(-reach, reach)
        if scene == "cut":
            off = rng.choice([-1.0, 1.0]) * rng.uniform(half - visible * 0.5, half + visible * 0.3)
        heading = float(np.degrees(np.arctan2(away[1], away[0]))) - off
        second = _another(home, room, portal, at, heading, half) if scene == "two_doors" else None
        if scene == "two_doors" and second is None:
            continue
        if plan is None:
            furnished = furnish(home)
            if scene == "low_box" and not _low_things(furnished, room):
                return None
            plan = Plan(furnished)
        if not plan.free_at(float(at[0]), float(at[1]), 0.2):
            continue
        if not _way_suits(scene, plan, at, portal):
            continue
        if second is not None and _way(plan, at, second) is not Way.FREE:
            continue
        return Eye(float(at[0]), float(at[1]), (heading - pose.yaw_deg) % 360, pose)
    return None


def _way(plan: Plan, at: Point, portal: Portal) -> Way:
    return way_to(plan, at, _middle(portal), portal, WIDTH_M)


def _middle(portal: Portal) -> Point:
    return np.array(portal.point(sum(portal.free) / 2))


def _way_suits(scene: str, plan: Plan, at: Point, portal: Portal) -> bool:
    ends = ENDS.get(scene, ALIGNED)
    if ends == ("no_door",):
        return True
    way = _way(plan, at, portal)
    if ends == ALIGNED:
        return way is Way.FREE
    if scene == "grazing":
        return way is Way.GRAZING
    if way is not Way.BLOCKED:
        return False
    if scene == "blocked":
        return True
    low = _low_things(plan.furnished, None)
    without = tuple(p for p in plan.furnished.standing if p not in low)
    return _way(Plan(replace(plan.furnished, standing=without)), at, portal) is Way.FREE


def _low_things(furnished: Furnished, room: Room | None) -> list[Placed]:
    return [
        p for p in furnished.standing
        if p.item.size[2] <= LOW_M and (room is None or p.room == room.index)
    ]  # fmt: skip


def _another(home: Home, room: Room, portal: Portal, at: Point, heading: float, half: float
             ) -> Portal | None:  # fmt: skip
    """A second doorway of the room that lies in view as a whole."""
    for other in home.portals_of(room.index):
        if other == portal or not other.is_open or -1 in other.rooms:
            continue
        ends = [np.array(other.point(end)) - at for end in other.free]
        off = [wrapped_deg(np.degrees(np.arctan2(y, x)) - heading) for x, y in ends]
        aim = _middle(other)
        distance = max(float(np.hypot(*(aim - at))), 1e-9)
        across = abs(at[other.axis] - other.wall) / distance
        if max(np.abs(off)) < half - 1.5 and across > 0.4 and 1.3 < distance < 5:
            return other
    return None


def _is(scene: str, truth: Truth) -> bool:
    """Whether one exact image shows the scene."""
    seen = truth.openings
    if ENDS.get(scene, ())[:1] == ("no_door",):
        shown = set(truth.states[:2]) & STATES.get(scene, set()) or scene == "no_door"
        if scene == "distractor":
            shown = {"mirror", "window"} & set(truth.states)
        return not seen and not truth.glimpse and bool(shown)
    if not seen:
        return False
    if scene in ("blocked", "low_box", "person"):
        plain = len(seen) == 1 and _plain(seen[0])
        return plain and seen[0].clear is False and seen[0].obstacle >= PLAIN_OBSTACLE
    if scene == "two_doors":
        return len(seen) >= 2 and all(_plain(o) and o.clear is True for o in seen[:2])
    if scene == "cut":
        is_cut = seen[0].cut in ("left", "right") and seen[0].clear is not False
        return len(seen) == 1 and is_cut and _wide(seen[0])
    if len(seen) != 1 or not _plain(seen[0]):
        return False
    return seen[0].way is Way.GRAZING if scene == "grazing" else seen[0].clear is True


def _wide(opening: OpeningTruth) -> bool:
    """Whether the robot passes between the jambs straight ahead."""
    left, right = opening.jambs_deg
    width = 2 * opening.range_m * np.tan(np.radians(max(left - right, 0.0) / 2))
    return bool(width >= WIDTH_M + 2 * SPARE_M)


def _plain(opening: OpeningTruth) -> bool:
    """In view as a whole, and not so hidden that a person would overlook it."""
    return opening.cut is None and opening.seen > 0.35 and opening.confidence >= 2
