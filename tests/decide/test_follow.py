"""Staying with one doorway: the one that was turned to, with all that is known of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.camera.presets import preset
from doorway3ds.decide.follow import follow
from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import OpeningParams, columns_from_spans, select_opening
from doorway3ds.decide.scene.clearance import ClearanceParams
from doorway3ds.types import Decision, Frame, Perception, Reason
from tests.raycast import Room, render


def test_between_two_equal_doorways_it_stays_with_the_one_it_turned_to() -> None:
    camera = Camera.from_fov(320, 240, 60.0)
    frame = Frame(np.zeros((240, 320, 3), np.uint8), camera)
    # The right one is wider, so it is chosen; the left one is where the doorway should be.
    votes = columns_from_spans([(60.0, 120.0), (180.0, 290.0)], 320)
    perception = Perception(1.0, votes)
    chosen = decide(perception, select_opening(perception, frame), frame, "opening")
    left = next(o for o in chosen.selection.openings if o.bearing_deg > 0)
    assert chosen.turn_deg is not None
    assert chosen.turn_deg < 0
    followed = follow(chosen, left.bearing_deg + 3.0)
    assert followed.turn_deg == pytest.approx(left.bearing_deg)
    assert follow(chosen, None) is chosen
    assert follow(chosen, left.bearing_deg + 40.0) is chosen


@pytest.mark.parametrize(("free", "reason"), [(0.1, Reason.BLOCKED), (0.9, Reason.TURN)])
def test_what_the_network_says_of_the_way_counts_for_the_followed_doorway(
    free: float, reason: Reason
) -> None:
    camera, pose = preset("nao-v5-top", 160, 120)
    view = render(Room(aside=0.6), camera, pose)
    other = (110.0, 150.0)
    both = columns_from_spans([view.clipped, other], camera.width)
    inside = (both.left_px != other[0]) & (both.score > 0)
    votes = replace(
        both,
        score=np.where(inside, 0.6, both.score),
        clear=np.where(inside, free, 1.0),
    )
    perception = view.perception(columns=votes, depth_error=0.1)
    params = OpeningParams(clearance=ClearanceParams(vote_blocks=0.5))
    chosen: Decision = decide(
        perception, select_opening(perception, view.frame(), params), view.frame(), "opening"
    )
    followed = follow(chosen, view.middle_bearing(), params, Gates())
    assert followed.bearing_deg == pytest.approx(view.middle_bearing(), abs=2.0)
    assert followed.reason is reason
