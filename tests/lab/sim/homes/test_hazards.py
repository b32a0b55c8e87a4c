"""Hazards that are built into homes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.lab.sim.homes import apartment as homes
from doorway3ds.lab.sim.homes import hazards
from doorway3ds.lab.sim.homes.apartment import Hazard, Home
from doorway3ds.lab.sim.homes.furnish import footprint, furnish, overlap
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.homes.stairs import Flight, flight_parts
from doorway3ds.lab.sim.pictures.way import Way, way_to
from tests.lab.sim.conftest import bare, doorway, two_rooms

DOWN = Flight(0, 2.0, 2.0, 3.5, 3.0, 0, 5, -0.18, 0.28)


def hazardous(seed: int, *kinds: str) -> Home:
    return hazards.with_hazards(homes.generate(seed), np.random.default_rng(seed), kinds)


def test_plain_homes_have_none_and_a_seed_gives_the_same_hazards() -> None:
    home = homes.generate(3)
    assert (home.flights, home.hazards) == ((), ())
    assert hazardous(3, *hazards.KINDS) == hazardous(3, *hazards.KINDS)


@pytest.mark.parametrize("kind", hazards.KINDS)
def test_every_kind_finds_a_place_in_most_homes(kind: str) -> None:
    changed = [hazardous(seed, kind) != homes.generate(seed) for seed in range(20)]
    assert np.mean(changed) >= 0.75


@pytest.mark.parametrize("place", hazards.PLACES)
@pytest.mark.parametrize("kind", ["stairs_down", "stairs_up"])
def test_stairs_lie_in_one_room_and_furniture_keeps_off(kind: str, place: str) -> None:
    found = 0
    for seed in range(40):
        home = hazards.add_stairs(homes.generate(seed), np.random.default_rng(seed), kind, place)
        if home is None:
            continue
        found += 1
        (flight,) = home.flights
        room = home.rooms[flight.room]
        assert flight.kind == kind and flight.steps >= 3
        assert room.x0 < flight.x0 < flight.x1 < room.x1
        assert room.y0 < flight.y0 < flight.y1 < room.y1
        # Furnishing takes longest: eight homes of each kind and place will do.
        for thing in furnish(home).standing if found <= 8 else ():
            rect = footprint(thing.item, thing.x, thing.y, thing.yaw_deg)
            # Somebody may stand anywhere, but not over the steps either.
            assert thing.room != flight.room or not overlap(rect, flight.rect, -0.01)
    assert found >= 8


def test_treads_fill_the_rectangle_and_go_down() -> None:
    treads = DOWN.treads()
    assert [h for _, h in treads] == pytest.approx([-0.18, -0.36, -0.54, -0.72, -0.9])
    assert [r[0] for r, _ in treads] == pytest.approx([2.0, 2.28, 2.56, 2.84, 3.12])
    assert treads[-1][0] == (pytest.approx(3.12), 2.0, 3.5, 3.0)
    low = min(mesh.vertices[:, 2].min() for _, mesh in flight_parts(DOWN, 2.5, "#808080"))
    assert low == pytest.approx(-1.2)


@pytest.mark.parametrize(("side", "start"), [(0, (2.0, 2.5)), (1, (3.5, 2.5)), (2, (2.75, 2.0)),
                                             (3, (2.75, 3.0))])  # fmt: skip
def test_the_first_step_lies_on_its_side(side: int, start: tuple[float, float]) -> None:
    flight = Flight(0, 2.0, 2.0, 3.5, 3.0, side, 3, 0.18, 0.28)
    assert flight.start == start
    (x0, y0, x1, y1), height = flight.treads()[0]
    assert height == 0.18
    edge = (x0, x1, y0, y1)[side]
    assert edge == (start[0] if side < 2 else start[1])


@pytest.mark.parametrize(
    ("flight", "way", "told"),
    [
        (DOWN, Way.BLOCKED, ()),  # a drop before the sill
        (Flight(0, 2.0, 2.0, 3.5, 3.0, 0, 1, 0.15, 0.28), Way.BLOCKED, ()),
        (Flight(0, 2.0, 2.58, 3.5, 3.4, 0, 5, -0.18, 0.28), Way.GRAZING, ()),
        (Flight(0, 2.0, 2.75, 3.5, 3.4, 0, 5, -0.18, 0.28), Way.FREE, ()),
        (Flight(1, 4.1, 2.0, 6.0, 3.0, 0, 6, -0.18, 0.28), Way.FREE, ("stairs_down",)),
        (Flight(1, 4.5, 2.0, 6.0, 3.0, 0, 2, 0.18, 0.28), Way.FREE, ("step",)),
        (Flight(1, 6.2, 2.0, 7.5, 3.0, 0, 6, 0.18, 0.28), Way.FREE, ()),  # too far to tell
    ],
)
def test_steps_before_the_sill_block_and_those_behind_are_told(
    flight: Flight, way: Way, told: tuple[str, ...]
) -> None:
    target = doorway()
    home = replace(two_rooms(target), flights=(flight,))
    at, sill = np.array([1.0, 2.5]), np.array([4.0, 2.5])
    assert way_to(Plan(bare(home)), at, sill, target, 0.28) is way
    assert hazards.beyond(home, target, 0) == told


@pytest.mark.parametrize(("top", "way", "told"), [(0.004, Way.FREE, ()),
    (0.03, Way.FREE, ("threshold",)), (0.08, Way.BLOCKED, ("threshold",))])  # fmt: skip
def test_a_high_threshold_blocks(top: float, way: Way, told: tuple[str, ...]) -> None:
    target = doorway(sill_top_m=top)
    home = two_rooms(target)
    at, sill = np.array([1.0, 2.5]), np.array([4.0, 2.5])
    assert way_to(Plan(bare(home)), at, sill, target, 0.28) is way
    assert hazards.beyond(home, target, 0) == told


@pytest.mark.parametrize("kind", ["person", "pet"])
def test_somebody_in_a_doorway_blocks_it_from_both_rooms(kind: str) -> None:
    blocked = []
    for seed in range(12):
        target = doorway(width=0.8)
        home = replace(two_rooms(target), seed=seed, hazards=(Hazard(kind, 0),))
        plan = Plan(furnish(home))
        for x in (1.0, 7.0):
            way = way_to(plan, np.array([x, 2.5]), np.array([4.0, 2.5]), target, 0.28)
            blocked.append(way is Way.BLOCKED)
    assert np.mean(blocked) >= 0.6


def test_mirrors_cover_wardrobes_and_closets_stand_in_the_way() -> None:
    home = hazardous(0, "mirror", "closet")
    done = furnish(home)
    tall = [m for m in done.mirrors if m.height > 1.5]
    wardrobes = [p for p in done.standing if p.item.name == "wardrobe"]
    assert tall
    assert any(np.hypot(m.x - p.x, m.y - p.y) < 0.9 for m in tall for p in wardrobes)
    closets = [p for p in done.standing if p.item.name == "closet"]
    assert closets
    assert not any(Plan(done).free_at(p.x, p.y, 0.05) for p in closets)
