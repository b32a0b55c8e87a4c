from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.camera.presets import preset
from doorway3ds.decide.gates import decide
from doorway3ds.decide.opening import (
    OpeningParams,
    columns_from_spans,
    decode_columns,
    select_opening,
)
from doorway3ds.errors import UserError
from doorway3ds.networks.limits import override
from doorway3ds.types import ColumnVotes, Frame, Perception, Reason
from tests.raycast import Box, Room, View, render

NAO, NAO_POSE = preset("nao-v5-top", 160, 120)
WEBCAM = Camera("webcam", 160, 120, 118.0, 121.0, 83.5, 56.0)
WEBCAM_POSE = Pose(height_m=0.9, forward_m=0.05, left_m=0.03)


def select(view: View, **changes: object):
    return select_opening(view.perception(**changes), view.frame())


# Decoding


@pytest.mark.parametrize("width", [160, 640, 1001])
@pytest.mark.parametrize(
    "spans",
    [[(0.2, 0.43)], [(-0.1, 0.13)], [(0.81, 1.2)], [(0.5, 0.507)], [(0.05, 0.2), (0.6, 0.9)]],
)
def test_decoding_gives_back_the_spans_finer_than_a_strip(width, spans):
    truth = [(a * width, b * width) for a, b in spans]
    found = decode_columns(columns_from_spans(truth, width), width)
    assert len(found) == len(truth)
    for (left, right, score), (a, b) in zip(sorted(found), truth, strict=True):
        assert (left, right) == pytest.approx((max(a, -0.5), min(b, width - 0.5)))
        assert score == 1.0


def test_decoding_ranks_by_score_and_weighs_votes_by_it():
    votes = ColumnVotes(
        score=np.array([0.1, 0.9, 0.3, 0.0, 0.6, 0.04]),
        left_px=np.array([10.0, 11.0, 13.0, 0.0, 60.0, 0.0]),
        right_px=np.array([40.0, 42.0, 44.0, 0.0, 90.0, 99.0]),
    )
    first, second = decode_columns(votes, 100)
    assert first[:2] == pytest.approx(((1 + 9.9 + 3.9) / 1.3, (4 + 37.8 + 13.2) / 1.3))
    assert first[2] == pytest.approx((0.01 + 0.81 + 0.09) / 1.3)
    assert second == pytest.approx((60, 90, 0.6))


def test_nothing_above_the_least_score_is_no_opening():
    votes = columns_from_spans([], 640)
    assert decode_columns(votes, 640) == []
    faint = replace(votes, score=np.full(64, 0.049), right_px=votes.right_px + 50)
    assert decode_columns(faint, 640) == []


@pytest.mark.parametrize("seed", range(5))
def test_decoding_withstands_noise(seed):
    rng = np.random.default_rng(seed)
    votes = columns_from_spans([(150, 333)], 640)
    noisy = replace(votes, score=np.clip(votes.score + rng.normal(0, 0.01, 64), 0, 1))
    left, right, _ = decode_columns(noisy, 640)[0]
    assert (left, right) == pytest.approx((150, 333), abs=0.5)


# Bearing and range in synthetic rooms


@pytest.mark.parametrize(("camera", "pose"), [(NAO, NAO_POSE), (WEBCAM, WEBCAM_POSE)])
@pytest.mark.parametrize("factor", [0.5, 1, 2])
@pytest.mark.parametrize("pitch", [-10, 0, 10])
def test_bearing_in_rooms_is_within_half_a_degree(camera, pose, factor, pitch):
    camera = camera.scaled_to(int(160 * factor), int(120 * factor))
    checked = 0
    for yaw in (-25, -10, 0, 25):
        for distance, aside, turn in ((2.0, 0.0, 0), (3.2, 0.7, 15), (2.6, -0.6, -20)):
            room = Room(distance=distance, aside=aside, turn_deg=turn)
            posed = replace(pose, pitch_deg=pitch, yaw_deg=yaw)
            view = render(room, camera, posed, (60, 80))
            left, right = view.clipped
            if right - left < 0.05 * camera.width:
                continue
            found = select(view)
            assert found.bearing_deg == pytest.approx(view.middle_bearing(), abs=0.5)
            best = found.openings[0]
            assert best.left_deg > best.bearing_deg > best.right_deg
            if best.cut is None:
                assert found.range_m == pytest.approx(np.hypot(*room.middle), rel=0.08)
            checked += 1
    assert checked >= 6


def test_range_is_to_the_threshold_not_through_it():
    for beyond in (1.0, 5.0):
        found = select(render(Room(distance=2.4, aside=0.3, beyond=beyond), NAO, NAO_POSE))
        assert found.range_m == pytest.approx(math.hypot(2.4, 0.3), rel=0.01)


