from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.lab.train.doornet.data.augment import AugmentConfig, lowered, view
from doorway3ds.lab.train.doornet.data.samples import Sample, Span
from doorway3ds.lab.train.doornet.model import CANONICAL_F_PX

FOCAL, WIDTH, HEIGHT = 300.0, 352, 264


def wall(span: tuple[float, float], *, clear: int | None = 1) -> Sample:
    """A wall 3 m ahead, painted white inside the span, on a camera without distortion."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[:, round(span[0] + 0.5) : round(span[1] + 0.5)] = 255
    return Sample(
        name="wall",
        source="nyu",
        place="a",
        image=image,
        camera=(FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2),
        open=1,
        spans=(Span(*span, clear=clear),),
        depth_m=np.full((HEIGHT, WIDTH), 3.0, np.float32),
        segments=np.ones((HEIGHT, WIDTH), np.uint8),
    )


def test_plain_view_keeps_the_opening_and_scales_depth_to_the_canonical_camera() -> None:
    target = view(wall((99.5, 165.5)), (192, 256), None)
    inside = target.score > 0.99
    strips = (np.arange(64) + 0.5) / 64
    left = (strips - target.left)[inside] * 256 - 0.5
    right = (strips + target.right)[inside] * 256 - 0.5
    shrink = 256 / WIDTH
    assert np.allclose(left, (99.5 + 0.5) * shrink - 0.5, atol=0.01)
    assert np.allclose(right, (165.5 + 0.5) * shrink - 0.5, atol=0.01)
    assert np.allclose(target.depth, 3.0 * CANONICAL_F_PX / (FOCAL * shrink), rtol=1e-4)
    assert target.p_open == 1
    assert np.all(target.clear[inside] == 1)


@pytest.mark.parametrize("seed", range(20))
def test_labels_follow_the_picture(seed: int) -> None:
    """What is white in the warped picture is what the labels call an opening."""
    config = AugmentConfig(colour=0.0, occluder=0.0)
    target = view(wall((120.0, 230.0)), (192, 256), np.random.default_rng(seed), config)
    white = target.image[96, :, 0] > 127
    strips = white.reshape(64, 4).mean(axis=1)
    assert np.abs(strips - target.score).max() <= 0.3
    inside = target.score > 0.99
    if inside.any():
        left = ((np.arange(64) + 0.5) / 64 - target.left)[inside] * 256 - 0.5
        assert np.allclose(left, np.flatnonzero(white)[0] - 0.5, atol=1.0)


@pytest.mark.parametrize("seed", range(20))
def test_depth_stays_a_plane(seed: int) -> None:
    """A wall seen by a turned, zooming camera: inverse depth is linear over the picture."""
    config = AugmentConfig(whole=0.0, colour=0.0, occluder=0.0)
    depth = view(wall((120.0, 230.0)), (192, 256), np.random.default_rng(seed), config).depth
    rows, columns = np.nonzero(depth)
    design = np.stack([rows, columns, np.ones(len(rows))], axis=1)
    inverse = 1 / depth[rows, columns]
    fitted = design @ np.linalg.lstsq(design, inverse, rcond=None)[0]
    assert np.abs(fitted / inverse - 1).max() < 0.01


def test_loose_boxes_leave_the_leaf_out() -> None:
    sample = wall((100.0, 200.0), clear=None)
    loose = Sample(**{**sample.__dict__, "spans": (Span(100.0, 200.0, loose=True),)})
    target = view(loose, (192, 256), None)
    strict = view(sample, (192, 256), None)
    assert target.score.sum() < strict.score.sum()
    outside = strict.score == 0
    assert np.all(target.score_weight[outside] == 1)
    assert np.any(target.score_weight[strict.score > 0] == 0)
    assert target.clear_weight.sum() == 0


def test_a_lowered_camera_sees_the_floor_end_nearer_to_the_horizon() -> None:
    """Columns and depth stay; what was 80 rows below the horizon is 40 below at half height."""
    sample = wall((120.0, 230.0))
    level = sample.camera[3]  # no floor tells the horizon: that of the optical axis
    image = sample.image.copy()
    image[round(level) + 80 :] = (255, 0, 0)
    low = lowered(replace(sample, image=image), 0.5)
    assert low.spans == sample.spans and low.depth_m is not None and np.all(low.depth_m == 3)
    rows = np.flatnonzero(low.image[:, 10, 0] > 127)
    above = level * (2.2 - 1.35 * 0.5) / (2.2 - 1.35)
    assert rows[0] - above == pytest.approx(40, abs=1.5)
    assert len(low.image) == pytest.approx(above + (HEIGHT - 1 - level) / 2, abs=1.5)
    tall = replace(sample, image=np.zeros((400, 300, 3), np.uint8))
    assert lowered(tall, 0.5) is tall
