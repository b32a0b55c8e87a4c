from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.decide.gates import Gates, decide
from doorway3ds.types import Frame, Opening, Perception, Reason, Selection

FRAME = Frame(np.zeros((48, 64, 3), np.uint8), Camera.from_fov(64, 48, 60.9, assumed=True))
SEEN = Perception(0.9, network="net", timings_ms={"network": 5})
OPENING = Opening(10.0, 20.0, 20.0, 10.0, 15.0, 2.5, 0.8, None)
FREE = Selection(15.0, 2.5, (24, 15), True, 1.2, openings=(OPENING,))
EMPTY = Selection(None, None, None, None)
UNSURE = replace(FREE, unsure="cut", look="left")


@pytest.mark.parametrize(
    ("p_open", "selection", "gates", "reason", "turn_deg"),
    [
        (0.49, FREE, Gates(), Reason.NO_DOOR, None),
        (0.49, replace(UNSURE, clear=False), Gates(), Reason.NO_DOOR, None),
        (0.5, FREE, Gates(), Reason.TURN, 15.0),
        (0.9, replace(UNSURE, clear=False), Gates(), Reason.BLOCKED, None),
        (0.9, UNSURE, Gates(), Reason.UNSURE, None),
        (0.9, EMPTY, Gates(), Reason.UNSURE, None),
        (0.9, replace(FREE, clear=None), Gates(), Reason.TURN, 15.0),
        (0.9, replace(UNSURE, bearing_deg=1.0), Gates(), Reason.UNSURE, None),
        (0.9, replace(FREE, bearing_deg=-3.0), Gates(), Reason.ALIGNED, 0.0),
        (0.9, replace(FREE, bearing_deg=-3.01), Gates(), Reason.TURN, -3.01),
        (0.9, FREE, Gates(max_unseen_m=1.0), Reason.UNSURE, None),
        (0.9, FREE, Gates(max_unseen_m=1.2), Reason.TURN, 15.0),
        (0.9, replace(FREE, floor_from_m=None), Gates(max_unseen_m=9.0), Reason.UNSURE, None),
        (0.9, replace(FREE, clear=False), Gates(max_unseen_m=1.0), Reason.BLOCKED, None),
        (0.6, FREE, Gates(open_from=0.7), Reason.NO_DOOR, None),
    ],
)
def test_the_first_gate_that_holds_gives_the_reason(p_open, selection, gates, reason, turn_deg):
    decision = decide(replace(SEEN, p_open=p_open), selection, FRAME, "opening", gates)
    assert decision.reason is reason
    assert decision.turn_deg == turn_deg
    assert decision.open is (p_open >= gates.open_from)


def test_the_json_object_has_the_contracts_keys_in_order():
    answer = decide(SEEN, FREE, FRAME, "opening").to_dict("a.jpg")
    assert list(answer) == [
        *("image", "method", "network", "camera", "p_open", "open", "reason", "turn_deg"),
        *("bearing_deg", "range_m", "clear", "floor_from_m", "look", "openings", "pixel"),
        "timings_ms",
    ]
    assert answer["camera"] == {"name": "field of view", "assumed": True}
    assert answer["openings"] == [
        {
            "left_deg": 20.0,
            "right_deg": 10.0,
            "bearing_deg": 15.0,
            "range_m": 2.5,
            "score": 0.8,
            "cut": None,
            "left_px": 10.0,
            "right_px": 20.0,
        }
    ]
    assert (answer["reason"], answer["pixel"], answer["look"]) == ("turn", [24, 15], None)
    assert answer["timings_ms"] == {"network": 5.0}
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer


def test_without_a_door_candidates_are_listed_and_nothing_is_aimed_at():
    answer = decide(replace(SEEN, p_open=0.1), UNSURE, FRAME, "opening").to_dict()
    assert "image" not in answer
    assert [answer[k] for k in ("bearing_deg", "turn_deg", "range_m", "clear", "look")] == [
        None
    ] * 5
    assert len(answer["openings"]) == 1


def test_the_bearing_stays_under_blocked_and_unsure():
    for selection in (UNSURE, replace(FREE, clear=False)):
        answer = decide(SEEN, selection, FRAME, "opening").to_dict()
        assert (answer["bearing_deg"], answer["turn_deg"]) == (15.0, None)
    assert decide(SEEN, UNSURE, FRAME, "opening").to_dict()["look"] == "left"


def test_the_paper_method_adds_its_pixels():
    evidence = {
        "max_pixel": (130, 5),
        "best_pixel": (130, 9),
        "trigger_pixel": (238, 9),
        "free": True,
        "max_depth": 0.5,
        "best_depth": 0.49,
    }
    answer = decide(SEEN, replace(FREE, evidence=evidence), FRAME, "paper").to_dict()
    assert answer["max_pixel"] == [130, 5]
    assert answer["trigger_pixel"] == [238, 9]
    assert (answer["max_depth"], answer["best_depth"]) == (0.5, 0.49)
    selection = replace(FREE, evidence=evidence)
    held_back = decide(replace(SEEN, p_open=0.1), selection, FRAME, "paper").to_dict()
    assert [held_back[k] for k in ("max_pixel", "best_depth")] == [None, None]
