import math
from dataclasses import replace

import pytest

from doorway3ds.lab.datasets.truth import PictureTruth, TruthOpening
from doorway3ds.lab.evaluate import direction
from doorway3ds.lab.evaluate.direction import DirectionRecord


def doorway(bearing=0.0, half=5.0, clear=True, range_m=None, second=False):
    return TruthOpening(bearing + half, bearing - half, bearing, range_m, clear, second)


def record(openings=(), listed=(), reason="turn", p_open=0.9, clear=None, name="a", place="p"):
    truth = PictureTruth(name, place, bool(openings), tuple(openings))
    return DirectionRecord(truth, tuple(listed), reason, p_open, clear)


def values(records):
    scored = direction.score(records, repeats=0)
    return {name: interval.value for name, interval in scored.metrics.items()}


def test_scores_by_hand():
    records = [
        record([doorway(10, range_m=4.0)], [(12.0, 5.0)], "turn", 0.9, True),  # 2 deg off
        record([doorway(-20, clear=False)], [(-14.0, None)], "blocked", 0.8, False),  # 6 off
        record([doorway(0, half=10)], [(-7.0, None)], "unsure", 0.6, None),  # 7 off, inside
        record([doorway(5, clear=False)], [], "no_door", 0.2, True),  # none listed
        record([], [(3.0, None)], "turn", 0.7),
        record([], [], "no_door", 0.1),
        record([], [(3.0, None)], "unsure", 0.3),
    ]
    v = values(records)
    assert v["bearing_median_deg"] == 6
    assert v["bearing_p90_deg"] == pytest.approx(6.8)
    assert v["listed"] == 3 / 4
    assert v["within_5deg"] == 1 / 4
    assert v["inside"] == 2 / 4
    assert v["turns_inside"] == 1 / 2
    assert (v["range_median_m"], v["range_median_share"]) == (1.0, 0.25)
    assert v["go_without_door"] == 1 / 3
    assert v["go_when_blocked"] == 0
    assert v["go_when_clear"] == 1 / 2
    assert v["clear_agreement"] == 2 / 3  # the third answer is None
    assert v["clear_answered"] == 3 / 4
    assert v["auc"] == pytest.approx((3 + 3 + 2 + 1) / 12)


def test_counts_stand_beside_the_values():
    scored = direction.score(
        [record([doorway()], [(0.0, None)]), record(), record([doorway()])], repeats=0
    )
    assert (scored.pictures, scored.doorway_pictures, scored.places) == (3, 2, 1)
    assert scored["within_5deg"].n == 2
    assert scored["bearing_median_deg"].n == 1
    assert scored["go_without_door"].n == 1


def test_the_nearest_marked_opening_counts_and_so_does_its_way():
    openings = [doorway(-20, clear=True), doorway(15, clear=False, second=True)]
    outcome = direction.judge(record(openings, [(14.0, None)], clear=False))
    assert outcome.matched == 1
    assert outcome.error_deg == -1
    assert (outcome.way_clear, outcome.clear_right) == (0, 1)


def test_without_a_listed_opening_the_main_one_tells_the_way():
    openings = [doorway(-20, clear=True), doorway(15, clear=False, second=True)]
    outcome = direction.judge(record(openings, [], "no_door"))
    assert outcome.matched is None
    assert outcome.way_clear == 1


@pytest.mark.parametrize(
    ("bearing", "within", "inside"),
    [(5.0, 1, 1), (5.01, 0, 0), (-5.0, 1, 1), (8.0, 0, 0)],
)
def test_the_limits_belong_to_the_right_answers(bearing, within, inside):
    outcome = direction.judge(record([doorway(0, half=5)], [(bearing, None)]))
    assert (outcome.within, outcome.inside) == (within, inside)


def test_only_the_first_listed_opening_counts():
    best_wrong = record([doorway(0)], [(30.0, None), (0.0, None)])
    assert direction.judge(best_wrong).within == 0


