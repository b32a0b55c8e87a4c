import math

import numpy as np
import pytest

from doorway3ds.lab.evaluate import metrics


def test_confusion_by_hand():
    truth = [1, 1, 1, 0, 0, 0, 0, 1]
    answer = [1, 1, 0, 0, 0, 0, 1, 1]
    c = metrics.confusion(truth, answer)
    assert (c.tp, c.fp, c.tn, c.fn) == (3, 1, 3, 1)
    assert c.accuracy == 6 / 8
    assert c.balanced_accuracy == (3 / 4 + 3 / 4) / 2


def test_accuracy_of_nothing_is_unknown():
    assert math.isnan(metrics.confusion([], []).accuracy)


@pytest.mark.parametrize(
    ("truth", "score", "expected"),
    [
        ([0, 0, 1, 1], [0.1, 0.4, 0.35, 0.8], 0.75),  # 3 of 4 pairs in order
        ([0, 1], [0.5, 0.5], 0.5),  # a tie counts half
        ([0, 0, 1], [1, 2, 3], 1.0),
        ([1, 1, 0], [1, 2, 3], 0.0),
        ([0, 1, 1, 0], [0.2, 0.2, 0.9, 0.1], 3.5 / 4),
    ],
)
def test_auc_by_hand(truth, score, expected):
    assert metrics.auc(truth, score) == pytest.approx(expected)


def test_auc_is_the_area_under_the_roc_curve():
    rng = np.random.default_rng(3)
    truth = rng.random(200) < 0.3
    score = np.round(truth * 0.3 + rng.random(200), 1)
    false, true = metrics.roc_curve(truth, score)
    assert (false[0], true[0], false[-1], true[-1]) == (0, 0, 1, 1)
    assert np.trapezoid(true, false) == pytest.approx(metrics.auc(truth, score))


def test_auc_of_one_class_is_unknown():
    assert math.isnan(metrics.auc([1, 1], [0.2, 0.3]))


def test_calibration_by_hand():
    # bin 0: mean p 0.05, frequency 0; bin 9: mean p 0.95, frequency 0.5
    c = metrics.calibration([0, 0, 1, 0], [0.0, 0.1 - 1e-9, 1.0, 0.9], bins=10)
    assert c.count.tolist() == [2, 2]
    assert c.frequency.tolist() == [0, 0.5]
    assert c.ece == pytest.approx(0.5 * 0.05 + 0.5 * 0.45)


def test_calibration_by_chance_shrinks_with_the_number_of_images():
    few, many = (metrics.calibration_by_chance([0.5] * n, repeats=400) for n in (25, 2500))
    # half of n outcomes: |share - 0.5| has the mean sqrt(2 / pi) * 0.5 / sqrt(n)
    assert few.mean() == pytest.approx(0.0798, rel=0.1)
    assert many.mean() == pytest.approx(0.00798, rel=0.1)
    assert metrics.calibration_by_chance([0.0, 1.0]).max() == 0


def test_depth_errors_by_hand():
    truth = np.array([[2.0, 4.0], [1.0, 5.0]])
    predicted = np.array([[2.4, 6.0], [1.0, 2.0]])
    e = metrics.depth_errors(predicted, truth)
    # ratios 1.2, 1.5, 1, 2.5 against 1.25, 1.5625, 1.953
    assert (e.delta1, e.delta2, e.delta3) == (0.5, 0.75, 0.75)
    assert e.abs_rel == pytest.approx((0.2 + 0.5 + 0 + 0.6) / 4)
    assert e.rmse == pytest.approx(math.sqrt((0.16 + 4 + 0 + 9) / 4))
    assert e.log10 == pytest.approx((math.log10(1.2) + math.log10(1.5) + 0 + math.log10(2.5)) / 4)
    assert e.pixels == 4


def test_depth_counts_known_pixels_inside_the_box_and_below_the_limit():
    truth = np.array([[np.nan, 10.0, 2.0], [3.0, 0.0, 4.0]])
    predicted = np.full((2, 3), 2.0)
    assert metrics.depth_errors(predicted, truth).pixels == 3
    assert metrics.depth_errors(predicted, truth, box=(0, 1, 1, 3)).rmse == 0
    assert math.isnan(metrics.depth_errors(predicted, truth, box=(0, 1, 0, 2)).rmse)


def test_leaving_depth_out_does_not_help():
    truth = np.full((1, 2), 2.0)
    assert metrics.depth_errors(np.array([[2.0, np.nan]]), truth).delta1 == 0.5


def test_another_size_of_depth_is_refused():
    with pytest.raises(ValueError, match=r"\(2, 2\) and \(2, 3\)"):
        metrics.depth_errors(np.ones((2, 2)), np.ones((2, 3)))
