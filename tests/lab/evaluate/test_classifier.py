import math

import pytest

from doorway3ds.lab.evaluate import classifier
from doorway3ds.lab.evaluate.classifier import ClassifierRecord


def records():
    return [
        ClassifierRecord("a", "1", True, 0.9),
        ClassifierRecord("b", "1", True, 0.5),
        ClassifierRecord("c", "2", True, 0.3),
        ClassifierRecord("d", "2", False, 0.6, ("window",)),
        ClassifierRecord("e", "3", False, 0.2, ("window", "mirror")),
        ClassifierRecord("f", "3", False, 0.1),
    ]


def test_scores_by_hand():
    scored = classifier.score(records(), repeats=100)
    c = scored.confusion
    assert (c.tp, c.fp, c.tn, c.fn) == (2, 1, 2, 1)  # 0.5 counts as open
    assert scored.by_place["accuracy"].value == pytest.approx(4 / 6)
    assert scored.by_place["auc"].value == pytest.approx(7 / 9)
    assert scored.wilson["sensitivity"].n == 3
    assert scored.places == 3


def test_each_kind_of_negative_has_its_own_rate():
    scored = classifier.score(records(), repeats=0)
    assert set(scored.false_open) == {"window", "mirror"}
    assert (scored.false_open["window"].value, scored.false_open["window"].n) == (0.5, 2)
    assert scored.false_open["mirror"].value == 0


def test_one_class_alone_leaves_the_rest_unknown():
    scored = classifier.score(records()[:3], repeats=0)
    assert math.isnan(scored.by_place["auc"].value)
    assert scored.to_dict()["metrics"]["auc"]["value"] is None


def test_an_unknown_probability_is_refused():
    with pytest.raises(ValueError, match="probability"):
        classifier.score([ClassifierRecord("a", "1", True, math.nan)])
