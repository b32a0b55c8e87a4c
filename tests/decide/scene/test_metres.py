"""Relative depth becomes metres by the floor: the truth comes back whatever scale and shift."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.decide.opening import select_opening
from doorway3ds.decide.scene.metres import FARTHEST_M, in_metres
from doorway3ds.errors import UserError
from doorway3ds.types import Perception, RelativeDepth
from tests.raycast import Box, Room, View, render

CAMERA = Camera.from_fov(640, 480, 60.9)
POSE = Pose(height_m=0.52, pitch_deg=-1.2)
ROOM = Room(distance=3.0, boxes=(Box(1.6, 0.7, (0.4, 0.4), 0.0, 0.8),))
SIZE = (120, 160)
VIEW = render(ROOM, CAMERA, POSE, SIZE)


def relative(view: View, gain: float, shift: float, shifted: bool = True) -> Perception:
    """What a network would say that gives (1 / depth - shift) / gain."""
    inverse = np.asarray((1 / view.depth - shift) / gain, np.float32)
    seen = view.perception(relative=RelativeDepth(inverse, shifted), network="net")
    return replace(seen, depth_m=None, depth_error=0.1)


def error(seen: Perception, view: View) -> float:
    """Median relative error of all depth up to the farthest that is told."""
    assert seen.depth_m is not None
    assert seen.relative is None
    near = view.depth < FARTHEST_M
    return float(np.median(np.abs(seen.depth_m / view.depth - 1)[near]))


@settings(deadline=None, max_examples=25)
@given(
    gain=st.floats(1e-3, 1e3),
    shift=st.floats(-2.0, 2.0),
    height=st.sampled_from([0.3, 0.52, 1.2]),
    pitch=st.sampled_from([-20.0, -1.2, 5.0]),
    roll=st.sampled_from([-4.0, 0.0]),
)
def test_any_scale_and_shift_give_the_same_metres(
    gain: float, shift: float, height: float, pitch: float, roll: float
) -> None:
    view = render(ROOM, CAMERA, Pose(height, pitch, roll_deg=roll), (60, 80))
    assert error(in_metres(relative(view, gain, shift), view.frame()), view) < 0.01


@pytest.mark.parametrize("gain", [0.01, 1.0, 300.0])
def test_without_a_shift_one_scale_is_left(gain: float) -> None:
    seen = relative(VIEW, gain, 0.0, shifted=False)
    assert error(in_metres(seen, VIEW.frame()), VIEW) < 0.001
    # Told as if there were no shift where there is one, the far wall is wrong.
    assert error(in_metres(relative(VIEW, gain, -0.2, False), VIEW.frame()), VIEW) > 0.02


def test_noise_and_a_mask_with_mistakes_are_borne() -> None:
    seen = relative(VIEW, 0.02, 0.1)
    assert seen.relative is not None
    assert seen.floor is not None
    rng = np.random.default_rng(1)
    noisy = seen.relative.inverse * rng.normal(1, 0.03, SIZE).astype(np.float32)
    mask = seen.floor.copy()
    mask[75:100, 60:100] = 1.0  # wall, the box and the room beyond, all said to be floor
    seen = replace(seen, relative=RelativeDepth(noisy, True), floor=mask)
    assert error(in_metres(seen, VIEW.frame()), VIEW) < 0.1


def test_a_wrong_pitch_shifts_inverse_depth_by_its_angle_over_the_height() -> None:
    wrong = replace(VIEW.frame(), pose=replace(POSE, pitch_deg=POSE.pitch_deg + 1.0))
    depth = in_metres(relative(VIEW, 0.02, 0.1), wrong).depth_m
    assert depth is not None
    ahead = np.s_[58:62, 78:82]  # across the lens' axis the shift is exact
    off = float(np.mean(1 / depth[ahead] - 1 / VIEW.depth[ahead]))
    assert off == pytest.approx(-math.radians(1) / 0.52, rel=0.1)


def test_what_is_beyond_the_line_is_far_and_what_is_unknown_stays_so() -> None:
    seen = relative(VIEW, 1.0, 0.0)
    assert seen.relative is not None
    seen.relative.inverse[0, :5] = -3.0
    seen.relative.inverse[0, 5:] = np.nan
    depth = in_metres(seen, VIEW.frame()).depth_m
    assert depth is not None
    assert depth[0, :5] == pytest.approx(FARTHEST_M)
    assert np.isnan(depth[0, 5:]).all()


@pytest.mark.parametrize("spoilt", ["no floor", "a strip of floor", "depth the wrong way round"])
def test_too_little_floor_leaves_depth_unknown_and_the_bearing_stands(spoilt: str) -> None:
    seen = relative(VIEW, 0.02, 0.1)
    assert seen.relative is not None
    assert seen.floor is not None
    if spoilt == "no floor":
        seen = replace(seen, floor=np.zeros(SIZE, np.float32))
    elif spoilt == "a strip of floor":
        strip = np.zeros(SIZE, np.float32)
        strip[-2:] = 1.0
        seen = replace(seen, floor=strip)
    else:
        seen = replace(seen, relative=RelativeDepth(-seen.relative.inverse, True))
    done = in_metres(seen, VIEW.frame())
    assert done.depth_m is not None
    assert np.isnan(done.depth_m).all()
    selection = select_opening(done, VIEW.frame())
    known = select_opening(VIEW.perception(), VIEW.frame())
    assert selection.clear is None
    assert selection.range_m is None
    # Without its range the bearing is the lens' own; this lens stands on the axis.
    assert selection.bearing_deg == pytest.approx(known.bearing_deg, abs=0.01)


def test_metres_are_left_alone() -> None:
    seen = VIEW.perception()
    assert in_metres(seen, VIEW.frame()) is seen


def test_without_a_floor_or_a_height_it_says_what_is_missing() -> None:
    seen, frame = relative(VIEW, 1.0, 0.0), VIEW.frame()
    for change, pose, part in (
        ({"floor": None}, POSE, "expected a network that marks it, as in doornet+depth-anything"),
        ({}, replace(POSE, height_m=None), "expected the lens height, got none; give --height-m"),
    ):
        with pytest.raises(UserError, match="relative depth of net becomes metres") as caught:
            in_metres(replace(seen, **change), replace(frame, pose=pose))
        assert part in str(caught.value)
        assert "\n" not in str(caught.value)
