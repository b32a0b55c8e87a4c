"""Lens and noise of the simulated camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.camera.model import grid_rays
from doorway3ds.lab.sim.pictures import views
from doorway3ds.lab.sim.render import sensor
from tests.lab.sim.conftest import camera

BARREL = replace(camera(), distortion=(-0.2, 0.03, 0.001, -0.001, 0.0))


def test_the_pinhole_sees_all_that_the_lens_sees() -> None:
    pinhole = sensor.pinhole_for(BARREL)
    rays = grid_rays(BARREL)
    x = rays[..., 0] * pinhole.fx + pinhole.cx
    y = rays[..., 1] * pinhole.fy + pinhole.cy
    assert x.min() >= 0 and x.max() <= pinhole.width - 1
    assert y.min() >= 0 and y.max() <= pinhole.height - 1
    plain = camera()
    assert sensor.pinhole_for(plain) is plain


def test_depth_of_a_plane_survives_the_lens() -> None:
    pinhole = sensor.pinhole_for(BARREL)
    normal, offset = np.array([0.2, 0.9, 0.3]), 1.4
    plane = (offset / (grid_rays(pinhole) @ normal)).astype(np.float32)
    plane[(plane <= 0) | (plane > 20)] = np.nan
    rgb = np.zeros((pinhole.height, pinhole.width, 3), np.uint8)
    _, seen = sensor.distort(BARREL, pinhole, rgb, plane)
    expected = offset / (grid_rays(BARREL) @ normal)
    near = (expected > 0) & (expected < 12) & ~np.isnan(seen)
    assert near.mean() > 0.5
    assert np.abs(seen / expected - 1)[near].max() < 2e-3


def test_exposure_lifts_a_dark_room_and_repeats() -> None:
    dark = np.full((60, 80, 3), 40, np.uint8)
    a = sensor.expose(np.random.default_rng(1), dark)
    assert a.mean() > 80
    assert (a == sensor.expose(np.random.default_rng(1), dark)).all()
    assert (a != sensor.expose(np.random.default_rng(2), dark)).any()


def test_cameras_and_poses_stay_within_what_is_promised() -> None:
    rng = np.random.default_rng(0)
    cameras = [views.random_camera(rng, 320, 240) for _ in range(200)]
    assert all(49 < np.degrees(2 * np.arctan(160 / c.fx)) < 76 for c in cameras)
    assert 0.35 < np.mean([any(c.distortion) for c in cameras]) < 0.65
    poses = [views.random_pose(rng) for _ in range(200)]
    heights = np.array([p.height_m for p in poses])
    assert heights.min() >= 0.3 and heights.max() <= 1.6
    assert np.mean(np.abs(heights - 0.52) < 0.06) > 0.2
    assert max(abs(p.pitch_deg) for p in poses) == pytest.approx(20, abs=2)
