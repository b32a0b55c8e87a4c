"""The published numbers: Tables 3 and 4 of Sensors 2020, 20(9), 2477."""

from __future__ import annotations

import math

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.decide.gates import decide
from doorway3ds.decide.paper import pixel_to_angle, resample, select_paper, select_pixels
from doorway3ds.errors import UserError
from doorway3ds.types import Frame, Perception, Reason

TABLE_3 = [
    # Max-Pixel, its depth, Best-Pixel, its depth, free, Trigger-Pixel, printed angle, run's ends
    ((185, 194), 0.24, (185, 255), 0.23, True, (238, 255), -18.1, (191, 319)),
    ((145, 157), 0.46, (145, 201), 0.40, False, (185, 201), None, (157, 245)),
    ((120, 130), 0.50, (120, 135), 0.50, True, (238, 135), 4.8, (130, 140)),
    ((183, 73), 0.37, (183, 42), 0.32, True, (238, 42), 22.5, (0, 84)),
    ((166, 41), 0.52, (166, 39), 0.52, True, (238, 39), 23.0, (0, 78)),
    ((188, 0), 0.27, (188, 19), 0.23, True, (238, 19), 26.8, (0, 38)),
]
TABLE_4 = [(246, -16.37), (283, -23.41), (36, 23.60), (291, -24.93)]


def map_like(row) -> np.ndarray:
    """A depth map that leads to one printed row: a run that falls off from the Max-Pixel."""
    (r, c_max), max_depth, (_, c_best), best_depth, _, trigger, _, (left, right) = row
    depth = np.full((240, 320), 0.05)
    columns = np.arange(left, right + 1)
    slope = max((max_depth - best_depth) / abs(c_best - c_max), 1e-5)
    depth[r, columns] = max_depth - slope * np.abs(columns - c_max)
    down = np.arange(r + 1, 240 if trigger[0] == 238 else trigger[0] + 1)
    depth[down, c_best] = depth[r, c_best] - 0.0005 * (down - r)
    return depth


@pytest.mark.parametrize("row", TABLE_3)
def test_table_3(row):
    max_pixel, max_depth, best_pixel, best_depth, free, trigger, angle, _ = row
    found = select_pixels(map_like(row))
    assert found.max_pixel == max_pixel
    assert found.max_depth == pytest.approx(max_depth, abs=0.005)
    assert found.best_pixel == best_pixel
    assert found.best_depth == pytest.approx(best_depth, abs=0.005)
    assert found.free is free
    assert found.trigger_pixel == trigger
    if angle is not None:
        assert round(pixel_to_angle(found.best_pixel[1]), 1) == angle


@pytest.mark.parametrize(("column", "angle"), TABLE_4)
def test_table_4_needs_the_unrounded_angle(column, angle):
    assert round(pixel_to_angle(column), 2) == angle


def test_the_vertical_angle_is_up():
    assert pixel_to_angle(0, size=240, fov_deg=47.6) == pytest.approx(23.8)
    assert pixel_to_angle(185, size=240, fov_deg=47.6) == pytest.approx(-12.8917, abs=1e-4)


def test_ties_take_the_first_in_row_order_from_row_120():
    depth = np.full((240, 320), 0.2)
    depth[119, 5] = 0.9
    depth[130, 200] = depth[130, 90] = depth[150, 10] = 0.8
    assert select_pixels(depth).max_pixel == (130, 90)


def test_neighbours_must_differ_by_less_than_the_limit():
    depth = np.full((240, 320), 0.25)
    depth[200] = 0.5
    depth[200, 171:] = 0.5 - 0.0101
    depth[200, :150] = 0.5 - 0.0101
    assert select_pixels(depth).best_pixel == (200, 160)
    assert select_pixels(depth).trigger_pixel == (200, 160)


@pytest.mark.parametrize(("row", "free"), [(200, False), (201, True)])
def test_free_means_below_row_200(row, free):
    depth = np.full((240, 320), 0.5)
    depth[row + 1 :] = 0.4
    depth[120, 0] = 0.505
    assert select_pixels(depth).trigger_pixel[0] == row
    assert select_pixels(depth).free is free


@pytest.mark.parametrize("row", [238, 239])
def test_a_max_pixel_at_the_bottom_is_its_own_trigger(row):
    depth = np.full((240, 320), 0.1)
    depth[row, 77] = 0.3
    found = select_pixels(depth)
    assert found.max_pixel == found.best_pixel == found.trigger_pixel == (row, 77)
    assert found.free


