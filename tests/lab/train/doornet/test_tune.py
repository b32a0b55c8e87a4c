"""Operating points chosen on known answers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.evaluate.intervals import Interval
from doorway3ds.lab.evaluate.overview import HeldSet
from doorway3ds.lab.train.doornet import tune
from doorway3ds.networks.doornet import DoorNet
from tests import factories
from tests.conftest import Cli
from tests.factories import write_site


def test_limits_keep_within_the_bounds(tmp_path: Path) -> None:
    """A network that sees a door everywhere: only a shut gate turns nowhere without one."""
    site = write_site(tmp_path / "site", rooms=4)
    write_camera_info(Camera.from_fov(160, 120, 60), site / "camera.yaml")
    part = HeldSet("site", read_dataset(site).samples)
    network = DoorNet(factories.doornet(tmp_path / "always.onnx", p_open=1.0))  # 0.73
    seen = tune.Tuning.look(network, [part])
    strict = tune.tune(seen, tune.Goal(0.01, 0.05, (0.5, 0.7, 0.8)))
    assert strict["open_from"] == 0.8
    anything = tune.tune(seen, tune.Goal(1.0, 1.0, (0.8, 0.5), slack=0))
    assert anything["open_from"] == 0.5
    assert 0 < seen.bearing_error_deg(anything) < 20
    assert seen.bearing_error_deg(tune.preset(0.8, tune.LADDER[0])) is None  # none is told
    votes = anything["limits"]["clearance"]
    # nothing speaks for any rung: of equals the most careful
    assert votes == {"vote_blocks": 0.9, "vote_alone": 0.95, "vote_frees": 0.95}


def test_of_rungs_that_few_images_cannot_tell_apart_the_most_careful_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tune, "LADDER", (0.3, 0.4, 0.5, 0.6, 0.7, 0.8))
    clear = dict(zip(tune.LADDER, (0.5, 0.63, 0.7, 0.68, 0.66, 0.6), strict=True))

    def score(rung: float, repeats: int) -> dict[str, Interval]:
        rates = zip(tune.RATES, (0.0, 0.0, clear[rung]), strict=True)
        return {name: Interval(value, value, value, 50) for name, value in rates}

    monkeypatch.setattr(tune.direction, "score", score)
    seen = tune.Tuning()
    monkeypatch.setattr(seen, "records", lambda point: point["limits"]["clearance"]["vote_blocks"])
    for slack, best in ((0.0, 2), (0.03, 3), (0.05, 4), (0.15, 5)):
        point = tune.tune(seen, tune.Goal(0.1, 0.1, slack=slack))
        assert point["limits"]["clearance"]["vote_blocks"] == tune.LADDER[best]


def test_presets_come_with_the_file(tmp_path: Path, cli: Cli) -> None:
    site, run = write_site(tmp_path / "site", rooms=4), tmp_path / "run"
    factories.doornet(run / "doornet.onnx")
    rows = [f"site,room{r:02d}/{n}.png,{r},{1 + r % 2}" for r in range(4) for n in range(4)]
    (run / "held-out.csv").write_text("\n".join(["source,image,place,half", *rows]) + "\n")
    for half in (1, 2):
        factories.doornet(run / f"half-{half}.onnx")
    card = {"held_out": None, "calibration": {}, "depth_error": 0.1, "thresholds": {}}
    (run / "doornet.json").write_text(json.dumps(card))
    ran = cli("train", "limits", run, site)
    assert ran.status != 0 and "nothing held out" in ran.err
    (run / "doornet.json").write_text(json.dumps(card | {"held_out": "1/4"}))
    ran = cli("train", "limits", run, site)
    assert ran.status == 0 and "cautious" in ran.out
    network = DoorNet(run / "doornet.onnx")
    assert list(network.presets) == ["balanced", "cautious", "eager"]
    assert network.thresholds == network.presets["balanced"]["limits"]
    assert Pipeline(network).params == Pipeline(network, preset="balanced").params
    assert Pipeline(network, preset="cautious").gates.open_from >= 0.5
    assert json.loads((run / "doornet.json").read_text())["presets"] == network.presets
    assert list(DoorNet(run / "half-2.onnx").presets) == ["balanced", "cautious", "eager"]
