import json
import math

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose, bearing_of_pixel
from doorway3ds.lab.datasets.truth import PictureTruth, TruthOpening
from doorway3ds.lab.evaluate import direction, kinds
from doorway3ds.lab.evaluate.direction import DirectionRecord
from doorway3ds.lab.evaluate.kinds import ANY, NONE
from doorway3ds.types import Frame

CAMERA = Camera.from_fov(200, 100, 60)
LEVEL = Pose()
WALL, DOOR, WINDOW, CURTAIN = 0, 7, 8, 15


def frame(pose=LEVEL):
    return Frame(np.zeros((100, 200, 3), np.uint8), CAMERA, pose)


def under(labels, left_px, right_px, pose=LEVEL):
    row = (CAMERA.height - 1) / 2
    left, right = bearing_of_pixel(CAMERA, pose, [(left_px, row), (right_px, row)])
    return kinds.kind_under(labels, frame(pose), float(left), float(right))


def labels(*spans):
    """A wall with (class, first column, end) from top to bottom."""
    found = np.full((100, 200), WALL, np.uint8)
    for k, first, end in spans:
        found[:, first:end] = k
    return found


@pytest.mark.parametrize(
    ("spans", "left_px", "right_px", "kind"),
    [
        ([(DOOR, 80, 120)], 79.5, 119.5, "closed door"),
        ([(DOOR, 80, 120)], 120.5, 160, ""),  # beside it
        ([(DOOR, 80, 120)], 60, 99, ""),  # 20 columns of wall, 20 of the door: no majority
        ([(DOOR, 80, 120)], 60.5, 99.2, "closed door"),  # 19 of wall
        # A window is its panes and curtains together; neither alone outweighs the wall.
        ([(WINDOW, 80, 92), (CURTAIN, 92, 104)], 79.5, 119.5, "window"),
        ([(DOOR, 0, 30), (WINDOW, 30, 80)], -0.5, 79.5, "window"),
        ([(DOOR, 190, 200)], 195.3, 195.4, "closed door"),  # narrower than a column
        ([(DOOR, 190, 200)], 199.5, 240, "closed door"),  # beyond the picture: its last column
        ([(DOOR, 0, 1)], -40, -20, "closed door"),
    ],
)
def test_the_kind_under_a_candidate_is_that_of_most_of_it(spans, left_px, right_px, kind):
    assert under(labels(*spans), left_px, right_px) == kind


def test_only_the_middle_rows_count():
    found = labels((DOOR, 0, 200))
    found[:45] = found[55:] = WINDOW
    assert under(found, 50, 150) == "closed door"
    found[44:56] = WALL
    assert under(found, 50, 150) == ""


def test_labels_of_another_size_and_a_turned_head_are_followed():
    found = labels((DOOR, 80, 120))
    assert under(found[::2, ::2], 79.5, 119.5) == "closed door"
    assert under(found, 79.5, 119.5, Pose(yaw_deg=20)) == "closed door"


def test_the_candidate_of_an_answer():
    opening = {"left_deg": 9.0, "right_deg": -3.0, "bearing_deg": 3.0, "score": 0.1}
    second = {**opening, "left_deg": 30.0}
    assert kinds.candidate_deg({"openings": [opening, second]}) == (9.0, -3.0)
    assert kinds.candidate_deg({"openings": [{"bearing_deg": 3.0}]}) == (3.0, 3.0)
    closed = {"openings": [], "bearing_deg": None}
    assert kinds.candidate_deg(closed) is None
    assert kinds.candidate_deg({**closed, "selection": {"bearing_deg": -7.0}}) == (-7.0, -7.0)


def record(name, place, shown, reason="no_door", p_open=0.1, lies_on="", is_open=False):
    openings = (TruthOpening(5, -5, 0),) if is_open else ()
    truth = PictureTruth(name, place, is_open, openings, shown)
    return DirectionRecord(truth, (), reason, p_open, None, lies_on)


def records():
    door, window = "closed door", "window"
    return [
        record("a", "p", (door,), "turn", 0.9, door),
        record("b", "p", (door, window), "no_door", 0.2, window),
        record("c", "q", (door,), "blocked", 0.5),
        record("d", "q", (window,), "no_door", 0.3, door),  # on a door below 2 % of the picture
        record("e", "r", ()),
        record("f", "r", ("poster",), "aligned", 0.7),
        record("g", "r", (), "turn", 0.9, None, is_open=True),
        record("h", "r", (), "turn", 0.9, None, is_open=None),
    ]


def test_shares_by_hand():
    scored = kinds.score(records(), repeats=0)
    assert list(scored) == [ANY, "closed door", "window", "poster", NONE]
    shares = {
        kind: (s.pictures, s.places, s.goes.value, s.p_open.value, s.on_it.value)
        for kind, s in scored.items()
        if kind != NONE
    }
    assert shares == {
        ANY: (6, 3, 2 / 6, 3 / 6, 3 / 6),
        "closed door": (3, 2, 1 / 3, 2 / 3, 1 / 3),
        "window": (2, 2, 0, 0, 1 / 2),
        "poster": (1, 1, 1, 1, 0),
    }
    assert scored[NONE].pictures == 1
    assert math.isnan(scored[NONE].on_it.value)
    assert math.isnan(scored[ANY].goes.low)


def test_all_kinds_together_are_the_metric_of_the_main_table():
    """Value, interval and number of pictures; what is half open counts in neither."""
    scored = kinds.score(records(), repeats=200)
    main = direction.score(records(), repeats=200)
    assert scored[ANY].goes == main["go_without_door"]


def test_intervals_resample_places():
    """Both pictures of a place go or neither: the interval is that of two places, not four."""
    same = [
        record(f"{place}{k}", place, ("mirror",), reason)
        for place, reason in (("p", "turn"), ("q", "no_door"))
        for k in range(50)
    ]
    goes = kinds.score(same, repeats=400)["mirror"].goes
    assert (goes.value, goes.low, goes.high, goes.n) == (0.5, 0.0, 1.0, 100)


def test_what_is_not_known_is_not_counted():
    scored = kinds.score([record("a", "p", ("mirror",), p_open=math.nan, lies_on=None)])
    mirror = scored["mirror"]
    assert (mirror.goes.value, mirror.p_open.n, mirror.on_it.n) == (0, 0, 0)
    told = json.loads(json.dumps(mirror.to_dict(), allow_nan=False))
    assert told["p_open_from_0.5"]["value"] is told["best_candidate_on_it"]["value"] is None


def test_no_kinds_no_scores():
    assert kinds.score([record("a", "p", ()), record("b", "p", (), is_open=True)]) == {}
    assert kinds.score([]) == {}
