"""Scenes about hazards: stairs, glass doors, mirrors, and people in the doorway."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.lab.sim.homes import apartment as homes
from doorway3ds.lab.sim.homes import hazards
from doorway3ds.lab.sim.homes.apartment import Home
from doorway3ds.lab.sim.homes.furnish import furnish
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures.truth import Truth
from doorway3ds.lab.sim.pictures.views import standing_place
from doorway3ds.lab.sim.render.renderer import Eye

Rng = np.random.Generator
SCENES = {
    "stairs_down": "stairs down in view, and no open doorway",
    "stairs_up": "stairs up in view, and no open doorway",
    "glass": "a closed glass door in view, and no open doorway",
    "mirror": "a mirror as tall as a door in view, and no open doorway",
    "person": "an open doorway with a person or a pet in it",
}
STATES = {
    "stairs_down": {"stairs_down"},
    "stairs_up": {"stairs_up"},
    "glass": {"glass_closed", "sliding_closed"},
    "mirror": {"mirror"},
}
"""What the truth of a first look must name as in view."""
PET_SHARE = 0.3


def candidates(scene: str, rng: Rng, camera: Camera, pose: Pose) -> Iterator[tuple[Home, Eye]]:
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


def shows(scene: str, truth: Truth) -> bool:
    """Whether one exact image shows a scene that has no open doorway."""
    if truth.openings or truth.glimpse:
        return False
    return bool(STATES[scene] & set(truth.states[:2]))


def _home(scene: str, rng: Rng) -> tuple[Home | None, set[int]]:
    """A home with the hazard, and the rooms that it is seen from."""
    home = homes.generate(int(rng.integers(1 << 30)))
    if scene in ("stairs_down", "stairs_up"):
        place = ("corridor", "room")[int(rng.integers(2))]
        stepped = hazards.add_stairs(home, rng, scene, place)
        if stepped is None:
            return None, set()
        room = stepped.flights[-1].room
        return closed(stepped, room), {room}
    if scene == "mirror":
        home = hazards.with_hazards(home, rng, ["mirror"])
        if not home.hazards:
            return None, set()
        room = home.hazards[int(rng.integers(len(home.hazards)))].at
        return closed(home, room), {room}
    doors = [i for i, p in enumerate(home.portals) if -1 not in p.rooms and p.sill == 0]
    index = doors[int(rng.integers(len(doors)))]
    portal = home.portals[index]
    room = portal.rooms[int(rng.integers(2))]
    home = closed(home, room, keep=index)
    if scene == "glass":
        shut = replace(portal, state="closed")
        return hazards.changed(home, index, "glass", **hazards.glazed(shut)), {room}
    if not portal.is_open:
        return None, set()
    kind = "pet" if rng.random() < PET_SHARE else "person"
    return hazards.changed(home, index, kind), {room}


def closed(home: Home, room: int, keep: int = -1) -> Home:
    """The home with all open doorways of a room closed but one."""
    portals = []
    for index, portal in enumerate(home.portals):
        if room in portal.rooms and portal.is_open and index != keep:
            shut = "sliding_closed" if portal.state == "sliding_open" else "closed"
            portal = replace(portal, state=shut, angle_deg=0.0)
        portals.append(portal)
    return replace(home, portals=tuple(portals))
