"""The truth of rendered pictures against geometry worked out here by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, bearing_of_pixel, grid_rays, ray_to_pixel
from doorway3ds.decide.gates import decide
from doorway3ds.decide.opening import select_opening
from doorway3ds.lab.sim.homes.apartment import Portal
from doorway3ds.lab.sim.homes.clutter import carton, person
from doorway3ds.lab.sim.homes.furnish import Mirror, Placed
from doorway3ds.lab.sim.homes.furniture import Item, wardrobe
from doorway3ds.lab.sim.homes.mesh import box
from doorway3ds.lab.sim.homes.stairs import Flight
from doorway3ds.lab.sim.pictures.truth import perfect
from doorway3ds.lab.sim.pictures.way import Way
from doorway3ds.types import Frame, Reason
from tests.lab.sim.conftest import bare, camera, doorway, level, tilted, two_rooms

pytestmark = pytest.mark.sim
Shoot = Callable[..., Any]
BARREL = (-0.18, 0.03, 0.0008, -0.0005, 0.0)


def shell_depth(eye: Any, lens: Camera, low: tuple[float, float, float],
                high: tuple[float, float, float]) -> Any:  # fmt: skip
    """Depth of the inside of a box of room from its middle, by ray casting, and the plan point."""
    rays = grid_rays(lens) @ eye.axes().T
    at = eye.lens()
    with np.errstate(divide="ignore"):
        walls = np.where(rays > 0, (np.array(high) - at) / rays, (np.array(low) - at) / rays)
    depth = walls.min(-1)
    return depth, at + depth[..., None] * rays


@pytest.mark.parametrize("distortion", [(0.0,) * 5, BARREL])
@pytest.mark.parametrize("seed", range(3))
def test_depth_is_that_of_ray_casting(shoot: Shoot, seed: int, distortion: Any) -> None:
    rng = np.random.default_rng(seed)
    eye = level(1.0 + rng.random(), 1.5 + rng.random(), rng.uniform(0, 360), **tilted(rng))
    lens = replace(camera(), distortion=distortion)
    home = two_rooms()  # no opening: the room is a closed box
    shot = shoot(bare(home), lens, eye)
    depth, point = shell_depth(eye, lens, (0.06, 0.06, 0.0), (3.94, 4.94, 2.5))
    # Skirting boards and the ceiling lamp stand proud of the box.
    lamp = np.hypot(point[..., 0] - 2.0, point[..., 1] - 2.5) < 0.6
    plain = (point[..., 2] > 0.1) & ~lamp & (point[..., 2] < 2.42)
    assert plain.mean() > 0.3
    error = np.abs(shot.depth - depth)[plain]
    assert np.quantile(error, 0.999) < 0.003
    on_floor = (
        (point[..., 2] < 1e-6)
        & (np.abs(point[..., 0] - 2) < 1.8)
        & (np.abs(point[..., 1] - 2.5) < 2.3)
    )
    assert shot.truth.floor[on_floor].all()
    assert not shot.truth.floor[point[..., 2] > 0.1].any()


@pytest.mark.parametrize("seed", range(8))
def test_opening_columns_are_where_the_jambs_project(shoot: Shoot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    portal = doorway(at=float(rng.uniform(1.5, 3.5)), width=float(rng.uniform(0.7, 1.2)))
    home = two_rooms(portal)
    x, y = float(rng.uniform(0.6, 2.4)), float(rng.uniform(1.4, 3.6))
    aim = float(np.degrees(np.arctan2(portal.at - y, 4.0 - x)))
    eye = level(x, y, aim + rng.uniform(-12, 12), float(rng.uniform(0.4, 1.5)))
    eye = replace(eye, pose=replace(eye.pose, **tilted(rng)))
    lens = replace(camera(), distortion=BARREL if seed % 2 else (0.0,) * 5)
    (opening,) = shoot(bare(home), lens, eye).truth.openings
    assert opening.cut is None
    half, row = portal.width / 2, (lens.height - 1) / 2
    # Free between both faces of the wall: the nearer limit of each jamb.
    sides = {}
    for name, end in (("left", half), ("right", -half)):
        spots = [np.array([4.0 + s * 0.06, portal.at + end]) - eye.lens()[:2] for s in (-1, 1)]
        angles = [np.degrees(np.arctan2(d[1], d[0])) - eye.heading_deg for d in spots]
        sides[name] = min(angles) if name == "left" else max(angles)
    for name, column in (("left", opening.left_px), ("right", opening.right_px)):
        seen = bearing_of_pixel(lens, eye.pose, np.array([column, row]))
        assert float(seen) == pytest.approx(sides[name], abs=0.05)
    middle = bearing_of_pixel(
        lens, eye.pose, np.array([(opening.left_px + opening.right_px) / 2, row])
    )
    assert opening.bearing_deg == pytest.approx(float(middle), abs=0.02)
    reach = (4.0 - x) / np.cos(np.radians(eye.heading_deg + opening.bearing_deg))
    assert opening.range_m == pytest.approx(reach, abs=1e-3)


def test_mirrored_rooms_have_mirrored_truth(shoot: Shoot) -> None:
    left = shoot(bare(two_rooms(doorway(at=3.1))), camera(), level(1.5, 2.5, 0.0))
    right = shoot(bare(two_rooms(doorway(at=1.9))), camera(), level(1.5, 2.5, 0.0))
    (a,), (b,) = left.truth.openings, right.truth.openings
    assert a.bearing_deg == pytest.approx(-b.bearing_deg, abs=0.01)
    assert a.left_px == pytest.approx(319 - b.right_px, abs=0.05)
    assert a.range_m == pytest.approx(b.range_m, abs=1e-3)


@pytest.mark.parametrize(("side", "heading"), [("left", -22.0), ("right", 22.0)])
def test_an_opening_cut_by_the_edge_says_which(shoot: Shoot, side: str, heading: float) -> None:
    shot = shoot(bare(two_rooms(doorway(width=1.2))), camera(hfov_deg=60), level(2.0, 2.5, heading))
    (opening,) = shot.truth.openings
    assert opening.cut == side
    edge = opening.left_px if side == "left" else opening.right_px
    assert edge == pytest.approx(-0.5 if side == "left" else 319.5)


@pytest.mark.parametrize(
    ("portal", "count"),
    [
        (doorway("no_leaf"), 1),
        (doorway("archway"), 1),
        (doorway("open", angle_deg=90.0, swing=1), 1),
        (doorway("closed"), 0),
        (doorway("closed", angle_deg=10.0), 0),
    ],
)
def test_states_that_are_open(shoot: Shoot, portal: Any, count: int) -> None:
    shot = shoot(bare(two_rooms(portal)), camera(), level(1.5, 2.3, 3.0))
    assert len(shot.truth.openings) == count
    assert shot.truth.states == (portal.state,)


def test_a_leaf_in_the_opening_leaves_the_rest(shoot: Shoot) -> None:
    free = shoot(bare(two_rooms(doorway())), camera(), level(1.5, 2.5, 0.0))
    leaf = doorway("half", angle_deg=45.0, hinge=1, swing=1)
    half = shoot(bare(two_rooms(leaf)), camera(), level(1.5, 2.5, 0.0))
    (whole,), (part,) = free.truth.openings, half.truth.openings
    assert part.right_px == pytest.approx(whole.right_px, abs=0.05)
    # The leaf's edge stands 0.9 m from its hinge at 45 deg behind the wall.
    edge = np.array([4.06 + 0.9 * np.sin(np.pi / 4), 2.95 - 0.9 * np.cos(np.pi / 4)])
    column = ray_to_pixel(camera(), np.array([2.5 - edge[1], 0.0, edge[0] - 1.5]))[0]
    assert part.left_px == pytest.approx(float(column), abs=4.0)
    assert part.left_px > whole.left_px + 20


def block(size: tuple[float, float, float]) -> Item:
    return Item("block", size, (("#808080", box(size, (0, 0, size[2] / 2))),))


@pytest.mark.parametrize(
    ("thing", "aside", "clear"),
    [
        (block((0.3, 0.3, 0.3)), 0.0, False),
        (block((0.3, 0.3, 0.3)), 0.13, False),  # covers 0.16 m of 0.28
        (block((0.3, 0.3, 0.3)), 0.17, None),  # covers 0.12 m: grazing
        (block((0.3, 0.3, 0.3)), 0.36, True),
        (block((0.3, 0.3, 0.03)), 0.0, True),  # lower than 4 cm
    ],
)
def test_the_way_is_free_by_the_footprint(
    shoot: Shoot, thing: Item, aside: float, clear: bool | None
) -> None:
    placed = Placed(thing, 2.8, 2.5 + aside, 0.0, 0)
    home = two_rooms(doorway())
    shot = shoot(bare(home, standing=(placed,)), camera(), level(1.0, 2.5, 0.0, pitch_deg=-8))
    assert shot.truth.openings[0].clear is clear


@pytest.mark.parametrize(("x", "y", "clear"), [(1.0, 2.0, True), (3.4, 0.7, None)])
def test_a_jamb_beside_the_straight_way_grazes(
    shoot: Shoot, x: float, y: float, clear: bool | None
) -> None:
    heading = float(np.degrees(np.arctan2(2.5 - y, 4.0 - x)))
    shot = shoot(bare(two_rooms(doorway())), camera(), level(x, y, heading, pitch_deg=-8))
    # From (3.4, 0.7) the near jamb's corner (3.94, 2.05) lies 0.09 m beside the way.
    assert shot.truth.openings[0].clear is clear


def test_somebody_in_the_next_room_does_not_block(shoot: Shoot) -> None:
    somebody = Placed(person(np.random.default_rng(0)), 4.6, 2.5, 90.0, 1)
    home = two_rooms(doorway(width=1.2))
    shot = shoot(bare(home, standing=(somebody,)), camera(), level(0.8, 2.5, 0.0, pitch_deg=-5))
    assert [(o.way, o.clear) for o in shot.truth.openings] == [(Way.FREE, True)]


def test_a_leaf_in_the_room_beyond_hides_nothing(shoot: Shoot) -> None:
    beyond = Portal(0, 8.0, 2.5, 0.9, 0.0, 2.05, (1, -1), "half", angle_deg=50.0, swing=-1)
    eye = level(1.5, 2.5, 0.0)
    (alone,) = shoot(bare(two_rooms(doorway())), camera(), eye).truth.openings
    (both,) = shoot(bare(two_rooms(doorway(), beyond)), camera(), eye).truth.openings
    assert both.seen == alone.seen
    assert (both.left_px, both.right_px) == (alone.left_px, alone.right_px)


def test_what_is_below_the_picture_is_unknown(shoot: Shoot) -> None:
    placed = Placed(block((0.2, 0.2, 0.2)), 1.6, 2.5, 0.0, 0)
    shot = shoot(
        bare(two_rooms(doorway()), standing=(placed,)), camera(), level(1.2, 2.5, 0.0, pitch_deg=5)
    )
    assert shot.truth.openings[0].clear is None


def test_somebody_in_front_does_not_make_two_openings(shoot: Shoot) -> None:
    somebody = Placed(person(np.random.default_rng(0)), 3.0, 2.5, 90.0, 0)
    home = two_rooms(doorway(width=1.2))
    shot = shoot(bare(home, standing=(somebody,)), camera(), level(0.8, 2.5, 0.0, pitch_deg=-5))
    (opening,) = shot.truth.openings
    assert opening.clear is False
    free = shoot(bare(home), camera(), level(0.8, 2.5, 0.0, pitch_deg=-5)).truth.openings[0]
    assert opening.left_px == pytest.approx(free.left_px, abs=0.1)
    assert opening.seen < free.seen - 0.2


def test_furniture_before_an_opening_narrows_it(shoot: Shoot) -> None:
    item = wardrobe(np.random.default_rng(1))
    placed = Placed(item, 2.6, 2.5 + item.size[0] / 2, -90.0, 0)
    home = two_rooms(doorway(width=1.2))
    (opening,) = shoot(
        bare(home, standing=(placed,)), camera(), level(0.8, 2.5, 0.0)
    ).truth.openings
    assert opening.left_px == pytest.approx(159.5, abs=6.0)


def test_a_mirror_shows_what_stands_behind_the_camera(shoot: Shoot) -> None:
    mirror = Mirror(3.9, 2.5, 1.2, 90.0, 1.2, 1.2, 0)  # faces -x
    post = Item("post", (0.2, 0.2, 2.4), (("#ff0000", box((0.2, 0.2, 2.4), (0, 0, 1.2))),))
    placed = Placed(post, 0.6, 3.4, 0.0, 0)
    eye = level(1.6, 2.5, 0.0)
    shot = shoot(bare(two_rooms(), standing=(placed,), mirrors=(mirror,)), camera(), eye)
    face = 3.9 - 0.004
    assert shot.depth[120, 160] == pytest.approx(face - 1.6, abs=0.01)
    # The post's image stands as far behind the glass as the post before it.
    image = np.array([2 * face - 0.6, 3.4])
    column = float(ray_to_pixel(camera(), np.array([2.5 - image[1], 0.0, image[0] - 1.6]))[0])
    red = shot.rgb[110:130].astype(float)
    redness = (red[..., 0] - red[..., 1:].max(-1)).mean(0)
    found = np.flatnonzero(redness > 0.5 * redness.max())
    assert redness.max() > 40
    assert found.mean() == pytest.approx(column, abs=1.5)
    assert shot.truth.openings == ()
    assert shot.truth.states == ("mirror",)


DOWN = Flight(0, 2.4, 1.9, 3.9, 3.1, 0, 5, -0.18, 0.28)


def test_a_drop_before_the_sill_blocks_and_is_no_floor(shoot: Shoot) -> None:
    home = replace(two_rooms(doorway()), flights=(DOWN,))
    shot = shoot(bare(home), camera(), level(1.0, 2.5, 0.0, pitch_deg=-12))
    assert [(o.way, o.clear) for o in shot.truth.openings] == [(Way.BLOCKED, False)]
    assert shot.truth.states == ("stairs_down", "no_leaf")
    # This ray meets the floor's plane over the hole, 2.2 m ahead, and goes on to the far wall.
    ray = (grid_rays(camera()) @ shot.eye.axes().T)[190, 160]
    at = shot.eye.lens() + shot.depth[190, 160] * ray
    assert at[0] == pytest.approx(3.9, abs=0.01)
    assert at[2] == pytest.approx(1.2 + ray[2] / ray[0] * 2.9, abs=0.01)
    assert at[2] < -0.2
    assert not shot.truth.floor[190, 160]
    assert shot.truth.floor[235, 20]  # beside the hole


def test_stairs_behind_the_sill_are_told_and_do_not_block(shoot: Shoot) -> None:
    flight = Flight(1, 4.1, 1.9, 6.5, 3.1, 0, 6, -0.18, 0.28)
    home = replace(two_rooms(doorway()), flights=(flight,))
    shot = shoot(bare(home), camera(), level(1.0, 2.5, 0.0, pitch_deg=-8))
    (opening,) = shot.truth.openings
    assert (opening.way, opening.clear, opening.beyond) == (Way.FREE, True, ("stairs_down",))


@pytest.mark.parametrize(
    ("portal", "state"),
    [
        (doorway("glass_closed", style=6), "glass_closed"),
        (doorway("curtain"), "curtain"),
        (doorway("sliding_closed", width=1.6), "sliding_closed"),
    ],
)
def test_glass_and_curtains_are_no_open_doorways(shoot: Shoot, portal: Any, state: str) -> None:
    shot = shoot(bare(two_rooms(portal)), camera(), level(1.5, 2.5, 0.0))
    assert (shot.truth.openings, shot.truth.states) == ((), (state,))
    # A pane is looked through to the far wall, 7.94 m away; a curtain hangs at the door.
    reach = shot.depth[110, 145]
    assert reach < 2.6 if state == "curtain" else reach > 6


def test_a_mirror_behind_the_wall_does_not_blacken_the_one_before_it(shoot: Shoot) -> None:
    near = Mirror(3.9, 2.5, 1.2, 90.0, 1.2, 1.2, 0)
    far = Mirror(7.9, 2.5, 1.2, 90.0, 2.4, 2.2, 1)
    alone, both = (
        shoot(bare(two_rooms(), mirrors=mirrors), camera(), level(1.6, 2.5, 0.0)).rgb[120, 160]
        for mirrors in ((near,), (near, far))
    )
    assert alone.min() > 40
    assert both.tolist() == alone.tolist()


def test_perfect_perception_decides_as_the_truth_says(shoot: Shoot) -> None:
    home = two_rooms(doorway(at=3.0))
    eye = level(1.0, 2.5, 0.0, pitch_deg=-8)
    for things, reason in (
        ((), Reason.TURN),
        ((Placed(carton(np.random.default_rng(3)), 2.6, 2.75, 0.0, 0),), Reason.BLOCKED),
    ):
        shot = shoot(bare(home, standing=things), camera(), eye)
        frame = Frame(shot.rgb, shot.camera, shot.eye.pose)
        perception = perfect(shot.truth, shot.depth)
        decision = decide(perception, select_opening(perception, frame), frame, "opening")
        assert decision.reason is reason
        assert decision.selection.bearing_deg == pytest.approx(
            shot.truth.openings[0].bearing_deg, abs=0.5
        )
