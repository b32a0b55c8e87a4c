"""The paper's networks from pictures to `3ds look`: train, resume, export, report, import."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("matplotlib")
from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.engine.training import Run
from doorway3ds.lab.train.options import DepthOptions
from doorway3ds.lab.train.paper import densedepth
from doorway3ds.lab.train.paper.densedepth import NYU
from doorway3ds.lab.train.paper.depthpairs import read_depth_pairs
from doorway3ds.lab.train.paper.depthrun import DepthTraining
from tests import factories
from tests.conftest import Cli
from tests.factories import classes, depth_pairs
from tests.lab.train import keras1

pytestmark = pytest.mark.train

TINY = (1, 1, 1, 1)
SMALL = replace(NYU, height=64, width=96)


def answers(cli: Cli) -> dict[str, object]:
    ran = cli(
        "look", "photo.jpg", "--json", "--method", "paper", "--network", "cnn-srin+densedepth"
    )
    assert ran.status == 0, ran.err
    return json.loads(ran.out)


def test_cnn_srin_from_two_folders_to_look(cli: Cli, tmp_path: Path) -> None:
    classes(tmp_path / "data", 4)
    (tmp_path / "data" / "open-door" / "bad.jpg").write_bytes(b"no image")
    call = ("train", "cnn-srin", "data", "--weights", "none", "--batch", 4, "--out", "run")
    call += ("--threads", 1, "--validation", 0.3, "--licence", "CC0-1.0")
    ran = cli(*call, "--epochs", 2, "--copies", 1, "--fine-tune", 1)
    assert ran.status == 0, ran.err
    assert "8 images, 8 groups by near-duplicates" in ran.err and "left out: 1" in ran.err
    assert "near-copies across the split: 0" in ran.out
    card = json.loads(Path("run/cnn-srin.json").read_text())
    assert card["parity"] <= 1e-3
    assert card["pictures"]["train"] == {"no-door": 3, "open-door": 3}
    assert card["initialised_from"] == "none"
    assert "bad.jpg" in str(card["left_out"])
    with Path("run/checkpoint.csv").open() as file:
        assert [row["epoch"] for row in csv.DictReader(file)] == ["1", "2"]
    assert Path("run/fine-tune-after-2.csv").is_file()
    page = Path("run/report.html").read_text()
    for words in ("open, called not open", "ROC", "Calibration", "bad.jpg"):
        assert words in page
    for name in ("roc", "reliability", "curve-loss", "curve-accuracy"):
        assert Path(f"run/{name}.png").read_bytes().startswith(b"\x89PNG")

    installed = tmp_path / "models" / "cnn-srin.onnx"
    assert installed.read_bytes() == Path("run/cnn-srin.onnx").read_bytes()
    told = json.loads(installed.with_suffix(".json").read_text())
    assert (told["licence"], told["parity"]) == ("CC0-1.0", card["parity"])
    factories.densedepth(tmp_path / "models" / "densedepth.onnx")
    assert 0 <= float(str(answers(cli)["p_open"])) <= 1

    Path("data/open-door/bad.jpg").unlink()
    ran = cli("eval", "classifier", "data", "--network", "cnn-srin", "--repeats", 0)
    assert ran.status == 0, ran.err
    assert "open, called not open" in ran.out


def test_densedepth_from_pairs_to_look(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(densedepth, "DENSENET_169", TINY)
    depth_pairs(tmp_path / "data", 3)
    call = ("train", "densedepth", "data", "--unit-m", 0.001, "--weights", "none", "--out", "run")
    call += ("--batch", 2, "--epochs", 1, "--validation", 0.3, "--threads", 1)
    ran = cli(*call)
    assert ran.status == 0, ran.err
    assert "median depth 2.50 m" in ran.err
    assert "held out: delta1" in ran.out
    card = json.loads(Path("run/densedepth.json").read_text())
    assert card["parity"] <= 1e-3 and card["depth_error"] > 0
    assert "Worst of held out" in Path("run/report.html").read_text()
    factories.cnn_srin(tmp_path / "models" / "cnn-srin.onnx")
    assert str(answers(cli)["network"]) == "cnn-srin+densedepth"


def test_published_files_are_imported(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine.start(1)
    monkeypatch.setattr(densedepth, "DENSENET_169", TINY)
    model = densedepth.build_densedepth("none", size=(64, 96))
    layers = keras1.of_model(model, np.random.default_rng(0))
    keras1.write(tmp_path / "nyu.h5", layers, whole_model=True)
    ran = cli("models", "import", "densedepth", "nyu.h5")
    assert ran.status == 0, ran.err
    assert (tmp_path / "models" / "densedepth.onnx").is_file()
    ran = cli("models", "import", "cnn-srin", "nyu.h5")
    assert ran.status == 1 and "two dense layers after VGG16's" in ran.err
    assert cli("models", "import", "doornet", "nyu.h5").status == 2
    assert cli("models", "import", "densedepth", "other.keras").status == 1


def test_a_frozen_encoder_stays_and_a_resumed_run_equals_a_whole_one(tmp_path: Path) -> None:
    engine.start(1)
    pairs = read_depth_pairs(depth_pairs(tmp_path / "data", 6), SMALL, unit_m=0.001)
    options = DepthOptions(
        epochs=2, batch=2, weights="none", freeze_encoder=True, validation=0.3, learning_rate=1e-3
    )

    def train(out: Path, resume: bool = False, **changed: object) -> None:
        chosen = replace(options, **changed)  # type: ignore[arg-type]
        run = Run(out, resume)
        DepthTraining(pairs, chosen, run, blocks=TINY, setting=SMALL)()

    def weights(out: Path) -> dict[str, np.ndarray]:
        with np.load(out / "checkpoint.npz") as file:
            return {k: file[k] for k in file.files if k.startswith("w")}

    train(tmp_path / "whole")
    train(tmp_path / "cut", epochs=1)
    first = weights(tmp_path / "cut")
    train(tmp_path / "cut", resume=True)
    whole, cut = weights(tmp_path / "whole"), weights(tmp_path / "cut")
    assert all(np.array_equal(whole[k], cut[k]) for k in whole)
    model = densedepth.build_densedepth("none", size=(64, 96), blocks=TINY)
    count = sum(len(layer.weights) for layer in densedepth.encoder_layers(model))
    names = sorted(whole, key=lambda name: int(name[1:]))
    assert all(np.array_equal(first[n], whole[n]) for n in names[:count])
    assert not any(np.array_equal(first[n], whole[n]) for n in names[count:])

    with pytest.raises(UserError, match="is of another training"):
        train(tmp_path / "cut", resume=True, freeze_encoder=False)


def test_wrong_calls(cli: Cli, tmp_path: Path) -> None:
    classes(tmp_path / "data", 2)
    assert cli("train", "cnn-srin", "data", "--weights", "none.h5").status == 1
    assert cli("train", "cnn-srin", "data", "--precision", "half").status == 2
    assert cli("train", "cnn-srin", "data", "--half-open", "ajar").status == 2
    assert cli("train", "cnn-srin", "nowhere").status == 1
    depth_pairs(tmp_path / "pairs", 2)
    assert cli("train", "densedepth", "pairs").status == 2
    ran = cli("train", "densedepth", "pairs", "--unit-m", 1)
    assert ran.status == 1 and "is the unit right?" in ran.err
