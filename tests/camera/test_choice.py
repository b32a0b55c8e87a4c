"""The camera of an image that its EXIF orientation turned upright."""

from __future__ import annotations

from dataclasses import replace

import pytest

from doorway3ds.camera import Camera
from doorway3ds.camera.choice import default_camera, turned_camera

SENSOR = Camera("phone", 640, 480, 560.0, 561.0, 345.0, 228.0, (-0.12, 0.05, 5e-4, -4e-4, 0.0))


def fit(width: int, height: int, _: float | None) -> Camera:
    return SENSOR.scaled_to(width, height)


@pytest.mark.parametrize(
    ("orientation", "size", "centre"),
    [
        (1, (640, 480), (345, 228)),
        (2, (640, 480), (294, 228)),
        (3, (640, 480), (294, 251)),
        (4, (640, 480), (345, 251)),
        (5, (480, 640), (228, 345)),
        (6, (480, 640), (251, 345)),
        (7, (480, 640), (251, 294)),
        (8, (480, 640), (228, 294)),
    ],
)
def test_a_file_turns_with_the_image(
    orientation: int, size: tuple[int, int], centre: tuple[float, float]
) -> None:
    camera = turned_camera(fit, *size, None, orientation)
    assert (camera.width, camera.height) == size
    assert (camera.cx, camera.cy) == pytest.approx(centre)
    half = turned_camera(fit, size[0] // 2, size[1] // 2, None, orientation)
    assert (half.cx, half.cy) == pytest.approx([(v + 0.5) / 2 - 0.5 for v in centre])


def test_a_file_for_the_upright_image_is_taken_as_it_is() -> None:
    upright = replace(SENSOR, width=480, height=640)
    assert turned_camera(lambda w, h, _: upright.scaled_to(w, h), 480, 640, None, 6) == upright


def test_an_assumed_camera_is_that_of_the_upright_image() -> None:
    for orientation in range(1, 9):
        assert turned_camera(default_camera, 480, 640, 27.0, orientation) == default_camera(
            480, 640, 27.0
        )
