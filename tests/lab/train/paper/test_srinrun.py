"""CNN-SRIN scored at several numbers of epochs, and `3ds reproduce` with a data set."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("matplotlib")
from doorway3ds.lab.datasets.doors import read_door_pictures
from doorway3ds.lab.evaluate.intervals import plain
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.engine.training import Run
from doorway3ds.lab.train.options import SrinOptions
from doorway3ds.lab.train.paper.srinrun import score_epochs
from tests.conftest import Cli
from tests.factories import classes

pytestmark = pytest.mark.train


def weights(folder: Path) -> dict[str, np.ndarray]:
    with np.load(folder / "checkpoint.npz") as file:
        return {name: file[name] for name in file.files if name.startswith("w")}


def test_one_training_read_at_several_epochs_is_as_good_as_several(tmp_path: Path) -> None:
    engine.start(1)
    pictures = read_door_pictures(classes(tmp_path / "data", 6))
    options = SrinOptions(weights="none", validation=0.4, batch=4)
    read = score_epochs(pictures, options, Run(tmp_path / "read"), (1, 3), 32)
    alone = score_epochs(pictures, options, Run(tmp_path / "alone"), (3,), 32)
    early = score_epochs(pictures, options, Run(tmp_path / "early"), (1,), 32)
    one, three = weights(tmp_path / "alone"), weights(tmp_path / "read")
    assert all(np.array_equal(one[name], three[name]) for name in one)
    assert read.history == alone.history and len(read.history) == 3
    assert plain(read.scored[3]) == plain(alone.scored[3])
    assert plain(read.scored[1]) == plain(early.scored[1])
    assert read.leaks == 0


def test_reproduce_trains_and_sets_it_beside_the_paper(cli: Cli, tmp_path: Path) -> None:
    classes(tmp_path / "data", 4)
    call = ("reproduce", "--dataset", "data", "--weights", "none", "--validation", 0.3)
    ran = cli(*call, "--threads", 1, "--out", "rep", "--json")
    assert ran.status == 0, ran.err
    told = json.loads(ran.out)
    assert [row["epochs"] for row in told["epochs"]] == [10, 20, 30]
    assert all(row["here"]["pictures"] == 2 for row in told["epochs"])
    assert told["data"].startswith("data: 4 no-door and 4 open-door images, 8 groups by")
    assert told["near-copies across the split"] == "0"
    page = Path("rep/report.html").read_text()
    assert "VGG16 was random" in page and "here, held out" in page
    assert Path("rep/epochs.png").read_bytes().startswith(b"\x89PNG")
    ran = cli("reproduce", "--dataset", "nowhere", "--out", "rep")
    assert ran.status == 1 and "expected a folder" in ran.err
