from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from doorway3ds.camera.choice import default_camera
from doorway3ds.camera.info import read_camera_info, write_camera_info
from doorway3ds.camera.model import (
    OPTICAL,
    Camera,
    Pose,
    back_project,
    bearing_elevation,
    bearing_of_pixel,
    pixel_to_ray,
    ray_to_pixel,
    rotation,
)
from doorway3ds.camera.presets import PRESETS, preset
from doorway3ds.errors import UserError

LENS = Camera("lens", 640, 480, 520.0, 525.0, 325.5, 236.0, (-0.31, 0.12, 0.002, -0.0015, -0.02))


def pixels(camera: Camera, count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.uniform(-0.5, 0.5, (count, 2)) * [camera.width, camera.height] + [
        (camera.width - 1) / 2,
        (camera.height - 1) / 2,
    ]


def test_pixel_ray_round_trip_with_distortion():
    xy = pixels(LENS)
    assert np.abs(ray_to_pixel(LENS, 3.7 * pixel_to_ray(LENS, xy)) - xy).max() < 1e-9


def test_distortion_is_opencvs_plumb_bob():
    cv2 = pytest.importorskip("cv2")
    matrix = np.array([[LENS.fx, 0, LENS.cx], [0, LENS.fy, LENS.cy], [0, 0, 1]])
    rays = np.random.default_rng(2).uniform([-0.5, -0.4, 1], [0.5, 0.4, 1], (200, 3))
    theirs, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(LENS.distortion))
    assert np.abs(ray_to_pixel(LENS, rays) - theirs[:, 0]).max() < 1e-9


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_have_the_published_fields_of_view(name):
    published = {"nao-v5-top": (60.9, 47.6), "nao-v6-top": (56.3, 43.7), "pepper-top": (56.3, 43.7)}
    camera, pose = preset(name, 1280, 960)
    assert (camera.hfov_deg, camera.vfov_deg) == pytest.approx(published[name])
    assert (camera.width, camera.height, camera.assumed) == (1280, 960, False)
    assert pose.height_m and pose.forward_m > 0


def test_unknown_preset_names_the_known_ones():
    with pytest.raises(UserError, match="nao-v5-top"):
        preset("nao-v9", 640, 480)


def test_nao_sees_the_floor_from_where_it_is_known_to():
    camera, pose = preset("nao-v5-top", 640, 480)
    ray = pixel_to_ray(camera, (camera.cx, 479.5)) @ rotation(pose).T
    assert -pose.height_m * ray[0] / ray[2] == pytest.approx(1.12, abs=0.01)
    ray = (
        pixel_to_ray(camera, (camera.cx, 479.5))
        @ rotation(replace(pose, pitch_deg=pose.pitch_deg + 9.7)).T
    )
    assert -pose.height_m * ray[0] / ray[2] == pytest.approx(1.9, abs=0.01)


def test_scaling_keeps_rays_by_pixel_centres():
    xy = pixels(LENS)
    for factor in (0.5, 2, 1.5):
        scaled = LENS.scaled_to(int(640 * factor), int(480 * factor))
        moved = (xy + 0.5) * factor - 0.5
        assert np.abs(pixel_to_ray(scaled, moved) - pixel_to_ray(LENS, xy)).max() < 1e-9


@pytest.mark.parametrize(
    ("size", "fits"),
    [
        ((213, 160), True),  # 213.33 rounded
        ((320, 240), True),
        ((643, 480), False),
        ((640, 360), False),
        ((480, 640), False),
    ],
)
def test_another_aspect_is_refused(size, fits):
    if fits:
        assert LENS.scaled_to(*size).width == size[0]
    else:
        with pytest.raises(UserError, match="another aspect"):
            LENS.scaled_to(*size)


def test_mirroring_negates_bearings():
    xy = pixels(LENS)
    pose = Pose(0.5, pitch_deg=7, yaw_deg=-12, roll_deg=4, forward_m=0.06, left_m=0.02)
    flipped = np.column_stack([LENS.width - 1 - xy[:, 0], xy[:, 1]])
    for range_m in (None, 1.3):
        plain = bearing_of_pixel(LENS, pose, xy, range_m)
        mirror = bearing_of_pixel(LENS.mirrored(), pose.mirrored(), flipped, range_m)
        assert np.abs(plain + mirror).max() < 1e-9


def test_yaw_shifts_the_bearing_and_pitch_the_elevation():
    camera, _ = preset("nao-v5-top", 640, 480)
    xy = pixels(camera)
    level = bearing_of_pixel(camera, Pose(pitch_deg=5), xy)
    turned = bearing_of_pixel(camera, Pose(pitch_deg=5, yaw_deg=20), xy)
    assert np.abs(turned - level - 20).max() < 1e-9
    middle = pixel_to_ray(camera, (camera.cx, camera.cy))
    for pitch in (-10.0, 0.0, 15.0):
        _, elevation = bearing_elevation(middle @ rotation(Pose(pitch_deg=pitch)).T)
        assert elevation == pytest.approx(pitch)


def test_roll_puts_the_right_side_down():
    camera = Camera.from_fov(640, 480, 60)
    right = pixel_to_ray(camera, (camera.cx + 100, camera.cy)) @ rotation(Pose(roll_deg=10)).T
    assert right[2] < 0
    assert right[1] < 0