def test_a_head_on_doorway_is_aimed_at_in_its_metric_middle():
    for aside in (-0.8, 0.0, 0.5):
        room = Room(distance=3.0, aside=aside, thickness=0.01)
        found = select(render(room, NAO, NAO_POSE))
        assert found.bearing_deg == pytest.approx(math.degrees(math.atan2(aside, 3.0)), abs=0.1)


def test_furniture_before_one_jamb_does_not_shorten_the_range():
    crate = Box(1.1, 0.55, (0.3, 0.4), 0.0, 1.9)
    view = render(Room(distance=3.0, aside=-0.1, boxes=(crate,)), NAO, NAO_POSE)
    assert select(view).range_m == pytest.approx(3.0, rel=0.05)


def test_range_without_wall_depth_comes_from_the_floors_end():
    view = render(Room(distance=2.5), NAO, NAO_POSE)
    depth = np.where(view.floor, view.depth, np.nan).astype(np.float32)
    assert select(view, depth_m=depth).range_m == pytest.approx(2.5, rel=0.1)
    bare = np.full_like(depth, np.nan)
    assert select(view, depth_m=bare, floor=None).range_m is None


def test_a_networks_range_is_corrected_by_the_known_height():
    view = render(Room(distance=2.5), NAO, NAO_POSE)
    far = (view.depth * 1.25).astype(np.float32)
    assert select(view, depth_m=far, depth_error=0.15).range_m == pytest.approx(2.5, rel=0.05)
    unknown = replace(view, pose=replace(NAO_POSE, height_m=None))
    assert select(unknown, depth_m=far, depth_error=0.15).range_m == pytest.approx(3.1, rel=0.05)


# Properties


ROOM = Room(distance=2.7, aside=0.5, turn_deg=12, boxes=(Box(1.5, 0.25, (0.2, 0.2), 0, 0.2),))
POSED = replace(NAO_POSE, pitch_deg=-4, yaw_deg=6, roll_deg=2, left_m=0.02)


@pytest.mark.parametrize("boxes", [(), ROOM.boxes])
def test_mirroring_negates_the_bearing_and_keeps_the_rest(boxes):
    view = render(replace(ROOM, boxes=boxes), NAO, POSED)
    found = select(view)
    truth = view.perception()
    last = NAO.width - 1
    flipped = Perception(
        1.0,
        ColumnVotes(
            truth.columns.score[::-1],
            last - truth.columns.right_px[::-1],
            last - truth.columns.left_px[::-1],
        ),
        np.ascontiguousarray(truth.depth_m[:, ::-1]),
        np.ascontiguousarray(truth.floor[:, ::-1]),
    )
    frame = Frame(view.frame().image, NAO.mirrored(), POSED.mirrored())
    mirror = select_opening(flipped, frame)
    assert mirror.bearing_deg == pytest.approx(-found.bearing_deg, abs=1e-3)
    assert mirror.openings[0].left_deg == pytest.approx(-found.openings[0].right_deg, abs=1e-3)
    assert mirror.range_m == pytest.approx(found.range_m, rel=1e-3)
    assert mirror.floor_from_m == pytest.approx(found.floor_from_m, rel=0.01)
    assert mirror.clear is found.clear is (not boxes)


@pytest.mark.parametrize("factor", [0.5, 2, 4])
def test_scaling_the_picture_keeps_the_answer(factor):
    view = render(ROOM, NAO, POSED)
    found = select(view)
    camera = NAO.scaled_to(int(160 * factor), int(120 * factor))
    left, right = ((c + 0.5) * factor - 0.5 for c in view.clipped)
    frame = Frame(np.zeros((camera.height, camera.width, 3), np.uint8), camera, POSED)
    votes = columns_from_spans([(left, right)], camera.width)
    scaled = select_opening(view.perception(columns=votes), frame)
    assert scaled.bearing_deg == pytest.approx(found.bearing_deg, abs=1e-3)
    assert scaled.range_m == pytest.approx(found.range_m, rel=1e-3)
    assert scaled.clear is found.clear


@pytest.mark.parametrize("yaw", [-25.0, 8.0, 25.0])
def test_a_yawed_camera_shifts_the_bearing_by_the_yaw(yaw):
    view = render(ROOM, NAO, Pose(height_m=0.52, pitch_deg=3))
    found = select(view)
    turned = replace(view, pose=replace(view.pose, yaw_deg=yaw))
    assert select(turned).bearing_deg == pytest.approx(found.bearing_deg + yaw, abs=1e-6)
    assert select(turned).range_m == pytest.approx(found.range_m)


def test_the_same_picture_gives_the_same_answer_to_the_bit():
    view = render(ROOM, NAO, POSED)
    assert select(view).openings == select(view).openings
    one, two = (decide(view.perception(), select(view), view.frame(), "opening") for _ in range(2))
    assert one.to_dict() == two.to_dict()


