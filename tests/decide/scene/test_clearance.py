from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.camera.model import Pose
from doorway3ds.camera.presets import PRESETS, preset
from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import OpeningParams, select_opening
from doorway3ds.decide.scene.clearance import ClearanceParams, label_groups, look_down, sweep
from doorway3ds.decide.scene.floor import build_scene
from doorway3ds.types import Reason
from tests.raycast import Box, Room, View, render

NAO, NAO_POSE = preset("nao-v5-top", 160, 120)
HEADS = {"level": 0.0, "raised": 10.0, "lowered": -10.0}


def select(view: View, params: OpeningParams | None = None, **changes: object):
    return select_opening(view.perception(**changes), view.frame(), params)


def cube(edge: float, distance: float, aside: float, turn_deg: float = 0.0) -> Box:
    return Box(distance + edge / 2, aside, (edge, edge), 0.0, edge, turn_deg)


def visible_in_way(view: View) -> int:
    """Pixels of the first box inside NAO's footprint, straight ahead, above the height limit."""
    p = view.points
    return np.count_nonzero((view.ids == 0) & (np.abs(p[..., 1]) < 0.14) & (p[..., 2] > 0.04))


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("edge", [0.10, 0.20, 0.30, 0.45])
def test_cubes(head, edge):
    pose = replace(NAO_POSE, pitch_deg=NAO_POSE.pitch_deg + HEADS[head])
    seen = hidden = 0
    for distance in (0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5):
        room = Room(distance=3.2)
        inside = [(0.0, 0), (0.1, 0), (-0.12 - edge / 2, 0), (0.05, 30), (-0.1, 45)]
        for aside, turn in inside:
            view = render(replace(room, boxes=(cube(edge, distance, aside, turn),)), NAO, pose)
            found = select(view)
            if visible_in_way(view) >= 3:
                assert found.clear is False
                reach = found.evidence["obstacle_m"]
                assert distance - 0.25 < reach < distance + 1.5 * edge
                seen += 1
            elif not np.any(view.ids == 0):
                # Wholly below the picture: that stretch stays unseen.
                assert found.clear is not False
                assert found.floor_from_m > distance
                hidden += 1
        for aside in (0.17 + edge / 2, -0.25 - edge / 2):
            view = render(replace(room, boxes=(cube(edge, distance, aside),)), NAO, pose)
            assert select(view).clear is not False
    assert seen >= 10
    assert hidden >= (10 if head == "raised" and edge < 0.3 else 0)


@pytest.mark.parametrize(("raise_deg", "sees_from"), [(0.0, 1.12), (9.7, 1.9)])
def test_floor_comes_into_view_where_it_is_known_to(raise_deg, sees_from):
    pose = replace(NAO_POSE, pitch_deg=NAO_POSE.pitch_deg + raise_deg)
    found = select(render(Room(distance=4.0), NAO, pose))
    assert found.clear is True
    assert found.floor_from_m - pose.forward_m == pytest.approx(sees_from, abs=0.04)


def test_unseen_floor_is_accepted_by_default_and_refused_on_demand():
    view = render(Room(distance=3.0, aside=0.5), NAO, NAO_POSE)
    found, truth = select(view), view.perception()
    answers = [
        decide(truth, found, view.frame(), "opening", Gates(max_unseen_m=limit))
        for limit in (None, 1.5, 1.0)
    ]
    assert [a.reason for a in answers] == [Reason.TURN, Reason.TURN, Reason.UNSURE]
    assert answers[2].to_dict()["look"] == "left"


def test_a_step_down_blocks_and_a_sill_does_not():
    for head in HEADS.values():
        pose = replace(NAO_POSE, pitch_deg=NAO_POSE.pitch_deg + head)
        for drop in (0.1, 0.2, 1.0):
            room = Room(distance=3.4, step=(2.2, drop), beyond=4.0)
            assert select(render(room, NAO, pose)).clear is False
    sill = Box(2.0, 0.0, (0.1, 0.9), 0.0, 0.02)
    assert select(render(Room(boxes=(sill,)), NAO, NAO_POSE)).clear is True


