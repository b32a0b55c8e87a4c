"""An image topic as a source, without a bus: newest only, calibrated, timed."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.ros import messages
from doorway3ds.ros.topic import TopicFrame, TopicSource
from doorway3ds.sources.base import View

pytest.importorskip("rosbags", reason="needs the extra bag")
from doorway3ds.ros.recorder import BagTypes

MAKE = BagTypes()
CAMERA = Camera.from_fov(64, 48, 70.0, name="cam")


def image(value: int, stamp_s: float = 0.0) -> Any:
    top = messages.header(MAKE, "lens", messages.time_of(MAKE, stamp_s))
    return messages.image(MAKE, top, np.full((48, 64, 3), value, np.uint8))


def info(camera: Camera = CAMERA) -> Any:
    top = messages.header(MAKE, "lens", messages.time_of(MAKE, 0.0))
    return messages.camera_info(MAKE, top, camera)


def source(clock: Callable[[], float] = lambda: 1000.0, **options: Any) -> TopicSource:
    return TopicSource("/image", View(), clock=clock, **options)


def read(found: TopicSource) -> TopicFrame:
    frame = found.read(1.0)
    assert isinstance(frame, TopicFrame)
    return frame


def test_only_the_newest_image_is_kept() -> None:
    found = source()
    found.calibrate(info())
    for value in range(100):
        found.offer(image(value, 999.9))
    assert read(found).image[0, 0, 0] == 99
    assert found.skipped == 99
    assert found.read(0.01) is None


def test_stamps_become_times_of_exposure_on_this_machine() -> None:
    found = source()
    found.calibrate(info())
    found.offer(image(1, 999.75))
    frame = read(found)
    assert time.monotonic() - frame.stamp_s == pytest.approx(0.25, abs=0.2)
    assert frame.timed and found.problem is None


@pytest.mark.parametrize("stamp_s", [0.0, 900.0, 1001.0])
def test_stamps_of_another_clock_move_nothing(stamp_s: float) -> None:
    found = source()
    found.calibrate(info())
    found.offer(image(1, stamp_s))
    assert not read(found).timed
    assert "behind the node's clock" in str(found.problem)


def test_the_first_images_wait_for_their_calibration() -> None:
    found = source()
    found.offer(image(1, 999.9))
    assert found.read(0.01) is None
    found.calibrate(info())
    found.offer(image(2, 999.9))
    frame = read(found)
    assert frame.camera.fx == CAMERA.fx and not frame.camera.assumed


def test_without_a_calibration_the_camera_is_assumed_after_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = source()
    found.offer(image(1, 999.9))
    begun = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: begun + 2.0)
    found.offer(image(2, 999.9))
    assert read(found).camera.assumed


def test_the_pose_is_asked_for_with_every_image() -> None:
    poses = iter([Pose(0.5), Pose(0.6), Pose(0.7)])
    found = source(pose=lambda message: next(poses))
    found.calibrate(info())
    for height in (0.5, 0.6):
        found.offer(image(1, 999.9))
        assert read(found).pose.height_m == height
