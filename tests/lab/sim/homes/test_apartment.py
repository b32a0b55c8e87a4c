"""Plans and furniture: what must hold in every home."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from doorway3ds.lab.sim.homes import apartment as homes
from doorway3ds.lab.sim.homes import clutter
from doorway3ds.lab.sim.homes.clutter import cable, closet, pet, toys
from doorway3ds.lab.sim.homes.furnish import ROOMS, footprint, furnish, overlap
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.homes.shell import leaf_of
from tests.lab.sim.conftest import doorway, two_rooms

SEEDS = range(0, 60, 3)


def test_a_seed_gives_one_home() -> None:
    assert homes.generate(7) == homes.generate(7)
    assert homes.generate(7) != homes.generate(8)
    a, b = furnish(homes.generate(7)), furnish(homes.generate(7))
    assert [(p.item.name, p.x, p.y) for p in a.standing] == [
        (p.item.name, p.x, p.y) for p in b.standing
    ]


@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_tile_the_plan_and_are_all_reached(seed: int) -> None:
    home = homes.generate(seed)
    bounds = np.array([[r.x0, r.y0, r.x1, r.y1] for r in home.rooms])
    whole = np.prod(bounds[:, 2:].max(0) - bounds[:, :2].min(0))
    assert sum(r.area for r in home.rooms) == pytest.approx(whole)
    joined, doors = {0}, [p.rooms for p in home.portals if -1 not in p.rooms]
    for _ in home.rooms:
        joined |= {r for pair in doors if set(pair) & joined for r in pair}
    assert joined == set(range(len(home.rooms)))


@pytest.mark.parametrize("seed", SEEDS)
def test_portals_lie_within_the_wall_of_their_rooms(seed: int) -> None:
    home = homes.generate(seed)
    for p in home.portals:
        for index in p.rooms:
            if index < 0:
                continue
            room = home.rooms[index]
            lo, hi = (room.y0, room.y1) if p.axis == 0 else (room.x0, room.x1)
            assert lo + 0.1 < p.at - p.width / 2 < p.at + p.width / 2 < hi - 0.1
        assert p.sill < p.height < home.ceiling_m
        if p.is_open and p.state in ("open", "half"):
            assert p.angle_deg >= homes.MIN_OPEN_DEG
        if p.state == "closed":
            assert p.angle_deg < 15


def test_holes_of_one_wall_do_not_overlap() -> None:
    clashes = 0
    for seed in range(150):
        for span in homes.generate(seed).spans():
            holes = sorted((p.at - p.width / 2, p.at + p.width / 2) for p in span.holes)
            clashes += sum(b[0] < a[1] for a, b in pairwise(holes))
    assert clashes == 0


def test_every_state_occurs_and_about_half_of_the_doors_are_open() -> None:
    doors = [p for s in range(80) for p in homes.generate(s).portals if p.state != "window"]
    states = {p.state for p in doors}
    assert states == {*homes.OPEN_STATES, "closed", "sliding_closed"}
    assert 0.5 < np.mean([p.is_open for p in doors]) < 0.85


@pytest.mark.parametrize("seed", SEEDS)
def test_furniture_stands_inside_its_room_and_apart(seed: int) -> None:
    done = furnish(homes.generate(seed))
    for room in done.home.rooms:
        things = [p for p in done.standing if p.room == room.index]
        rects = [footprint(p.item, p.x, p.y, p.yaw_deg) for p in things]
        for i, a in enumerate(rects):
            assert room.x0 < a[0] and a[2] < room.x1 and room.y0 < a[1] and a[3] < room.y1
            assert not any(overlap(a, b) for b in rects[i + 1 :])


IN_ROOMS = {make for row in ROOMS.values() for make, _ in row}


@pytest.mark.parametrize("maker", sorted(IN_ROOMS
                                         | {*clutter.SMALL, *clutter.BLOCKERS}
                                         | {closet, cable, toys, pet},
                                         key=lambda m: m.__name__))  # fmt: skip
def test_meshes_fit_their_stated_size(maker: homes.Home) -> None:
    for seed in range(4):
        item = maker(np.random.default_rng(seed))  # type: ignore[operator]
        points = np.concatenate([m.vertices for _, m in item.parts])
        # Leaves, feet, a pushed-back chair and what stands on top may stick out.
        slack = 0.3 if item.name in ("plant", "person", "desk") else 0.09
        assert (np.abs(points[:, :2]).max(0) <= np.array(item.size[:2]) / 2 + slack).all()
        assert points[:, 2].min() >= -0.02
        assert points[:, 2].max() <= item.size[2] + (1.5 if item.name == "bathtub" else 0.5)
        for _, mesh in item.parts:
            assert np.isfinite(mesh.vertices).all()
            assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-6)
            assert mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)


@pytest.mark.parametrize(("hinge", "swing"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_a_leaf_turns_about_its_hinge_to_its_side(hinge: int, swing: int) -> None:
    shut = doorway("closed", hinge=hinge, swing=swing)
    wide = doorway("open", hinge=hinge, swing=swing, angle_deg=90.0)
    closed, opened = (leaf_of(two_rooms(p), p) for p in (shut, wide))
    assert closed is not None and opened is not None
    assert closed.x == pytest.approx(4.0 + swing * (0.06 - 0.02))
    assert closed.y == pytest.approx(2.5, abs=0.01)
    assert opened.x == pytest.approx(4.0 + swing * (0.06 + 0.45), abs=0.01)
    assert opened.y == pytest.approx(2.5 + hinge * (0.45 - 0.02), abs=0.01)


def test_the_plan_knows_what_stands_where() -> None:
    done = furnish(homes.generate(12))
    plan = Plan(done)
    bulky = [p for p in done.standing if p.item.name in ("wardrobe", "dresser", "fridge")]
    assert bulky
    assert not any(plan.free_at(p.x, p.y, 0.05) for p in bulky)
