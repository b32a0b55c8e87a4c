"""Several looks at one image, averaged."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.errors import CallError
from doorway3ds.networks.averaged import Averaged, Mirrored
from doorway3ds.networks.base import COLUMNS, DEPTH, FLOOR, P_OPEN
from doorway3ds.types import ColumnVotes, Perception, RelativeDepth

WIDTH, HEIGHT, STRIPS = 64, 48, 16
CAMERA = Camera.from_fov(WIDTH, HEIGHT, 60.0)


@dataclass
class Reader:
    """Reads everything off the picture: red is depth, green floor and score, blue p_open."""

    name: str = "reader"
    gives: frozenset[str] = frozenset({P_OPEN, COLUMNS, DEPTH, FLOOR})
    shifted: bool | None = None
    cameras: list[Camera] = field(default_factory=list)

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        self.cameras.append(camera)
        depth = image[..., 0].astype(np.float32) / 10
        green = (image[..., 1] / 255).astype(np.float32)
        score = green.mean(axis=0).reshape(STRIPS, -1).mean(axis=1)
        centre = (np.arange(STRIPS) + 0.5) * WIDTH / STRIPS - 0.5
        return Perception(
            p_open=float(image[0, 0, 2]) / 255,
            columns=ColumnVotes(score, centre - 3, centre + 7, clear=score**2),
            depth_m=np.where(depth > 0, depth, np.nan).astype(np.float32),
            floor=green,
            depth_error=0.2,
            relative=None
            if self.shifted is None
            else RelativeDepth((1 / np.maximum(depth, 0.1)).astype(np.float32), self.shifted),
            network=self.name,
            timings_ms={"network": 2.0},
        )


def picture(seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(20, 230, (HEIGHT, WIDTH, 3)).astype(np.uint8)


def test_a_network_that_is_the_same_in_the_mirror_says_the_same() -> None:
    network = Reader()
    image = picture()
    seen, plain = Mirrored(network)(image, CAMERA), network(image, CAMERA)
    assert plain.depth_m is not None and seen.depth_m is not None and seen.floor is not None
    np.testing.assert_allclose(seen.depth_m, plain.depth_m, rtol=1e-5)
    np.testing.assert_allclose(seen.floor, plain.floor, atol=1e-5)
    assert seen.columns is not None and plain.columns is not None
    np.testing.assert_allclose(seen.columns.score, plain.columns.score, atol=1e-5)
    np.testing.assert_allclose(seen.columns.clear, plain.columns.clear, atol=1e-5)
    # 3 to the left and 7 to the right, and the other way round in the mirror: 5 and 5
    np.testing.assert_allclose(seen.columns.left_px, plain.columns.left_px - 2, atol=1e-4)
    np.testing.assert_allclose(seen.columns.right_px, plain.columns.right_px - 2, atol=1e-4)
    assert seen.timings_ms["network"] == 4.0
    assert seen.depth_error == 0.2


def test_the_mirror_image_gets_the_mirrored_answer() -> None:
    network = Mirrored(Reader())
    image = picture(1)
    one = network(image, CAMERA)
    other = network(np.ascontiguousarray(image[:, ::-1]), CAMERA.mirrored())
    assert one.columns is not None and other.columns is not None
    assert one.p_open == pytest.approx(other.p_open)
    np.testing.assert_allclose(one.columns.score, other.columns.score[::-1], atol=1e-6)
    np.testing.assert_allclose(
        one.columns.left_px, WIDTH - 1 - other.columns.right_px[::-1], atol=1e-4
    )


def test_p_open_is_the_mean_of_the_logits() -> None:
    image = picture()
    image[0, 0, 2], image[0, -1, 2] = 51, 204  # 0.2 and 0.8: logits that cancel
    assert Mirrored(Reader())(image, CAMERA).p_open == pytest.approx(0.5, abs=1e-6)


def test_the_second_look_has_the_mirrored_camera() -> None:
    network = Reader()
    camera = Camera("off", WIDTH, HEIGHT, 60.0, 60.0, 20.0, 24.0)
    Mirrored(network)(picture(), camera)
    assert [c.cx for c in network.cameras] == [20.0, pytest.approx(WIDTH - 1 - 20.0)]


def test_depth_that_one_look_lacks_is_the_others() -> None:
    @dataclass
    class Forgetful(Reader):
        def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
            seen = Reader.__call__(self, image, camera)
            assert seen.depth_m is not None
            seen.depth_m[:, :8] = np.nan
            return seen

    image = picture()
    seen = Mirrored(Forgetful())(image, CAMERA)
    assert seen.depth_m is not None
    np.testing.assert_allclose(seen.depth_m, image[..., 0] / 10, rtol=1e-5)


@pytest.mark.parametrize("shifted", [False, True])
def test_relative_depth_keeps_the_first_looks_scale(shifted: bool) -> None:
    network = Reader(shifted=shifted)
    image = picture()
    seen, plain = Mirrored(network)(image, CAMERA), network(image, CAMERA)
    assert seen.relative is not None and plain.relative is not None
    assert seen.relative.shifted is shifted
    np.testing.assert_allclose(seen.relative.inverse, plain.relative.inverse, rtol=1e-5)


@dataclass
class Fixed(Reader):
    """A look whose answers are given."""

    p_open: float = 0.5
    depth: float = np.nan
    left: float = 0.0
    score: float = 0.0

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        strips = np.full(STRIPS, 1.0, np.float32)
        return Perception(
            p_open=self.p_open,
            columns=ColumnVotes(self.score * strips, self.left * strips, 60 * strips),
            depth_m=np.full((HEIGHT, WIDTH), self.depth, np.float32),
            network=self.name,
            timings_ms={"network": 2.0},
        )


def test_three_networks_say_their_mean() -> None:
    looks = [
        Fixed("a", p_open=0.2, depth=1.0, left=10, score=0.1),
        Fixed("b", p_open=0.8, depth=4.0, left=20, score=0.3),
        Fixed("c", p_open=0.5, left=30, score=0.6),
    ]
    network = Averaged(looks)
    assert network.name == "a and b and c"
    seen = network(picture(), CAMERA)
    assert seen.p_open == pytest.approx(0.5, abs=1e-6)
    assert seen.columns is not None and seen.depth_m is not None
    np.testing.assert_allclose(seen.columns.left_px, 25.0, atol=1e-3)  # 1 + 6 + 18
    np.testing.assert_allclose(seen.depth_m, 2.0, rtol=1e-6)  # of the two that know
    assert seen.floor is None and seen.columns.clear is None
    assert seen.timings_ms == {"network": 6.0}


def test_what_no_look_knows_stays_unknown() -> None:
    seen = Averaged([Fixed("a"), Fixed("b")])(picture(), CAMERA)
    assert seen.depth_m is not None and np.isnan(seen.depth_m).all()


def test_nothing_has_no_mean() -> None:
    with pytest.raises(CallError, match="one network or more"):
        Averaged([])
