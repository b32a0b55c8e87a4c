"""Lens distortion against OpenCV's, and lenses whose polynomial turns back inside the image."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from doorway3ds.camera.info import LensWarning, read_camera_info, write_camera_info
from doorway3ds.camera.model import Camera, Pose, bearing_of_pixel, pixel_to_ray, ray_to_pixel
from doorway3ds.errors import UserError

BARREL = Camera("lens", 640, 480, 520.0, 525.0, 325.5, 236.0, (-0.31, 0.12, 0.002, -0.0015, -0.02))
# A 250x250 preview of a stereo camera: large coefficients that nearly cancel.
RATIONAL = Camera(
    "rational", 250, 250, 196.5, 196.5, 126.9, 125.8,
    (-4.86, 17.3, 0.0002, 0.001, -25.2, -4.94, 17.5, -25.3),
    distortion_model="rational_polynomial",
)  # fmt: skip
FISHEYE = Camera(
    "fisheye", 640, 480, 280.0, 281.0, 322.0, 238.0, (-0.02, 0.004, -0.003, 0.0004),
    distortion_model="equidistant",
)  # fmt: skip
LENSES = [BARREL, RATIONAL, FISHEYE]
# Fitted to the middle of wide images only: the polynomials turn back before the corners.
CORNERS_FOLD = Camera("corners", 752, 480, 554.0, 551.0, 364.0, 252.0, (-0.405, 0.267, 0, 0, -0.13))
SIDES_FOLD = Camera(
    "sides", 1280, 720, 561.6, 562.9, 641.4, 341.6, (-0.253, 0.0835, 4e-5, 2e-4, -0.01365)
)


def pixels(camera: Camera) -> np.ndarray:
    x, y = np.linspace(-0.5, camera.width - 0.5, 65), np.linspace(-0.5, camera.height - 0.5, 49)
    return np.stack(np.meshgrid(x, y), -1)


@pytest.mark.parametrize("camera", LENSES, ids=lambda c: c.name)
def test_distortion_is_opencvs(camera: Camera) -> None:
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    # The rational one has a pole outside its image.
    reach = 0.6 if camera is RATIONAL else 1.2
    rays = np.random.default_rng(2).uniform([-reach, -reach, 1], [reach, reach, 1], (200, 3))
    rays = rays[np.hypot(*rays[:, :2].T) < reach]
    coefficients, zero = np.array(camera.distortion), np.zeros(3)
    if camera.distortion_model == "equidistant":
        theirs = cv2.fisheye.projectPoints(rays[:, None], zero, zero, matrix, coefficients)[0]
    else:
        theirs = cv2.projectPoints(rays, zero, zero, matrix, coefficients)[0]
    assert np.abs(ray_to_pixel(camera, rays) - theirs.reshape(-1, 2)).max() < 1e-9


@pytest.mark.parametrize("camera", [*LENSES, CORNERS_FOLD, SIDES_FOLD], ids=lambda c: c.name)
def test_every_pixels_ray_comes_back_to_it(camera: Camera) -> None:
    xy = pixels(camera)
    assert np.abs(ray_to_pixel(camera, 2.5 * pixel_to_ray(camera, xy)) - xy).max() < 1e-6


@pytest.mark.parametrize(("camera", "share"), [(CORNERS_FOLD, 0.03), (SIDES_FOLD, 0.12)])
def test_bearings_go_on_where_a_polynomial_turns_back(camera: Camera, share: float) -> None:
    across = np.arange(camera.width, dtype=float)
    row = np.stack([across, np.full_like(across, camera.cy)], -1)
    steps = -np.diff(bearing_of_pixel(camera, Pose(), row))
    assert steps.min() > 0.3 * np.median(steps)
    assert steps.max() < 3 * np.median(steps)
    assert camera.untrusted == pytest.approx(share, abs=0.02)
    assert [lens.untrusted for lens in LENSES] == [0, 0, 0]


def test_a_lens_that_turns_back_is_named_with_its_share(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    write_camera_info(CORNERS_FOLD, path)
    with pytest.warns(LensWarning, match=r"camera\.yaml.*cannot be undone in 3\.\d% of the image"):
        assert read_camera_info(path) == CORNERS_FOLD
    # The last three of eight coefficients left out, as some advise.
    write_camera_info(
        replace(RATIONAL, distortion=RATIONAL.distortion[:5], distortion_model="plumb_bob"), path
    )
    with pytest.raises(UserError, match=r"cannot be undone in 9\d\.\d% of the image.*calibrate"):
        read_camera_info(path)
    write_camera_info(replace(BARREL, distortion=(-1e9, 0, 0, 0, 0)), path)
    with pytest.raises(UserError, match=r"cannot be undone in (99|100)"):
        read_camera_info(path)


def test_a_lens_that_sees_behind_itself_says_so(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    write_camera_info(replace(FISHEYE, fx=240.0, fy=240.0), path)
    with pytest.warns(LensWarning, match=r"more than 89\.5 deg away from its axis in 3\.\d%"):
        read_camera_info(path)


@pytest.mark.parametrize("camera", LENSES, ids=lambda c: c.name)
def test_files_keep_every_model(camera: Camera, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    write_camera_info(camera, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_camera_info(path) == camera
        # OpenCV's own habit: 14 coefficients, of which the last are not used.
        info = yaml.safe_load(path.read_text())
        info["distortion_coefficients"]["data"] += [0.0] * (14 - len(camera.distortion))
        path.write_text(yaml.safe_dump(info))
        assert read_camera_info(path) == camera


def test_without_a_model_the_number_of_coefficients_must_tell(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    for camera in (BARREL, RATIONAL, FISHEYE):
        write_camera_info(camera, path)
        info = yaml.safe_load(path.read_text())
        del info["distortion_model"]
        path.write_text(yaml.safe_dump(info))
        if camera is FISHEYE:
            with pytest.raises(UserError, match="plumb_bob or of equidistant"):
                read_camera_info(path)
        else:
            assert read_camera_info(path) == camera


ORIENT = {
    1: lambda a: a,
    2: np.fliplr,
    3: lambda a: np.rot90(a, 2),
    4: np.flipud,
    5: lambda a: np.swapaxes(a, 0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: np.rot90(np.swapaxes(a, 0, 1), 2),
    8: np.rot90,
}


@pytest.mark.parametrize("camera", LENSES, ids=lambda c: c.name)
@pytest.mark.parametrize("orientation", sorted(ORIENT))
def test_a_turned_camera_sees_the_turned_scene(camera: Camera, orientation: int) -> None:
    """The angle between the rays of two pixels is that of the same pixels of the stored image."""
    turned = camera.turned(orientation)
    index = np.arange(camera.width * camera.height).reshape(camera.height, camera.width)
    upright = ORIENT[orientation](index)
    assert upright.shape == (turned.height, turned.width)
    rows, columns = np.arange(0, turned.height, 40), np.arange(0, turned.width, 40)
    there = np.stack(np.meshgrid(columns, rows), -1)
    stored = upright[there[..., 1], there[..., 0]]
    stored = np.stack([stored % camera.width, stored // camera.width], -1)
    rays, expected = pixel_to_ray(turned, there), pixel_to_ray(camera, stored)

    def between(a: np.ndarray) -> np.ndarray:
        a = (a / np.linalg.norm(a, axis=-1, keepdims=True)).reshape(-1, 3)
        return a @ a[0]

    assert np.abs(between(rays) - between(expected)).max() < 1e-9
