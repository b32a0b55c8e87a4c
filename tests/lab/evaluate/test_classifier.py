import math

import pytest

from doorway3ds.lab.evaluate import classifier
from doorway3ds.lab.evaluate.classifier import ClassifierRecord
from doorway3ds.lab.evaluate.intervals import plain


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
    assert scored.metrics["accuracy"].value == pytest.approx(4 / 6)
    assert scored.metrics["auc"].value == pytest.approx(7 / 9)
    assert scored.wilson["sensitivity"].n == 3
    assert scored.places == 3


def test_each_kind_of_negative_has_its_own_rate():
    kinds = classifier.score(records(), repeats=0).false_open_by_kind
    assert set(kinds) == {"window", "mirror"}
    assert (kinds["window"].value, kinds["window"].n) == (0.5, 2)
    assert kinds["mirror"].value == 0


def test_one_class_alone_leaves_the_rest_unknown():
    scored = classifier.score(records()[:3], repeats=0)
    assert math.isnan(scored.metrics["auc"].value)
    assert plain(scored)["metrics"]["auc"]["value"] is None


def test_an_unknown_probability_is_refused():
    with pytest.raises(ValueError, match="probability"):
        classifier.score([ClassifierRecord("a", "1", True, math.nan)])