@pytest.mark.parametrize("column", [0.0, 150.0, 500.0])
def test_bearing_about_the_turning_axis(column):
    camera, pose = preset("pepper-top", 640, 480)
    pose = replace(pose, forward_m=0.3, left_m=-0.1, yaw_deg=8)
    ray = pixel_to_ray(camera, (column, 200)) @ rotation(pose).T
    point = np.array([pose.forward_m, pose.left_m]) + 1.7 * ray[:2]
    truth = math.degrees(math.atan2(point[1], point[0]))
    seen = bearing_of_pixel(camera, pose, (column, 200), np.hypot(*point))
    assert seen == pytest.approx(truth, abs=1e-9)
    far = bearing_of_pixel(camera, pose, (column, 200), 1e9)
    assert far == pytest.approx(bearing_of_pixel(camera, pose, (column, 200)), abs=1e-6)


def test_back_projection_finds_the_floor_at_any_size():
    camera, pose = preset("nao-v5-top", 640, 480)
    pose = replace(pose, pitch_deg=-9, roll_deg=3, yaw_deg=15)
    for height, width in ((48, 64), (60, 100)):
        small = camera.stretched_to(width, height)
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        down = (pixel_to_ray(small, np.stack([x, y], -1)) @ rotation(pose).T)[..., 2]
        depth = np.where(down < 0, -pose.height_m / np.minimum(down, -1e-9), np.nan)
        points = back_project(camera, pose, depth)
        assert np.nanmax(np.abs(points[..., 2])) < 1e-9
        assert np.isnan(points[..., 2]).sum() == np.isnan(depth).sum() > 0


def test_default_camera_says_where_it_comes_from():
    camera = default_camera(480, 640)
    assert camera.assumed
    assert "60.9" in camera.name
    assert camera.vfov_deg == pytest.approx(60.9)
    assert camera.fx == camera.fy
    exif = default_camera(4000, 3000, 26.0)
    assert exif.assumed
    assert "26" in exif.name
    assert exif.fx == pytest.approx(4000 * 26 / 36)


def test_camera_info_round_trip(tmp_path):
    write_camera_info(LENS, tmp_path / "camera.yaml")
    assert read_camera_info(tmp_path / "camera.yaml") == LENS


def test_camera_info_needs_no_projection_matrix(tmp_path):
    path = tmp_path / "camera.yaml"
    write_camera_info(LENS, path)
    info = yaml.safe_load(path.read_text())
    del info["rectification_matrix"], info["projection_matrix"]
    info["distortion_coefficients"]["data"].pop()
    path.write_text(yaml.safe_dump(info))
    assert read_camera_info(path) == replace(LENS, distortion=(*LENS.distortion[:4], 0.0))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"image_width": None}, "number"),
        ({"image_width": 0}, "0x480"),
        ({"camera_matrix": {"data": [1, 2, 3]}}, "9 numbers"),
        ({"camera_matrix": {"data": [0] * 9}}, "not been calibrated"),
        ({"camera_matrix": {"data": [math.nan] * 9}}, "must be fx 0 cx"),
        ({"camera_matrix": 5}, "number"),
        ({"distortion_model": "equidistant"}, "4 coefficients, got 5"),
        ({"distortion_model": "spline"}, "one of plumb_bob, rational_polynomial, equidistant"),
        ({"distortion_coefficients": {"data": [0.1] * 8}}, "5 coefficients, got 8"),
        ({"distortion_coefficients": {"data": [0.1] * 2}}, "5 coefficients, got 2"),
    ],
)
def test_a_damaged_camera_file_is_one_clear_line(tmp_path, change, says):
    path = tmp_path / "camera.yaml"
    write_camera_info(LENS, path)
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **change}))
    with pytest.raises(UserError, match=says) as caught:
        read_camera_info(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"- a", b"a: [", b"\xff\xfe\x00", b"image_width: 3"])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "camera.yaml"
    path.write_bytes(content)
    with pytest.raises(UserError, match="camera_info"):
        read_camera_info(path)
    with pytest.raises(UserError, match="cannot read"):
        read_camera_info(tmp_path / "none.yaml")


def test_pose_of_a_known_transform():
    """Yaw 90 left, then 30 up: forward is (0, cos 30, sin 30), left stays (-1, 0, 0)."""
    c, s = math.sqrt(0.75), 0.5
    transform = np.array([[0, -1, 0, 0.1], [c, 0, -s, -0.2], [s, 0, c, 1.2], [0, 0, 0, 1]])
    found = Pose.from_transform(transform)
    assert vars(found) == pytest.approx(vars(Pose(1.2, 30, 90, 0, 0.1, -0.2)))
    transform[2, 3] = 0
    assert Pose.from_transform(transform).height_m is None


@pytest.mark.parametrize(
    "pose",
    [
        Pose(0.52, -1.2, forward_m=0.059),
        Pose(1.2, pitch_deg=-17, yaw_deg=25, roll_deg=4, forward_m=0.2, left_m=-0.05),
        Pose(0.3, pitch_deg=30, yaw_deg=170, roll_deg=-90),
    ],
)
def test_a_pose_by_its_own_rotation_is_the_same(pose):
    transform = np.eye(4)
    transform[:3, :3] = rotation(pose) @ OPTICAL.T
    transform[:3, 3] = pose.forward_m, pose.left_m, pose.height_m
    assert vars(Pose.from_transform(transform)) == pytest.approx(vars(pose), abs=1e-9)
