import math

import numpy as np
import pytest

from doorway3ds.lab.evaluate.intervals import (
    Interval,
    bootstrap,
    by_place,
    mean,
    paired_difference,
    plain,
    widened,
    wilson,
)


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        (8, 10, 0.4902, 0.9433),  # Newcombe 1998's method 3 on small samples
        (0, 10, 0.0, 0.2775),
        (10, 10, 0.7225, 1.0),
        (81, 263, 0.2553, 0.3662),  # Newcombe 1998, table I
    ],
)
def test_wilson_against_printed_values(successes, n, low, high):
    interval = wilson(successes, n)
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=1e-4)
    assert interval.value == successes / n


def test_wilson_of_nothing_is_unknown_and_null_in_json():
    assert plain(wilson(0, 0)) == {"value": None, "low": None, "high": None, "n": 0}


def test_wilson_refuses_more_successes_than_trials():
    with pytest.raises(ValueError, match="11 of 10"):
        wilson(11, 10)


def test_wilson_covers_the_true_share():
    rng = np.random.default_rng(0)
    covered = [
        (i := wilson(int(rng.binomial(60, 0.1)), 60)).low <= 0.1 <= i.high for _ in range(1000)
    ]
    assert 0.92 < np.mean(covered) < 0.98


def test_bootstrap_by_place_covers_and_by_picture_does_not():
    """40 places of 10 pictures that share their place's level: the pictures are no trials."""
    rng = np.random.default_rng(1)
    places = [f"{g}" for g in range(40) for _ in range(10)]
    pictures = [f"{i}" for i in range(400)]
    by_place = by_picture = 0
    for trial in range(100):
        values = np.repeat(rng.normal(size=40), 10) + 0.3 * rng.normal(size=400)
        for names, add in ((places, 1), (pictures, 0)):
            found = bootstrap({"mean": mean(values)}, names, repeats=200, seed=trial)["mean"]
            inside = bool(found.low <= 0 <= found.high)
            by_place += inside * add
            by_picture += inside * (1 - add)
    assert by_place >= 87
    assert by_picture <= 65


def test_bootstrap_repeats_with_its_seed():
    values, places = np.arange(30.0), [str(i // 3) for i in range(30)]
    first, again, other = (
        bootstrap({"mean": mean(values)}, places, repeats=100, seed=seed) for seed in (5, 5, 6)
    )
    assert first == again != other


def test_no_interval_from_one_place_or_without_repeats():
    for places, repeats in ((["a"] * 4, 100), (["a", "b", "c", "d"], 0)):
        found = bootstrap({"mean": mean([1, 2, 3, 4])}, places, repeats=repeats)["mean"]
        assert (found.value, found.n) == (2.5, 4)
        assert math.isnan(found.low) and math.isnan(found.high)


def test_unknown_values_are_left_out_of_the_mean():
    interval = by_place({"mean": mean([1.0, math.nan, 3.0])}, ["a", "b", "c"], 200)["mean"]
    assert (interval.value, interval.n) == (2.0, 2)
    assert interval.low == 1.0 and interval.high == 3.0


def test_paired_difference_is_narrower_than_its_parts():
    rng = np.random.default_rng(2)
    hard = np.repeat(rng.normal(size=20), 5)
    places = [str(i // 5) for i in range(100)]
    a = {"mean": mean(hard)}
    b = {"mean": mean(hard + 0.1 + 0.05 * rng.normal(size=100))}
    found = paired_difference(a, b, places, repeats=500)["mean"]
    part = bootstrap(a, places, repeats=500)["mean"]
    assert found.value == pytest.approx(0.1, abs=0.02)
    assert found.low > 0
    assert found.high - found.low < (part.high - part.low) / 10


@pytest.mark.parametrize(
    ("value", "n", "share", "low", "high"),
    [
        (1.0, 1, True, 0.2065, 1.0),
        (0.0, 600, True, 0.0, 0.0064),
        (0.5, 1, True, math.nan, math.nan),
        (1.0, 1, False, math.nan, math.nan),  # one metre off, of one picture
    ],
)
def test_no_interval_has_no_width(value, n, share, low, high):
    found = widened(Interval(value, value, value, n), share)
    assert (found.value, found.n) == (value, n)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-4, nan_ok=True)


def test_what_resampling_can_vary_stays():
    found = Interval(0.5, 0.4, 0.6, 9)
    assert widened(found, share=True) is found
    unknown = widened(Interval(0.5, math.nan, math.nan, 9), share=True)
    assert math.isnan(unknown.low)
