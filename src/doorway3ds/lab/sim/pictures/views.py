"""Where images are taken from: cameras, stands and what they look at."""

from __future__ import annotations

import numpy as np

from doorway3ds.camera.model import Camera, Pose, wrapped_deg
from doorway3ds.lab.sim.homes.apartment import Portal, Room
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.render.renderer import Eye

Rng = np.random.Generator


def random_camera(rng: Rng, width: int, height: int) -> Camera:
    """Horizontal field of view 50-75 deg; half of the lenses distort, mostly as barrels."""
    hfov = rng.uniform(50, 75)
    f = width / 2 / np.tan(np.radians(hfov / 2))
    cx = (width - 1) / 2 + rng.normal(0, 0.008) * width
    cy = (height - 1) / 2 + rng.normal(0, 0.008) * height
    distortion = (0.0, 0.0, 0.0, 0.0, 0.0)
    if rng.random() < 0.5:
        k1 = rng.uniform(-0.22, 0.05)
        p1, p2 = rng.normal(0, 0.001, 2)
        distortion = (float(k1), float(-0.25 * k1 * rng.random()), float(p1), float(p2), 0.0)
    fy = f * rng.normal(1, 0.003)
    return Camera("simulated", width, height, float(f), float(fy), float(cx), float(cy), distortion)


def random_pose(rng: Rng) -> Pose:
    """NAO, Pepper, a hand-held phone or anything between 0.3 and 1.6 m."""
    kind = rng.random()
    if kind < 0.3:
        height, pitch = rng.normal(0.52, 0.02), rng.normal(3, 8)
    elif kind < 0.42:
        height, pitch = rng.normal(1.15, 0.03), rng.normal(-2, 7)
    elif kind < 0.7:
        height, pitch = rng.normal(1.35, 0.12), rng.normal(-7, 7)
    else:
        height, pitch = rng.uniform(0.3, 1.6), rng.uniform(-20, 20)
    return Pose(
        height_m=float(np.clip(height, 0.3, 1.6)),
        pitch_deg=float(np.clip(pitch, -20, 20)),
        roll_deg=float(np.clip(rng.normal(0, 1.5), -5, 5)),
    )


def low_pose(rng: Rng) -> Pose:
    """A lens 0.3 to 0.6 m over the floor, as on a small robot."""
    return Pose(
        height_m=float(rng.uniform(0.3, 0.6)),
        pitch_deg=float(np.clip(rng.normal(1, 8), -20, 20)),
        roll_deg=float(np.clip(rng.normal(0, 1), -4, 4)),
    )


def standing_place(rng: Rng, plan: Plan, room: Room, tries: int = 12) -> tuple[float, float] | None:
    margin = plan.furnished.home.wall_m / 2 + 0.22
    for _ in range(tries):
        x = rng.uniform(room.x0 + margin, max(room.x1 - margin, room.x0 + margin + 0.01))
        y = rng.uniform(room.y0 + margin, max(room.y1 - margin, room.y0 + margin + 0.01))
        if plan.free_at(x, y, 0.2):
            return float(x), float(y)
    return None


def _ahead(plan: Plan, room: Room, x: float, y: float, heading_deg: float) -> float:
    """Free metres straight ahead within the room."""
    angle = np.radians(heading_deg)
    for reach in np.arange(0.2, 8.0, 0.1):
        px, py = x + reach * np.cos(angle), y + reach * np.sin(angle)
        if not room.holds(px, py, 0.05) or not plan.free_at(px, py, 0.02):
            return float(reach)
    return 8.0


def _bearing(x: float, y: float, at: tuple[float, float]) -> float:
    return float(np.degrees(np.arctan2(at[1] - y, at[0] - x)))


def choose(rng: Rng, plan: Plan, camera: Camera, want_open: bool, tries: int = 60) -> Eye | None:
    """A stand that looks at an open doorway, or at something else with no doorway in view."""
    home = plan.furnished.home
    weight = np.sqrt([r.area for r in home.rooms])
    half = camera.hfov_deg / 2
    for _ in range(tries):
        room = home.rooms[int(rng.choice(len(home.rooms), p=weight / weight.sum()))]
        at = standing_place(rng, plan, room)
        if at is None:
            continue
        x, y = at
        portals = home.portals_of(room.index)
        doors = [p for p in portals if p.is_open]
        if want_open:
            if not doors:
                continue
            portal = doors[int(rng.integers(len(doors)))]
            aim = portal.point(0.0)
            distance = float(np.hypot(aim[0] - x, aim[1] - y))
            across = abs((x, y)[portal.axis] - portal.wall)
            if not 0.6 < distance < 7 or across / distance < rng.uniform(0.15, 0.7):
                continue
            heading = _bearing(x, y, aim) + rng.uniform(-0.9, 0.9) * half
        else:
            own = [p for p in plan.furnished.standing if p.room == room.index]
            marks = [p.point(0.0) for p in portals if not p.is_open]
            marks += [(m.x, m.y) for m in plan.furnished.mirrors if m.room == room.index] * 2
            marks += [(p.x, p.y) for p in own if p.item.size[2] > 1.2]
            marks += [p.point(0.0) for p in portals if p.state == "closed"] * 3
            heading = float(rng.uniform(0, 360))
            if marks and rng.random() < 0.8:
                heading = _bearing(x, y, marks[int(rng.integers(len(marks)))])
                heading += rng.uniform(-0.6, 0.6) * half
            if any(_in_view(p, x, y, heading, half) for p in doors):
                continue
        if _ahead(plan, room, x, y, heading) < rng.uniform(0.7, 1.4):
            continue
        return Eye(x, y, float(heading % 360), random_pose(rng))
    return None


def look_at(
    rng: Rng, plan: Plan, camera: Camera, marks: list[tuple[int, tuple[float, float]]]
) -> Eye | None:
    """A stand in a mark's room that looks at it from 0.8 to 5 m."""
    for _ in range(60):
        index, at = marks[int(rng.integers(len(marks)))]
        room = plan.furnished.home.rooms[index]
        place = standing_place(rng, plan, room)
        if place is None or not 0.8 < np.hypot(at[0] - place[0], at[1] - place[1]) < 5:
            continue
        heading = _bearing(*place, at) + rng.uniform(-0.7, 0.7) * camera.hfov_deg / 2
        return Eye(*place, float(heading % 360), random_pose(rng))
    return None


def _in_view(portal: Portal, x: float, y: float, heading: float, half: float) -> bool:
    points = [portal.point(k * portal.width / 2) for k in (-1, 0, 1)]
    return any(abs(wrapped_deg(_bearing(x, y, p) - heading)) < half + 4 for p in points)
