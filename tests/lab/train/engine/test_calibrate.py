from __future__ import annotations

import numpy as np
import pytest

from doorway3ds.lab.train.engine.calibrate import platt, relative_depth_error


def test_platt_finds_the_scale_that_made_the_labels() -> None:
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 4, 20_000)
    labels = rng.random(20_000) < 1 / (1 + np.exp(-(0.5 * logits + 0.7)))
    assert platt(logits, labels) == pytest.approx((0.5, 0.7), abs=0.03)


def test_platt_stays_finite_on_separable_data() -> None:
    logits = np.r_[np.full(30, -1.0), np.full(30, 1.0)]
    scale, shift = platt(logits, (logits > 0).astype(float))
    p = 1 / (1 + np.exp(-(scale + shift)))
    assert p == pytest.approx(31 / 32, abs=1e-3)


def test_platt_weighs_two_logits_and_leaves_a_misleading_one_out() -> None:
    rng = np.random.default_rng(2)
    logits = rng.normal(0, 3, (20_000, 2))
    labels = rng.random(20_000) < 1 / (1 + np.exp(-(0.4 * logits[:, 0] + 0.8 * logits[:, 1] - 1)))
    assert platt(logits, labels) == pytest.approx((0.4, 0.8, -1.0), abs=0.04)
    scale, other, _ = platt(logits * [1, -1], labels)
    assert other == 0.0
    assert scale > 0.1


def test_platt_leaves_few_labels_alone() -> None:
    assert platt(np.ones(12), np.r_[np.ones(3), np.zeros(9)]) == (1.0, 0.0)


def test_relative_depth_error_is_of_what_an_image_s_scale_leaves() -> None:
    rng = np.random.default_rng(1)
    true = [rng.uniform(1, 5, 20_000) for _ in range(3)]
    scales = (0.7, 1.0, 1.6)
    guessed = [
        t * s * np.exp(rng.normal(0, 0.15, t.size)) for t, s in zip(true, scales, strict=True)
    ]
    guessed[1][:500], true[2][:500] = np.nan, 0  # unknown
    assert relative_depth_error(guessed, true) == pytest.approx(0.15, rel=0.02)