def test_unknown_depth_ends_a_run_and_is_never_deepest():
    depth = np.full((240, 320), 0.3)
    depth[150, 100:111] = 0.6
    depth[150, 105] = np.nan
    assert select_pixels(depth).best_pixel == (150, 102)
    with pytest.raises(ValueError, match="no depth"):
        select_pixels(np.full((240, 320), np.nan))
    with pytest.raises(ValueError, match="240x320"):
        select_pixels(np.zeros((480, 640)))


def test_resampling_is_by_pixel_centres_and_clips():
    y, x = np.mgrid[0:480, 0:640]
    plane = 2 + 0.004 * x + 0.002 * y
    y, x = np.mgrid[0:240, 0:320]
    expected = (2 + 0.004 * (2 * x + 0.5) + 0.002 * (2 * y + 0.5)) / 10
    assert np.abs(resample(plane) - expected).max() < 1e-12
    assert resample(np.full((60, 80), 37.0)).max() == 1.0
    assert resample(np.full((240, 320), 0.01)).min() == pytest.approx(0.01)


def test_resampling_bridges_unknown_pixels():
    depth = np.full((480, 640), 4.0)
    depth[100, 100] = np.nan
    depth[200:220, 200:220] = np.nan
    out = resample(depth)
    assert out[50, 50] == pytest.approx(0.4)
    assert np.isnan(out[105, 105])


def frame_and(depth: np.ndarray | None, p_open: float = 0.9) -> tuple[Perception, Frame]:
    camera = Camera.from_fov(640, 480, 60.9, 47.6)
    frame = Frame(np.zeros((480, 640, 3), np.uint8), camera, Pose())
    return Perception(p_open, depth_m=None if depth is None else depth.astype(np.float32)), frame


@pytest.mark.parametrize("row", TABLE_3)
def test_decisions_of_table_3(row):
    perception, frame = frame_and(map_like(row) * 10)
    decision = decide(perception, select_paper(perception, frame), frame, "paper")
    answer = decision.to_dict()
    assert answer["best_pixel"] == list(row[2])
    if row[6] is None:
        assert decision.reason is Reason.BLOCKED
        assert decision.turn_deg is None
    else:
        assert decision.reason is Reason.TURN
        assert round(decision.turn_deg, 1) == row[6]
        z = row[3] * 10
        x = z * math.tan(math.radians(decision.turn_deg))
        assert answer["range_m"] == pytest.approx(math.hypot(x, z), rel=0.03)


def test_the_paper_never_says_aligned_and_holds_back_without_a_door():
    depth = np.full((240, 320), 5.0)
    perception, frame = frame_and(depth)
    selection = select_paper(perception, frame)
    decision = decide(perception, selection, frame, "paper")
    assert (decision.reason, round(decision.turn_deg, 2)) == (Reason.TURN, 0.19)
    closed, frame = frame_and(depth, p_open=0.2)
    decision = decide(closed, select_paper(closed, frame), frame, "paper")
    assert (decision.reason, decision.turn_deg, decision.bearing_deg) == (
        Reason.NO_DOOR,
        None,
        None,
    )


def test_no_depth_names_what_is_missing():
    with pytest.raises(UserError, match="depth network"):
        select_paper(*frame_and(None))
    perception, frame = frame_and(np.full((240, 320), np.nan))
    selection = select_paper(perception, frame)
    assert decide(perception, selection, frame, "paper").reason is Reason.UNSURE


@pytest.mark.parametrize(
    ("first", "last", "cut"), [(100, 140, None), (0, 60, "left"), (200, 319, "right")]
)
def test_lists_the_run_of_equal_depth_as_its_opening(
    first: int, last: int, cut: str | None
) -> None:
    depth = np.full((240, 320), 2.0, np.float32)
    depth[:, first : last + 1] = 5.0
    camera = Camera.from_fov(640, 480, 60.9)
    frame = Frame(np.zeros((480, 640, 3), np.uint8), camera)
    found = select_paper(Perception(p_open=0.9, depth_m=depth), frame)
    (opening,) = found.openings
    assert opening.bearing_deg == found.bearing_deg
    assert opening.cut == cut
    assert opening.left_deg == pytest.approx((160 - (first - 0.5)) * 60.9 / 320)
    assert opening.right_deg == pytest.approx((160 - (last + 0.5)) * 60.9 / 320)
    assert (opening.left_px, opening.right_px) == (first * 2 - 0.5, last * 2 + 1.5)
    assert opening.score == 0.9
