"""The tracker on sequences of ray-cast rooms, through the real selection and gates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.camera.presets import preset
from doorway3ds.decide.gates import decide
from doorway3ds.decide.opening import columns_from_spans, select_opening
from doorway3ds.live.tracker import Tracker
from doorway3ds.types import Decision, Perception, Reason
from tests.raycast import Box, Room, render

CAMERA, POSE = preset("nao-v5-top", 160, 120)
HZ = 10


def seen(room: Room, time_s: float, rng: np.random.Generator, yaw_deg: float = 0.0) -> Decision:
    """What one noisy frame of the room says; its votes' edges are off by 3 pixels."""
    view = render(room, CAMERA, replace(POSE, yaw_deg=yaw_deg), (60, 80))
    frame = replace(view.frame(), stamp_s=time_s)
    left, right = view.clipped
    span = (left + rng.normal(0, 3), right + rng.normal(0, 3))
    depth = view.depth * rng.normal(1, 0.01, view.depth.shape)
    perception = Perception(
        float(np.clip(rng.normal(0.85, 0.1), 0.05, 0.99)),
        columns_from_spans([span], CAMERA.width),
        depth.astype(np.float32),
        view.floor.astype(np.float32),
        depth_error=0.05,
    )
    selection = select_opening(perception, frame)
    return decide(perception, selection, frame, "opening")


def closed(time_s: float, rng: np.random.Generator) -> Decision:
    open_one = seen(Room(2.0, 0.4), time_s, rng)
    votes = columns_from_spans([], CAMERA.width)
    perception = replace(open_one.perception, p_open=float(rng.uniform(0.02, 0.2)), columns=votes)
    selection = select_opening(perception, open_one.frame)
    return decide(perception, selection, open_one.frame, "opening")


def test_a_walk_towards_a_doorway_that_is_blocked_freed_and_closed() -> None:
    rng = np.random.default_rng(11)
    tracker = Tracker()
    time_s = 0.0
    raw_errors, errors, reasons = [], [], []
    for step in range(40):
        time_s = step / HZ
        room = Room(3.2 - 0.3 * time_s, 0.4)
        tracked = tracker.update(seen(room, time_s, rng))
        truth = np.degrees(np.arctan2(room.middle[1], room.middle[0]))
        if step >= 10:
            raw_errors.append(tracked.raw.selection.bearing_deg - truth)
            errors.append(tracked.bearing_deg - truth)
            reasons.append(tracked.decision.reason)
            distance = float(np.hypot(*room.middle))
            # 0.25 s late at 0.3 m/s, and noise.
            assert tracked.range_m == pytest.approx(distance + 0.075, abs=0.15)
    assert set(reasons) == {Reason.TURN}
    assert np.std(errors) < 0.6 * np.std(raw_errors)
    assert np.mean(errors) == pytest.approx(np.mean(raw_errors), abs=0.5)

    room = Room(2.0, 0.4, boxes=(Box(1.0, 0.2, (0.3, 0.3), 0.0, 0.4),))
    start = time_s
    while tracked.decision.reason is not Reason.BLOCKED:
        time_s += 1 / HZ
        tracked = tracker.update(seen(room, time_s, rng))
        assert time_s - start < 1.0
    room, start = Room(2.0, 0.4), time_s
    while tracked.decision.reason is not Reason.TURN:
        time_s += 1 / HZ
        tracked = tracker.update(seen(room, time_s, rng))
        assert time_s - start < 1.5
    assert tracked.number == 1

    start = time_s
    while tracked.decision.reason is Reason.TURN:
        time_s += 1 / HZ
        tracked = tracker.update(closed(time_s, rng))
    assert time_s - start <= 1.0 and tracked.decision.reason is Reason.LOST


def test_a_head_that_looks_about_does_not_move_the_doorway() -> None:
    rng = np.random.default_rng(12)
    tracker = Tracker()
    found = []
    for step in range(40):
        yaw = 12 * np.sin(step / 6)
        tracked = tracker.update(seen(Room(2.2, 0.5), step / HZ, rng, yaw))
        if step > 5:
            found.append(tracked.bearing_deg)
    assert tracked.number == 1
    assert np.ptp(found) < 4
