"""Images of stages, as `3ds sim render --scenes` writes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.sim.trials import pictures
from tests.conftest import Cli


@pytest.mark.sim
def test_first_looks_show_their_scenes_and_the_others_stand_in_the_same_place(
    gl: Any, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pictures, "VIEWS", 3)
    out = tmp_path / "stages"
    call = ("sim", "render", "--out", out, "--count", 6, "--seed", 4, "--size", "128x96")
    done = cli(*call, "--workers", 1, "--low", 1, "--scenes", "blocked,no_door")
    assert done.status == 0, done.err
    truth = [json.loads(line) for line in (out / "truth.jsonl").read_text().splitlines()]
    assert [t["image"] for t in truth] == [f"{n:06d}.jpg" for n in range(6)]
    assert truth[0]["openings"][0]["clear"] is False
    assert not truth[3]["openings"] and not truth[3]["glimpse"]
    for stage in (truth[:3], truth[3:]):
        assert len({(t["home"], t["x_m"], t["y_m"]) for t in stage}) == 1
        assert len({t["heading_deg"] for t in stage}) == 3
        assert all(0.3 <= t["pose"]["height_m"] <= 0.6 for t in stage)
    assert len(read_dataset(out).samples) == 6


def test_scenes_are_checked_before_anything_is_drawn(cli: Cli, tmp_path: Path) -> None:
    call = ("sim", "render", "--out", tmp_path / "stages")
    done = cli(*call, "--scenes", "blocked,stair")
    assert done.status == 2 and "'stair'" in done.err and "stairs_down" in done.err
    done = cli(*call, "--scenes", "blocked", "--hazards", 0.5)
    assert done.status == 2 and "leave --hazards out" in done.err
    assert not (tmp_path / "stages").exists()
