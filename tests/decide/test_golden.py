"""The packaged network's answers on the examples, end to end, stay what they were.

That they are right is asserted with true perception in tests/sim/test_examples.py. After a change
of the network that is meant, `python -m tests.decide.test_golden` writes golden.json again.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.networks.registry import MODELS

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.jpg"))
GOLDEN = Path(__file__).with_name("golden.json")
KEYS = ("p_open", "reason", "turn_deg", "bearing_deg", "range_m", "clear", "look")


def answers() -> dict[str, dict[str, Any]]:
    """What the packaged network says of each example, camera and pose as they were."""
    pipeline = Pipeline.default()
    found = {}
    for picture in EXAMPLES:
        said = json.loads((picture.parent / "truth" / f"{picture.stem}.json").read_text())
        camera = Camera(**said["camera"] | {"distortion": tuple(said["camera"]["distortion"])})
        answer = pipeline(picture, camera=camera, pose=Pose(**said["pose"])).to_dict()
        found[picture.stem] = {key: answer[key] for key in KEYS}
    return found


@pytest.mark.skipif(not MODELS["doornet"].path.is_file(), reason="no packaged network here")
def test_the_packaged_network_s_answers_are_pinned() -> None:
    expected = json.loads(GOLDEN.read_text())
    found = answers()
    assert list(found) == list(expected)
    for name, answer in found.items():
        # Another CPU may round otherwise: numbers by tolerance, words exactly.
        for key, value in expected[name].items():
            if isinstance(value, float):
                assert answer[key] == pytest.approx(value, abs=0.02), (name, key)
            else:
                assert answer[key] == value, (name, key)


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(answers(), indent=2) + "\n")