def test_one_percent_of_noise_hardly_matters():
    rng = np.random.default_rng(3)
    bearings, ranges, flips, trials = [], [], 0, 0
    for room_number in range(12):
        boxes = (Box(rng.uniform(1.3, 1.8), 0.05, (0.15, 0.15), 0, 0.15),)
        room = Room(
            distance=rng.uniform(2.2, 3.5),
            aside=rng.uniform(-0.5, 0.5),
            width=rng.uniform(0.7, 1.2),
            turn_deg=rng.uniform(-20, 20),
            boxes=boxes if room_number % 2 else (),
        )
        view = render(room, NAO, NAO_POSE)
        found, truth = select(view), view.perception()
        for _ in range(12):
            votes = truth.columns
            noisy = replace(
                truth,
                columns=ColumnVotes(
                    np.clip(votes.score + rng.normal(0, 0.01, 64), 0, 1),
                    votes.left_px + rng.normal(0, 0.01 * NAO.width, 64),
                    votes.right_px + rng.normal(0, 0.01 * NAO.width, 64),
                ),
                depth_m=truth.depth_m * rng.normal(1, 0.01, view.depth.shape).astype(np.float32),
            )
            again = select_opening(noisy, view.frame())
            bearings.append(again.bearing_deg - found.bearing_deg)
            ranges.append(again.range_m / found.range_m - 1)
            flips += again.clear is not found.clear
            trials += 1
    assert 0 < np.std(bearings) <= 0.5
    assert np.std(ranges) <= 0.03
    assert flips <= 0.02 * trials


# Cut openings and doubt


@pytest.mark.parametrize(
    ("aside", "distance", "cut", "reason"),
    [
        (0.95, 2.0, "left", Reason.TURN),  # two thirds are seen: facing that middle passes
        (1.45, 2.0, "left", Reason.UNSURE),  # a sliver is seen
        (-1.45, 2.0, "right", Reason.UNSURE),
        (-0.95, 2.0, "right", Reason.TURN),
        (0.0, 0.7, "both", Reason.ALIGNED),
        (0.5, 2.5, None, Reason.TURN),
    ],
)
def test_a_doorway_cut_by_the_picture(aside, distance, cut, reason):
    room = Room(distance=distance, aside=aside, width=1.0)
    view = render(room, NAO, NAO_POSE)
    found = select(view)
    best = found.openings[0]
    assert best.cut == cut
    assert best.bearing_deg == pytest.approx(view.middle_bearing(), abs=0.5)
    decision = decide(view.perception(), found, view.frame(), "opening")
    assert decision.reason is reason
    assert decision.to_dict()["look"] == (cut if reason is Reason.UNSURE else None)
    if reason is Reason.TURN:  # straight ahead after the turn, the robot passes between the jambs
        way = np.array([math.cos(a := math.radians(decision.turn_deg)), math.sin(a)])
        hit = way * (room.distance / way[0])
        assert abs(hit[1] - room.aside) < room.width / 2 - 0.14


def test_an_edge_counts_as_cut_within_one_percent_of_the_width():
    frame = Frame(np.zeros((120, 160, 3), np.uint8), NAO, NAO_POSE)
    for left, cut in ((0.9, "left"), (1.5, None)):
        votes = columns_from_spans([(left, 70)], 160)
        assert select_opening(Perception(1.0, votes), frame).openings[0].cut == cut


def test_a_low_score_is_a_guess():
    view = render(Room(aside=-0.6), NAO, NAO_POSE)
    votes = columns_from_spans([view.clipped], 160)
    found = select(view, columns=replace(votes, score=votes.score * 0.2))
    assert found.look == "right"
    assert "0.20" in found.unsure
    assert decide(view.perception(), found, view.frame(), "opening").reason is Reason.UNSURE


def test_without_votes_or_depth_the_rest_is_still_answered():
    view = render(Room(), NAO, NAO_POSE)
    assert select(view, columns=None).unsure
    assert select(view, columns=columns_from_spans([], 160)).unsure
    found = select(view, depth_m=None, floor=None)
    assert found.bearing_deg == pytest.approx(0, abs=1e-6)
    assert (found.range_m, found.clear, found.floor_from_m) == (None, None, None)


def test_a_networks_limits_override_the_defaults():
    params = override(OpeningParams(), {"sure_score": 0.4, "clearance": {"width_m": 0.5}})
    assert (params.sure_score, params.clearance.width_m) == (0.4, 0.5)
    assert params.clearance.start_m == OpeningParams().clearance.start_m
    with pytest.raises(UserError, match="no limit 'sure'"):
        override(OpeningParams(), {"sure": 0.4})
    with pytest.raises(UserError, match="number"):
        override(OpeningParams(), {"sure_score": "high"})