def test_what_hangs_above_the_head_does_not_block():
    lamp = Box(2.0, 0.0, (0.2, 0.2), 1.5, 1.8)
    shelf = Box(2.0, 0.0, (0.2, 0.2), 0.5, 0.6)
    assert select(render(Room(boxes=(lamp,)), NAO, NAO_POSE)).clear is True
    assert select(render(Room(boxes=(shelf,)), NAO, NAO_POSE)).clear is False


def test_what_stands_beyond_the_threshold_does_not_block():
    view = render(Room(distance=2.5, boxes=(cube(0.3, 2.8, 0.0),)), NAO, NAO_POSE)
    assert select(view).clear is True


def test_the_footprints_width_is_a_parameter():
    view = render(Room(boxes=(cube(0.2, 1.6, 0.35),)), NAO, NAO_POSE)
    assert select(view).clear is True
    wide = OpeningParams(clearance=ClearanceParams(width_m=0.56))
    assert select(view, wide).clear is False


def test_no_floor_in_view_is_unknown_but_an_obstacle_still_blocks():
    up = replace(NAO_POSE, pitch_deg=25.0)
    found = select(render(Room(), NAO, up))
    assert (found.clear, found.floor_from_m) == (None, None)
    tall = Room(boxes=(Box(1.5, 0.0, (0.3, 0.3), 0.0, 1.2),))
    assert select(render(tall, NAO, up)).clear is False
    handheld = render(tall, NAO, up)
    assert select(replace(handheld, pose=replace(up, height_m=None))).clear is None


def test_a_doorway_nearer_than_the_first_seen_floor_is_unknown():
    found = select(render(Room(distance=0.9), NAO, NAO_POSE))
    assert found.clear is None
    assert found.floor_from_m > found.range_m


@pytest.mark.parametrize("boxes", [(), (cube(0.2, 1.6, 0.0),)])
def test_a_hand_held_camera_leans_on_the_fit_alone(boxes):
    pose = Pose(height_m=1.3, pitch_deg=-14.0, roll_deg=3.0)
    view = render(Room(distance=3.5, boxes=boxes), NAO, pose)
    unknown = replace(view, pose=Pose())
    found = select(unknown)
    plane = found.evidence["floor_plane"]
    assert plane.height_m == pytest.approx(1.3, rel=0.01)
    assert plane.fitted
    assert found.clear is (not boxes)
    assert found.range_m == pytest.approx(3.5, rel=0.03)
    # The bearing keeps to the pose as given, a level one.
    assert found.openings[0].bearing_deg == pytest.approx(
        select(unknown, depth_m=None).bearing_deg, abs=1e-6
    )


def test_a_fit_that_contradicts_the_known_height_is_not_believed():
    view = render(Room(distance=3.0), NAO, NAO_POSE)
    table = (view.points[..., 2] > 0.5) & (view.depth < 3.2)  # the mask calls the wall floor
    found = select(view, floor=table.astype(np.float32))
    plane = found.evidence["floor_plane"]
    assert (plane.fitted, plane.height_m) == (False, 0.52)
    assert found.clear is True


def test_the_fit_survives_a_third_of_wrong_floor():
    view = render(Room(distance=3.0), NAO, NAO_POSE)
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(~view.floor & np.isfinite(view.depth))
    wrong = rng.choice(rows.size, int(view.floor.sum() / 2), replace=False)
    mask = view.floor.copy()
    mask[rows[wrong], columns[wrong]] = True
    plane = select(view, floor=mask.astype(np.float32)).evidence["floor_plane"]
    assert plane.height_m == pytest.approx(0.52, abs=0.005)
    assert plane.tilt_deg < 0.5


