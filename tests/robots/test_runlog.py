"""What a run's log keeps comes back as it was."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.errors import UserError
from doorway3ds.robots.runlog import RunLog, differences, looks, read_log
from doorway3ds.types import (
    ColumnVotes,
    Decision,
    Frame,
    Perception,
    Reason,
    RelativeDepth,
    Selection,
)


def test_every_field_of_a_perception_is_kept(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    maps = random.uniform(0.1, 4, (3, 6, 8)).astype(np.float32)
    votes = columns_from_spans([(4.0, 20.0)], 32, n=16)
    seen = Perception(
        p_open=0.75,
        columns=ColumnVotes(votes.score, votes.left_px, votes.right_px, random.uniform(size=16)),
        depth_m=maps[0],
        floor=maps[1],
        depth_error=0.125,
        relative=RelativeDepth(maps[2], shifted=True),
        network="a network",
        timings_ms={"network": 3.0},
    )
    frame = Frame(np.zeros((24, 32, 3), np.uint8), Camera.from_fov(32, 24, 60.0))
    decision = Decision(
        Reason.UNSURE, None, 0.75, True, Selection(None, None, None, None), seen, frame, "opening"
    )
    with RunLog(tmp_path / "run", perception=True) as log:
        log.write("start")
        log.look(1, decision, "wait")
    (look,) = looks(tmp_path / "run", read_log(tmp_path / "run"))
    kept = look.perception
    assert kept is not None
    for part in (None, "columns", "relative"):
        before, after = (seen, kept) if part is None else (getattr(v, part) for v in (seen, kept))
        for field in fields(before):
            if field.name not in ("columns", "relative", "timings_ms"):
                a, b = (getattr(value, field.name) for value in (before, after))
                assert type(a) is type(b), field.name
                np.testing.assert_array_equal(a, b, err_msg=field.name)


def test_a_run_is_not_written_over(tmp_path: Path) -> None:
    RunLog(tmp_path / "run").close()
    with pytest.raises(UserError, match="already holds a run"):
        RunLog(tmp_path / "run")


def test_a_cut_line_is_named(tmp_path: Path) -> None:
    (tmp_path / "run.jsonl").write_text('{"event": "start"}\n{"event": "lo')
    with pytest.raises(UserError, match=r"run\.jsonl:2"):
        read_log(tmp_path)


def test_differences_name_what_changed_and_pass_over_times() -> None:
    a: dict[str, Any] = {"reason": "turn", "turn_deg": 5.0, "pixel": [1, 2], "timings_ms": {"n": 1}}
    assert differences(a, json.loads(json.dumps({**a, "timings_ms": {"n": 9}}))) == []
    assert differences(a, {**a, "turn_deg": 5.1, "pixel": [1, 3]}) == ["pixel", "turn_deg"]
