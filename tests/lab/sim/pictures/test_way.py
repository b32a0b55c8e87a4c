"""The way to a doorway on hand-made homes, to the centimetre."""

from __future__ import annotations

import numpy as np
import pytest

from doorway3ds.lab.sim.homes.furnish import Placed
from doorway3ds.lab.sim.homes.furniture import Item
from doorway3ds.lab.sim.homes.mesh import box
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures.way import Way, way_to
from tests.lab.sim.conftest import bare, doorway, two_rooms

WIDTH_M = 0.28
START, SILL = np.array([1.0, 2.5]), np.array([4.0, 2.5])


def cube(x: float, y: float, size: tuple[float, float, float] = (0.3, 0.3, 0.3)) -> Placed:
    item = Item("block", size, (("#808080", box(size, (0, 0, size[2] / 2))),))
    return Placed(item, x, y, 0.0, 0)


def way(*things: Placed, **portal: float) -> Way:
    target = doorway(**portal)
    return way_to(Plan(bare(two_rooms(target), standing=things)), START, SILL, target, WIDTH_M)


@pytest.mark.parametrize(
    ("aside", "expected"),
    [
        (0.0, Way.BLOCKED),
        (0.13, Way.BLOCKED),  # covers 0.16 m of 0.28
        (0.17, Way.GRAZING),  # covers 0.12 m
        (0.27, Way.GRAZING),  # touches by 2 cm
        (0.32, Way.GRAZING),  # 3 cm to spare
        (0.36, Way.FREE),  # 7 cm to spare
    ],
)
@pytest.mark.parametrize("side", [-1, 1])
def test_half_of_the_width_blocks_and_five_centimetres_to_spare_are_free(
    aside: float, side: int, expected: Way
) -> None:
    assert way(cube(2.5, 2.5 + side * aside)) is expected


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (3.5, Way.BLOCKED),
        (4.0, Way.BLOCKED),  # stands on the sill
        (4.14, Way.BLOCKED),  # reaches 1 cm over the wall's middle line
        (4.17, Way.FREE),  # in the next room
        (5.0, Way.FREE),
        (0.8, Way.FREE),  # behind the robot
    ],
)
def test_only_what_stands_before_the_sill_counts(x: float, expected: Way) -> None:
    assert way(cube(x, 2.5)) is expected


@pytest.mark.parametrize(
    ("size", "expected"),
    [
        ((0.3, 0.3, 0.03), Way.FREE),  # driven over
        ((0.3, 0.3, 0.05), Way.BLOCKED),
        ((0.05, 0.05, 1.0), Way.GRAZING),  # a post of 5 cm in the middle
    ],
)
def test_height_and_width_of_a_thing_in_the_middle(
    size: tuple[float, float, float], expected: Way
) -> None:
    assert way(cube(2.5, 2.5, size)) is expected


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (0.21, -0.21, Way.BLOCKED),  # 8 cm from each side leave 12 cm
        (0.25, -0.25, Way.GRAZING),  # 4 cm from each side leave 20 cm
    ],
)
def test_things_on_both_sides_count_together(first: float, second: float, expected: Way) -> None:
    assert way(cube(2.0, 2.5 + first), cube(3.0, 2.5 + second)) is expected


@pytest.mark.parametrize(
    ("width", "expected"), [(0.42, Way.FREE), (0.34, Way.GRAZING), (0.12, Way.BLOCKED)]
)
def test_the_jambs_count_as_well(width: float, expected: Way) -> None:
    assert way(width=width) is expected


def test_the_way_is_judged_alike_from_either_room_and_in_the_mirror() -> None:
    target = doorway()
    for thing in (cube(2.5, 2.7), cube(2.5, 2.3)):
        plan = Plan(bare(two_rooms(target), standing=(thing,)))
        assert way_to(plan, START, SILL, target, WIDTH_M) is Way.GRAZING
        other = np.array([7.0, 2.5])
        assert way_to(plan, other, SILL, target, WIDTH_M) is Way.FREE