def test_a_small_error_of_the_pitch_is_taken_up_by_the_fit():
    view = render(Room(distance=3.0), NAO, replace(NAO_POSE, pitch_deg=-3.2))
    found = select(replace(view, pose=NAO_POSE))  # the robot says 2 deg less
    assert found.evidence["floor_plane"].tilt_deg == pytest.approx(2.0, abs=0.1)
    assert found.clear is True


def test_the_pose_tells_the_floor_where_a_networks_depth_bends_it():
    view = render(Room(distance=3.0), NAO, NAO_POSE)
    bend = np.linspace(1.3, 1.0, view.depth.shape[0])[:, None]  # the farther, the more too far
    bent = (view.depth * bend).astype(np.float32)
    true = select(view)
    found = select(view, depth_m=bent, depth_error=0.15)
    plane = found.evidence["floor_plane"]
    assert (plane.fitted, plane.tilt_deg, plane.height_m) == (False, 0.0, 0.52)
    assert found.floor_from_m == pytest.approx(true.floor_from_m, abs=1e-6)
    assert found.range_m == pytest.approx(3.0, rel=0.1)
    assert select(view, depth_m=bent).evidence["floor_plane"].fitted  # as a sensor would measure


@pytest.mark.parametrize(
    ("gain", "left"), [(0.6, 0.6), (0.8, 0.8**0.5), (1.4, 1.4**0.5), (1.6, 1.6)]
)
def test_a_networks_metres_are_brought_halfway_to_the_known_height(gain, left):
    """Beyond a factor of 1.12 and twice its error the floor is none, and the metres stand."""
    view = render(Room(distance=3.0), NAO, NAO_POSE)
    far = view.perception(depth_m=(view.depth * gain).astype(np.float32), depth_error=0.15)
    true, scene = build_scene(view.perception(), view.frame()), build_scene(far, view.frame())
    ratio = (scene.x - scene.lens[0]) / (true.x - true.lens[0])
    assert np.nanmedian(ratio) == pytest.approx(left, rel=1e-3)


def test_a_floor_that_hangs_above_the_lens_scales_nothing():
    view = render(Room(distance=3.0), NAO, NAO_POSE)
    above = (view.points[..., 2] > 0.6) & np.isfinite(view.depth)
    seen = view.perception(floor=above.astype(np.float32), depth_error=0.8)
    scene = build_scene(seen, view.frame())
    true = build_scene(view.perception(), view.frame())
    np.testing.assert_allclose(scene.x, true.x, rtol=1e-6)


def test_limits_grow_with_a_networks_error():
    low = render(Room(boxes=(cube(0.1, 1.6, 0.0),)), NAO, NAO_POSE)
    tall = render(Room(boxes=(cube(0.45, 1.6, 0.0),)), NAO, NAO_POSE)
    assert select(low).clear is False
    assert select(low, depth_error=0.2, floor=None).clear is not False
    assert select(tall, depth_error=0.2).clear is False


def test_the_floor_mask_vetoes_only_a_networks_depth():
    view = render(Room(boxes=(cube(0.45, 1.6, 0.0),)), NAO, NAO_POSE)
    all_floor = np.where(view.ids == 0, 1.0, view.floor).astype(np.float32)
    assert select(view, floor=all_floor).clear is False
    assert select(view, floor=all_floor, depth_error=0.1).clear is True


def test_what_a_network_does_not_call_floor_blocks_although_its_depth_is_flat():
    view = render(Room(boxes=(cube(0.45, 1.6, 0.0),)), NAO, NAO_POSE)
    flat = render(Room(), NAO, NAO_POSE)
    holes = np.where(view.ids == 0, 0.0, flat.floor).astype(np.float32)
    assert select(flat, floor=holes).clear is True  # true depth needs no mask
    found = select(flat, floor=holes, depth_error=0.1)
    assert found.clear is False
    assert found.evidence["obstacle_m"] == pytest.approx(1.6, abs=0.4)
    # Of a hand-held camera only the fit says where the way lies in the picture.
    held = replace(flat, pose=replace(NAO_POSE, height_m=None))
    assert select(held, floor=holes, depth_error=0.1).clear is True
    lax = OpeningParams(clearance=ClearanceParams(mask_blocks=1.1))
    assert select(flat, lax, floor=holes, depth_error=0.1).clear is True


