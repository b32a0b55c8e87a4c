"""Doorways, and what resembles them, built into the walls of a room of known geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.lab.train.doornet.data.compose import ComposeConfig, _warped, compose
from doorway3ds.lab.train.doornet.data.holes import (
    DOOR,
    FLOOR,
    WALL,
    WINDOW,
    Hole,
    Plane,
    Size,
    column_at,
    cut,
    fit_plane,
    free_edges,
    horizon,
    rays_of,
    sill_seen,
    way_to,
)
from doorway3ds.lab.train.doornet.data.samples import Sample

WIDTH, HEIGHT, FOCAL = 352, 264, 290.0
CAMERA_M = 1.3


def room(place: str, wall_m: float, pitch: float = 0.0, seed: int = 0) -> Sample:
    """A wall across the view, `wall_m` ahead, on a floor; pitch: camera down, in radians."""
    rng = np.random.default_rng(seed)
    v = np.mgrid[0:HEIGHT, 0:WIDTH][0]
    y = (v - HEIGHT / 2 + 0.5) / FOCAL
    down, ahead = y * np.cos(pitch) + np.sin(pitch), np.cos(pitch) - y * np.sin(pitch)
    to_wall = wall_m / ahead
    to_floor = np.where(down > 1e-6, CAMERA_M / np.maximum(down, 1e-6), np.inf)
    depth = np.minimum(to_wall, to_floor)
    classes = np.where(to_floor < to_wall, FLOOR, WALL).astype(np.uint8)
    image = rng.integers(30, 220, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    return Sample(
        name=f"{place}.jpg",
        source="nyu",
        place=place,
        image=image,
        camera=(FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2),
        open=0,
        spans=(),
        depth_m=depth.astype(np.float32),
        segments=classes,
    )


def leaf() -> Sample:
    image = np.full((352, 264, 3), (140, 90, 60), np.uint8)
    return Sample(
        "closed.jpg", "doors", "d", image, (211.0, 211.0, 131.5, 175.5), 0, (),
        extra={"leaf": (0.2, 0.1, 0.8, 1.0)},
    )  # fmt: skip


@pytest.mark.parametrize("pitch", [0.0, 0.15, -0.05])
def test_planes_are_found_from_depth(pitch: float) -> None:
    sample = room("a", 5.0, pitch)
    rng = np.random.default_rng(0)
    wall = fit_plane(sample, sample.segments == WALL, rng)
    floor = fit_plane(sample, sample.segments == FLOOR, rng)
    assert wall is not None
    assert floor is not None
    np.testing.assert_allclose(1 / np.linalg.norm(wall.normal), 5.0, rtol=1e-3)
    np.testing.assert_allclose(1 / np.linalg.norm(floor.normal), CAMERA_M, rtol=1e-3)
    np.testing.assert_allclose(floor.unit, [0, np.cos(pitch), np.sin(pitch)], atol=2e-3)
    np.testing.assert_allclose(
        wall.depth(rays_of(sample))[10, 20], sample.depth_m[10, 20], rtol=1e-3
    )


def test_a_region_of_two_depths_is_no_plane() -> None:
    sample = room("a", 3.0)
    rng = np.random.default_rng(0)
    rough = np.random.default_rng(1).uniform(1, 6, (HEIGHT, WIDTH)).astype(np.float32)
    sample = replace(sample, depth_m=rough)
    assert fit_plane(sample, sample.segments == WALL, rng) is None


@pytest.mark.parametrize("pitch", [0.0, 0.12])
def test_the_horizon_follows_the_pitch(pitch: float) -> None:
    want = (HEIGHT - 1) / 2 - FOCAL * np.tan(pitch)
    assert horizon(room("a", 3.0, pitch)) == pytest.approx(want, abs=1.0)


@pytest.mark.parametrize("pitch", [0.0, 0.12])
def test_a_hole_has_its_size_and_stands_on_the_floor(pitch: float) -> None:
    sample = room("a", 3.0, pitch)
    for seed in range(20):
        hole = cut(sample, Size(0.9, 0.0, 2.0), np.random.default_rng(seed))
        assert hole is not None
        rays = np.column_stack([(hole.front - np.array(sample.camera[2:])) / FOCAL, np.ones(4)])
        points = rays * hole.wall.depth(rays)[:, None]
        width = np.linalg.norm(points[3] - points[0])
        height = np.linalg.norm(points[1] - points[0])
        assert (width, height) == (pytest.approx(0.9, rel=0.02), pytest.approx(2.0, rel=0.02))
        down = points @ np.array([0, np.cos(pitch), np.sin(pitch)])
        np.testing.assert_allclose(down[[0, 3]], CAMERA_M, rtol=0.02)
        assert hole.front[0, 0] < hole.front[3, 0]
        assert (hole.casing[0, 0] < hole.front[0, 0]) and (hole.casing[3, 0] > hole.front[3, 0])


def test_the_free_opening_is_what_both_faces_leave() -> None:
    square = np.array([[100.0, 200], [100, 50], [180, 50], [180, 200]])
    hole = Hole(square, square + np.array([15, 0]), square, Plane(np.array([0, 0, 1 / 3])))
    assert free_edges(hole, HEIGHT) == (115.0, 180.0)
    assert column_at(np.array([[10.0, 131.5 + 20], [30.0, 131.5 - 20]]), HEIGHT) == 20.0


def test_the_way_is_told_by_what_lies_before_the_opening() -> None:
    sample = room("a", 5.0)
    foot = float(np.argmax(sample.segments[:, 176] == FLOOR))
    square = np.array([[150.0, foot], [150, 40], [200, 40], [200, foot]])
    hole = Hole(square, square, square, Plane(np.array([0, 0, 1 / 5])))
    assert way_to(hole, 150, 200, sample) == 1
    blocked = sample.segments.copy()
    blocked[int(foot) :, 160:190] = 0
    assert way_to(hole, 150, 200, replace(sample, segments=blocked)) == 0
    some = sample.segments.copy()
    some[int(foot) : int(foot) + (HEIGHT - int(foot)) // 3] = 0
    assert way_to(hole, 150, 200, replace(sample, segments=some)) is None
    assert way_to(replace(hole, front=square + np.array([0, 90])), 150, 200, sample) is None


def test_a_sill_behind_furniture_is_not_seen() -> None:
    square = np.array([[100.0, 180], [100, 60], [180, 60], [180, 180]])
    hole = Hole(square, square, square, Plane(np.array([0, 0, 1 / 3])))
    region = np.zeros((HEIGHT, WIDTH), bool)
    region[60:180, 100:180] = True
    assert sill_seen(hole, region)
    region[150:] = False
    assert not sill_seen(hole, region)


@pytest.fixture(scope="module")
def built() -> list[Sample]:
    rooms = [room("near", 2.5), room("far", 6.0, seed=1), room("other", 5.0, 0.05, seed=2), leaf()]
    return compose(rooms, ComposeConfig(count=40), seed=3)


def test_as_many_are_built_as_asked_and_half_of_them_open(built: list[Sample]) -> None:
    assert len(built) == 40
    assert sum(s.open == 1 for s in built) == 20
    assert {s.source for s in built} == {"composed"}
    assert {s.name.split("+")[1] for s in built} >= {"open", "closed", "window", "picture"}


def test_labels_agree_with_what_was_built(built: list[Sample]) -> None:
    hosts = {"near": room("near", 2.5), "far": room("far", 6.0, seed=1)}
    hosts["other"] = room("other", 5.0, 0.05, seed=2)
    for sample in built:
        host = hosts[sample.place]
        changed = (sample.image != host.image).any(axis=2)
        middle = HEIGHT // 2
        kind = sample.name.split("+")[1]
        assert len(sample.spans) == (kind == "open")
        assert changed.any()
        if kind != "open":
            continue
        span = sample.spans[0]
        assert min(span.right, WIDTH - 1) - max(span.left, 0) > 0.02 * WIDTH
        inner = slice(max(0, round(span.left) + 3), min(WIDTH, round(span.right) - 2))
        assert changed[middle, inner].mean() > 0.95
        seen = sample.depth_m[middle, inner] - host.depth_m[middle, inner]
        # what is seen through it lies behind the wall
        assert np.nanmin(seen) > 0


def test_kinds_have_their_classes(built: list[Sample]) -> None:
    of_kind = {"closed": DOOR, "window": WINDOW}
    for sample in built:
        name = sample.name.split("+")[1]
        if name in of_kind:
            assert (sample.segments == of_kind[name]).sum() > 100


def test_the_same_seed_builds_the_same() -> None:
    rooms = [room("near", 2.5), room("far", 6.0, seed=1)]
    one, other = (compose(rooms, ComposeConfig(count=4), seed=5) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        assert (a.name, a.spans) == (b.name, b.spans)
        np.testing.assert_array_equal(a.image, b.image)


def test_passages_are_wide_and_so_are_windows() -> None:
    rooms = [room("near", 2.5), room("far", 6.0, seed=1), room("other", 5.0, 0.05, seed=2), leaf()]
    config = ComposeConfig(count=40, width_m=(0.6, 0.7), passages=1.0, passage_m=(1.6, 2.4))
    found = {False: compose(rooms, replace(config, passages=0.0), seed=3)}
    found[True] = compose(rooms, config, seed=3)
    for passages, samples in found.items():
        assert {s.name.split("+")[1] for s in samples} >= {"open", "window"}
        for sample in samples:
            kind = sample.name.split("+")[1]
            if kind == "open":
                wall_m = {"near": 2.5, "far": 6.0, "other": 5.0}[sample.place]
                span = sample.spans[0]
                wide = (span.right - span.left) * wall_m / FOCAL
                # a leaf takes up to half of it, the wall's thickness some more
                assert (0.6 < wide < 2.45) if passages else (0.2 < wide < 0.72), sample.name
            if kind == "window" and passages:
                columns = np.flatnonzero((sample.segments == WINDOW).any(axis=0))
                assert np.ptp(columns) > 0.15 * WIDTH


@pytest.mark.parametrize("far_side", [60.0, 75.0, 100.0, 150.0])
def test_a_vanishing_line_within_the_picture_does_not_matter(far_side: float) -> None:
    low, high = 132 - far_side / 2, 132 + far_side / 2
    corners = np.array([[100.0, 232], [100, 32], [150, low], [150, high]])
    warped = _warped(leaf(), np.array([0.0, 0, 1, 1]), corners, (HEIGHT, WIDTH))
    assert warped.shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_allclose(warped[132, 102:149], np.tile([140, 90, 60], (47, 1)), atol=0.5)


def test_nothing_is_built_from_nothing() -> None:
    assert compose([leaf()], ComposeConfig(count=5)) == []
    flat = replace(room("a", 3.0), depth_m=None)
    assert compose([flat], ComposeConfig(count=5)) == []
    assert compose([room("a", 3.0)], ComposeConfig()) == []
