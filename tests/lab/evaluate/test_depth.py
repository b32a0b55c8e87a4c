import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.lab.evaluate import depth
from doorway3ds.lab.evaluate.runners import predicted_depth
from doorway3ds.types import Frame, Perception

CAMERA = Camera("off centre", 8, 6, 10.0, 10.0, 2.0, 2.5)


def averages(network, image):
    """(plain, average of both mirrorings) as evaluation computes them."""
    frame = Frame(image, CAMERA)

    def perceive(picture, camera):
        return Perception(0.5, depth_m=network(picture, camera))

    maps = dict(predicted_depth("toy", perceive, frame, mirror=True))
    return maps[False], maps[True]


def test_mirrored_averaging_of_a_biased_network():
    """A network that adds its column number: left and right cancel to the middle."""
    seen = []

    def network(image, camera):
        seen.append((image[0, 0, 0], camera.cx))
        return np.tile(np.arange(8, dtype=np.float32), (6, 1)) + image[..., 0]

    image = np.zeros((6, 8, 3), np.uint8)
    image[:, 0] = 4
    plain, average = averages(network, image)
    expected = np.full((6, 8), 3.5)
    expected[:, 0] += 4
    np.testing.assert_allclose(average, expected)
    assert plain[0].tolist() == [4, 1, 2, 3, 4, 5, 6, 7]
    assert seen == [(4, 2.0), (0, 5.0)]  # the camera is mirrored with the picture


def test_a_symmetric_network_is_left_as_it_is():
    image = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
    plain, average = averages(lambda picture, _: picture[..., 1].astype(np.float32), image)
    np.testing.assert_array_equal(plain, average)


def test_a_network_without_depth_is_refused():
    frame = Frame(np.zeros((6, 8, 3), np.uint8), CAMERA)
    with pytest.raises(UserError, match="'toy' returns no depth"):
        list(predicted_depth("toy", lambda *_: Perception(0.5), frame, mirror=False))


def test_mean_over_pictures_and_over_pixels_differ_as_they_should():
    small = depth.compare("a", "1", np.full((1, 1), 3.0), np.full((1, 1), 2.0, np.float32))
    large = depth.compare("b", "2", np.full((1, 8), 2.0), np.full((1, 8), 2.0, np.float32))
    scored = depth.score([small, large], repeats=0)
    assert scored.metrics["rmse"].value == 0.5
    assert scored.pooled["rmse"] == pytest.approx(1 / 3)  # sqrt((1 * 1 + 8 * 0) / 9)
    assert scored.metrics["delta1"].value == 0.5
    assert scored.pooled["delta1"] == pytest.approx(8 / 9)


def test_a_picture_without_known_depth_is_left_out():
    nothing = depth.compare("a", "1", np.ones((2, 2)), np.full((2, 2), np.nan, np.float32))
    exact = depth.compare("b", "2", np.ones((1, 1)), np.ones((2, 2), np.float32))
    scored = depth.score([nothing, exact], repeats=0)
    assert scored.pictures == 1
    assert scored.metrics["delta1"].value == 1


def test_maps_are_resized_by_pixel_centres():
    ramp = np.arange(4, dtype=np.float32)[None].repeat(2, 0)
    np.testing.assert_allclose(depth.resize_map(ramp, 2, 8)[0, 1:7], np.arange(0.25, 3, 0.5))
