"""The whole chain on a tiny data set: read, train, resume, calibrate, export, look."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
os.environ["KERAS_BACKEND"] = "torch"  # before Keras is first imported
pytest.importorskip("keras")

from doorway3ds.cli.main import run
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.networks.doornet import DoorNet

pytestmark = pytest.mark.train

RECIPE = """
seed: 2
batch: 4
steps_per_epoch: 3
stages:
  - {epochs: 1, learning_rate: 0.001}
  - {epochs: 1, learning_rate: 0.0003, thaw: 40}
network: {width_16: 8, width_8: 8, width_4: 8, width_columns: 8, attention_heads: 2, dropout: 0.1}
costs: {missed: 2, false_near: 4, near_m: 0.01, far_m: 0.02}
"""


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "recipe.yaml"
    path.write_text(RECIPE)
    return path


def train(rendered: Path, teachers: Path, recipe: Path, out: Path, *more: str) -> int:
    arguments = ["train", "doornet", str(rendered), "--teachers", str(teachers)]
    arguments += ["--recipe", str(recipe), "--out", str(out), *more]
    return run(arguments)


def test_train_export_and_look(
    rendered: Path, marked: Path, teachers: Path, recipe: Path, tmp_path: Path
) -> None:
    from doorway3ds.lab.train.doornet.export import set_metadata

    out = tmp_path / "run"
    more = (str(marked), "--hold-out", "1/3", "--report", "3", "--threads", "1")
    assert train(rendered, teachers, recipe, out, *more, "--tensorboard") == 0
    card = json.loads((out / "doornet.json").read_text())
    assert card["pictures"] == {"rendered": 4, "site": 2}
    assert card["held_out_places"] == ["home-0", "home-3", "site-room0", "site-room3"]
    held = (out / "held-out.csv").read_text().splitlines()
    assert held[0] == "source,image,place,half" and held[1].startswith("rendered,")
    assert {line.split(",")[2] for line in held[1:]} == set(card["held_out_places"])
    assert {line.split(",")[3] for line in held[1:]} == {"1", "2"}
    assert (out / "half-1.onnx").is_file() and (out / "half-2.onnx").is_file()
    # float16 storage rounds weights; nothing else may differ
    assert card["parity"] < 0.02
    network = DoorNet(out / "doornet.onnx")
    picture = np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    decision = Pipeline(network)(picture)
    assert 0 <= decision.p_open <= 1
    # the recipe's costs are in the file, and the runtime weighs by them: nothing is that near
    equal = tmp_path / "equal.onnx"
    shutil.copyfile(out / "doornet.onnx", equal)
    set_metadata(equal, {"costs": {}})
    chance = Pipeline(DoorNet(equal))(picture).p_open
    assert decision.p_open == pytest.approx(2 * chance / (1 + chance))
    assert decision.perception.depth_m is not None
    assert decision.perception.depth_m.shape == (96, 128)

    page = (out / "report.html").read_text()
    for words in ("neither training nor calibration has seen", "called open", "Worst depth of"):
        assert words in page
    for stem in ("roc", "reliability", "curve-loss", "curve-depth", "delta1", "depth-rendered"):
        assert (out / f"{stem}.png").read_bytes().startswith(b"\x89PNG")
    rows = json.loads((out / "report.json").read_text())["history"]
    assert [row["epoch"] for row in rows] == [1, 2] and rows[1]["val_loss"] > 0
    assert list((out / "tensorboard").iterdir())

    # resumed: the first stage is loaded, the second is missing and trained again
    first = (out / "stage-0.weights.h5").read_bytes()
    for ending in ("weights.h5", "npz"):
        (out / f"stage-1.{ending}").unlink()
    assert train(rendered, teachers, recipe, out, *more, "--resume") == 0
    assert (out / "stage-0.weights.h5").read_bytes() == first
    assert (out / "stage-1.weights.h5").is_file()


def test_encoders_run_alike_in_keras_and_in_onnx_runtime(teachers: Path) -> None:
    import keras
    import torch

    keras.config.set_image_data_format("channels_first")
    from doorway3ds.lab.train.doornet.export import OnnxEncoder
    from doorway3ds.lab.train.doornet.model import DoorNetConfig, build_doornet

    small = DoorNetConfig(8, 8, 8, 8, 2, 0.0)
    net = build_doornet(teachers / "deeplabv3_mnv2_ade20k_512.onnx", small)
    image = np.random.default_rng(1).uniform(0, 255, (2, 3, 64, 96)).astype(np.float32)
    with torch.no_grad():
        expected = net.encoder(torch.from_numpy(image), training=False)
    for got, want in zip(OnnxEncoder(net.encoder)(image), expected, strict=True):
        scale = max(1.0, float(want.abs().max()))
        assert np.abs(got - want.numpy()).max() / scale < 1e-4


def test_places_never_cross_the_split(rendered: Path) -> None:
    from doorway3ds.lab.train.doornet.data.samples import read_samples
    from doorway3ds.lab.train.doornet.run import split

    samples = read_samples(rendered)
    for fold in range(3):
        kept, held = split(samples, fold, 3)
        assert {s.place for s in kept}.isdisjoint({s.place for s in held})
        assert len(kept) + len(held) == len(samples)


def test_what_was_learned_is_blended_with_what_it_began_with(
    rendered: Path,
    teachers: Path,
    recipe: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from doorway3ds.lab.train.doornet.model import build_doornet
    from doorway3ds.lab.train.doornet.recipe import read_recipe
    from doorway3ds.lab.train.doornet.run import Teachers, load_weights

    first, second = tmp_path / "first", tmp_path / "second"
    recipe.write_text(RECIPE + "first_share: 0.5\n")
    assert train(rendered, teachers, recipe, first) == 0
    recipe.write_text(RECIPE.replace("seed: 2", "seed: 5") + "init_share: 0.25\n")
    init = first / "stage-1.weights.h5"
    assert train(rendered, teachers, recipe, second, "--init", str(init)) == 0

    found = Teachers.in_folder(teachers)
    net = build_doornet(found.semantic, read_recipe(recipe).network)

    def weights(path: Path) -> list[np.ndarray]:
        load_weights(net, path)
        return [weight.value.detach().numpy().copy() for weight in net.whole.weights]

    names = ("stage-0.weights.h5", "stage-1.weights.h5", "blend.weights.h5")
    stages = [weights(first / name) for name in names]
    assert any(not np.allclose(a, b, atol=1e-4) for a, b, _ in zip(*stages, strict=True))
    for began, learned, kept in zip(*stages, strict=True):
        assert np.allclose(kept, (began + learned) / 2, atol=1e-5)
    held = [weights(path) for path in (init, *(second / name for name in names[1:]))]
    assert any(not np.allclose(a, b, atol=1e-4) for a, b, _ in zip(*held, strict=True))
    for began, learned, kept in zip(*held, strict=True):
        assert np.allclose(kept, 0.25 * began + 0.75 * learned, atol=1e-5)

    capsys.readouterr()
    assert train(rendered, teachers, recipe, tmp_path / "third") == 1
    assert "give --init FILE" in capsys.readouterr().err


def test_what_is_no_data_set_is_refused(
    tmp_path: Path, teachers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["train", "doornet", str(tmp_path), "--teachers", str(teachers)]) == 1
    assert "has neither doorways.csv" in capsys.readouterr().err
    assert run(["train", "doornet", str(tmp_path), "--teachers", str(tmp_path)]) == 1
    assert "holds no deeplabv3" in capsys.readouterr().err