def test_looking_down_shows_what_stands_before_the_feet():
    room = Room(boxes=(Box(0.85, 0.0, (0.2, 0.3), 0.0, 0.1),))
    down = replace(NAO_POSE, pitch_deg=NAO_POSE.pitch_deg - 10.0)
    assert select(render(room, NAO, NAO_POSE)).clear is True  # under the picture's lower edge
    for boxes, clear in (((), True), (room.boxes, False)):
        view = render(Room(boxes=boxes), NAO, down)
        for depth_error in (0.0, 0.16):
            truth = replace(view.perception(), depth_error=depth_error)
            scene = build_scene(truth, view.frame())
            assert look_down(scene, NAO, 0.0, 2.5, ClearanceParams()).clear is clear


def test_bigger_maps_are_thinned_and_keep_the_lowest_row():
    room = Room(boxes=(cube(0.2, 0.95, 0.0),))
    for size in ((60, 80), (240, 320), (480, 640), (960, 1280)):
        view = render(room, PRESETS["nao-v5-top"][0], NAO_POSE, size)
        assert visible_in_way(view) > 0
        assert select(view).clear is False


def test_evidence_for_drawing_lies_in_the_picture():
    view = render(Room(boxes=(cube(0.2, 1.6, 0.0),)), NAO, NAO_POSE)
    evidence = select(view).evidence
    corridor, obstacle = np.array(evidence["corridor_px"]), evidence["obstacle_px"]
    assert corridor.shape[1] == obstacle.shape[1] == 2
    assert corridor[:, 1].min() > 59  # the floor lies below the horizon
    assert np.all((obstacle >= 0) & (obstacle < [160, 120]))
    columns, rows = obstacle.astype(int).T
    assert np.all(view.ids[rows, columns] == 0)


def test_the_sweep_goes_along_the_bearing():
    view = render(Room(boxes=(cube(0.2, 1.5, 0.5),)), NAO, NAO_POSE)
    scene = build_scene(view.perception(), view.frame())
    params = ClearanceParams()
    side = np.degrees(np.arctan2(0.5, 1.6))
    assert sweep(scene, NAO, float(side), 2.5, params).clear is False
    assert sweep(scene, NAO, 0.0, 2.5, params).clear is True
    assert sweep(scene, NAO, float(side), 1.3, params).clear is True  # the box is farther


def test_groups_are_8_connected():
    mask = np.array(
        [
            [1, 0, 0, 1, 1, 0],
            [0, 1, 0, 0, 0, 0],
            [1, 0, 0, 1, 0, 1],
            [1, 1, 1, 1, 0, 1],
        ],
        dtype=bool,
    )
    labels, sizes = label_groups(mask)
    assert sorted(sizes.tolist()) == [2, 2, 8]
    assert labels[0, 0] == labels[1, 1] == labels[2, 0] == labels[2, 3]
    assert labels[0, 3] == labels[0, 4] != labels[2, 5]
    assert np.array_equal(labels >= 0, mask)


def test_groups_agree_with_opencv_on_random_masks():
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(5)
    for density in (0.1, 0.3, 0.5, 0.8):
        mask = rng.random((40, 50)) < density
        labels, sizes = label_groups(mask)
        count, theirs = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
        assert len(sizes) == count - 1
        pairs = {(int(a), int(b)) for a, b in zip(labels[mask], theirs[mask], strict=True)}
        assert len(pairs) == count - 1
        assert np.array_equal(np.bincount(labels[mask]), sizes)