def test_mirrored_answers_to_mirrored_pictures_score_the_same():
    records = [
        record([doorway(12, half=3, range_m=2.0)], [(9.5, 2.5)], place="a"),
        record([doorway(-7)], [(-30.0, None)], "unsure", place="b"),
        record([], [(4.0, None)], "blocked", place="c"),
    ]

    def mirrored(r):
        openings = tuple(
            replace(o, left_deg=-o.right_deg, right_deg=-o.left_deg, bearing_deg=-o.bearing_deg)
            for o in r.truth.openings
        )
        listed = tuple((-b, range_m) for b, range_m in r.listed)
        return replace(r, truth=replace(r.truth, openings=openings), listed=listed)

    flipped = values([mirrored(r) for r in records])
    for name, value in values(records).items():
        assert flipped[name] == pytest.approx(value, nan_ok=True), name


def test_half_open_pictures_stay_out_of_p_open_and_of_no_door():
    half = record([doorway()], [(0.0, None)], p_open=0.5)
    half = replace(half, truth=replace(half.truth, is_open=None))
    scored = direction.score([half, record([doorway()]), record()], repeats=0)
    assert scored["auc"].n == 2
    assert scored["go_without_door"].n == 1


@pytest.mark.parametrize("is_open", [True, None])
def test_a_doorway_that_nobody_marked_counts_for_p_open_alone(is_open):
    known = [
        record([doorway()], [(0.0, None)]),
        record([], [(3.0, None)], "no_door", 0.2),
        record([], [(3.0, None)], "turn", 0.9),
    ]
    unmarked = [
        replace(r, truth=PictureTruth("b", "q", is_open))
        for r in (record(listed=[(3.0, 2.0)], p_open=0.1), record(reason="no_door"))
    ]
    alone = direction.score(known, repeats=0)
    scored = direction.score([*known, *unmarked], repeats=0)
    assert (scored.pictures, scored.doorway_pictures) == (5, 1)
    for name, expected in alone.metrics.items():
        if name != "auc" or is_open is None:
            found = scored[name]
            assert found.n == expected.n, name
            assert found.value == pytest.approx(expected.value, nan_ok=True), name
    assert alone["go_without_door"].n == 2
    if is_open:
        # of three open and two not: 0.9, 0.9 and 0.1 against 0.2 and 0.9
        assert scored["auc"].n == 5
        assert scored["auc"].value == pytest.approx((1.5 + 1.5 + 0) / 6)


def test_no_pictures_give_unknown_values():
    assert all(math.isnan(value) for value in values([]).values())


def test_difference_of_a_method_with_itself_is_zero():
    records = [
        record([doorway(i)], [(i + 3.0 * (i % 3), None)], place=str(i % 4), name=str(i))
        for i in range(12)
    ]
    assert direction.difference(records, records, repeats=50)["within_5deg"].value == 0
    better = [replace(r, listed=((r.truth.openings[0].bearing_deg, None),)) for r in records]
    gain = direction.difference(records, better, repeats=200)["within_5deg"]
    assert gain.value == pytest.approx(1 / 3)
    assert gain.low > 0


def test_difference_needs_the_same_pictures():
    with pytest.raises(ValueError, match="same images"):
        direction.difference([record(name="a")], [record(name="b")])


def test_json_answers_give_the_same_record():
    truth = PictureTruth("a", "p", True, (doorway(),))
    answer = {
        "openings": [{"bearing_deg": 3, "range_m": None}, {"bearing_deg": -9, "range_m": 2}],
        "bearing_deg": 3,
        "range_m": None,
        "reason": "unsure",
        "p_open": 0.75,
        "clear": None,
    }
    expected = DirectionRecord(truth, ((3.0, None), (-9.0, 2.0)), "unsure", 0.75, None)
    assert direction.record_from_json(truth, answer) == expected


def test_a_closed_gate_does_not_hide_where_the_paper_method_points():
    truth = PictureTruth("a", "p", True, (doorway(),))
    answer = {
        "openings": [],
        "bearing_deg": None,
        "range_m": None,
        "reason": "no_door",
        "p_open": 0.1,
        "clear": None,
    }
    bare = direction.record_from_json(truth, answer)
    assert (bare.listed, bare.clear) == ((), None)
    answer["selection"] = {"bearing_deg": 4.5, "range_m": 3.0, "clear": True}
    full = direction.record_from_json(truth, answer)
    assert (full.listed, full.clear) == (((4.5, 3.0),), True)
