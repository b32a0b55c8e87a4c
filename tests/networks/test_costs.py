"""p_open weighed by what its errors cost."""

from __future__ import annotations

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.networks.costs import Costs, weigh

COSTS = Costs(missed=1.5, false_near=3.0, near_m=1.0, far_m=4.0)


def odds(p: float) -> float:
    return p / (1 - p)


def test_equal_costs_leave_a_chance_as_it_is() -> None:
    for p_open in (0.0, 0.2, 1.0):
        assert weigh(p_open, np.full((3, 4), 1.2), Costs()) == pytest.approx(p_open)


@pytest.mark.parametrize(("metres", "ratio"), [(0.5, 1 / 3), (1.0, 1 / 3), (4.0, 1.5), (9.0, 1.5)])
def test_odds_are_multiplied_by_the_ratio_of_the_costs(metres: float, ratio: float) -> None:
    weighed = weigh(0.4, np.full((3, 4), metres), COSTS)
    assert odds(weighed) == pytest.approx(odds(0.4) * ratio)


def test_costs_go_over_into_each_other() -> None:
    # halfway between the distances in their logarithm: the geometric mean of both ratios
    between = weigh(0.4, np.full((3, 4), 2.0), COSTS)
    assert odds(between) == pytest.approx(odds(0.4) * np.sqrt(1.5 / 3))
    found = [weigh(0.4, np.full((3, 4), m), COSTS) for m in np.linspace(0.5, 5, 40)]
    assert np.all(np.diff(found) >= -1e-12)


def test_unknown_depth_is_left_out_and_counts_as_far() -> None:
    half = np.array([[np.nan, 1.0], [np.nan, 1.0]])
    assert weigh(0.4, half, COSTS) == weigh(0.4, np.full((2, 2), 1.0), COSTS)
    assert weigh(0.4, np.full((2, 2), np.nan), COSTS) == weigh(0.4, np.full((2, 2), 9.0), COSTS)


def test_certainty_stays() -> None:
    near = np.full((2, 2), 0.5)
    assert weigh(0.0, near, COSTS) == 0.0
    assert weigh(1.0, near, COSTS) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "wrong", [{"missed": 0.0}, {"false_near": -1.0}, {"near_m": 3.0}, {"far_m": float("inf")}]
)
def test_costs_that_make_no_sense_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(UserError, match="costs must be above 0 and near_m below far_m"):
        Costs(**wrong)
