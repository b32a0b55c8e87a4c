"""The example pictures and the truth beside them, without a renderer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.decide.gates import decide
from doorway3ds.decide.opening import columns_from_spans, select_opening
from doorway3ds.types import Frame, Perception

EXAMPLES = Path(__file__).parents[4] / "examples"
EXPECTED = {"doorway": "turn", "no-doorway": "no_door", "mirror": "no_door", "blocked": "blocked",
            "nao-low": "turn"}  # fmt: skip


def load(name: str) -> tuple[dict[str, Any], Frame, Perception]:
    truth = json.loads((EXAMPLES / "truth" / f"{name}.json").read_text())
    lens = {**truth["camera"], "distortion": tuple(truth["camera"]["distortion"])}
    picture = cv2.imread(str(EXAMPLES / f"{name}.jpg"))
    depth = cv2.imread(str(EXAMPLES / "truth" / f"{name}.depth.png"), cv2.IMREAD_UNCHANGED) / 1000
    floor = cv2.imread(str(EXAMPLES / "truth" / f"{name}.floor.png"), cv2.IMREAD_UNCHANGED)
    spans = [(o["left_px"], o["right_px"]) for o in truth["openings"]]
    frame = Frame(np.ascontiguousarray(picture[..., ::-1]), Camera(**lens), Pose(**truth["pose"]))
    perception = Perception(
        float(bool(spans)),
        columns_from_spans(spans, frame.camera.width),
        np.where(depth > 0, depth, np.nan).astype(np.float32),
        (floor > 0).astype(np.float32),
    )
    return truth, frame, perception


def test_every_example_is_listed() -> None:
    assert {p.stem for p in EXAMPLES.glob("*.jpg")} == set(EXPECTED)
    text = (EXAMPLES / "README.md").read_text()
    assert all(f"`{name}.jpg`" in text for name in EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_perfect_perception_of_an_example_is_decided_rightly(name: str) -> None:
    truth, frame, perception = load(name)
    assert frame.image.shape == (480, 640, 3)
    decision = decide(perception, select_opening(perception, frame), frame, "opening")
    assert decision.reason == EXPECTED[name]
    if truth["openings"]:
        best = truth["openings"][0]
        assert decision.selection.bearing_deg == pytest.approx(best["bearing_deg"], abs=0.1)
        assert decision.selection.range_m == pytest.approx(best["range_m"], rel=0.03)
        assert decision.selection.clear is best["clear"]
