"""The whole chain on a tiny data set: read, train, resume, calibrate, export, look."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")
os.environ["KERAS_BACKEND"] = "torch"  # before Keras is first imported
pytest.importorskip("keras")

from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera
from doorway3ds.cli.main import run
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.errors import UserError
from doorway3ds.networks.doornet import DoorNet

pytestmark = pytest.mark.train

RECIPE = """
seed: 2
batch: 4
steps_per_epoch: 3
stages:
  - {epochs: 1, learning_rate: 0.001}
  - {epochs: 1, learning_rate: 0.0003, thaw: [40, 27]}
network: {width_16: 8, width_8: 8, width_4: 8, width_columns: 8, attention_heads: 2, dropout: 0.1}
costs: {missed: 2, false_near: 4, near_m: 0.01, far_m: 0.02}
"""


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "recipe.yaml"
    path.write_text(RECIPE)
    return path


@pytest.fixture
def marked(tmp_path: Path) -> Path:
    """Eight photographs of two sizes marked by hand, of four rooms; a camera file, no depth."""
    folder = tmp_path / "site"
    rng = np.random.default_rng(8)
    rows = ["image,open,left_px,right_px,clear,confidence,second,state,place"]
    for index in range(8):
        width, height = ((160, 120), (320, 240))[index % 2]
        name = f"room{index // 2}/{index}.png"
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        image = rng.integers(40, 60, (height, width, 3), dtype=np.uint8)
        image[:, width // 2 : width * 3 // 4] = 220
        cv2.imwrite(str(folder / name), image)
        span = f"{width / 2 - 0.5},{width * 3 / 4 - 0.5}"
        rows.append(
            (
                f"{name},1,{span},1,3,0,open,room{index // 2}",
                f"{name},0,,,,2,0,closed,room{index // 2}",
                f"{name},1,{span},,1,0,half,room{index // 2}",
            )[index % 3]
        )
    (folder / "doorways.csv").write_text("\n".join(rows) + "\n")
    write_camera_info(Camera("lens", 640, 480, 600, 610, 320, 240), folder / "camera.yaml")
    return folder


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


def test_photographs_marked_by_hand_are_samples_without_depth(marked: Path) -> None:
    from doorway3ds.lab.train.doornet.data.samples import read_marked

    samples = read_marked(marked, longer=200)
    assert [s.open for s in samples] == [1, 0, None, 1, 0, None, 1, 0]
    assert [s.weight for s in samples[:3]] == [1.0, 0.8, 0.4]
    assert [s.place for s in samples[:3]] == ["site-room0", "site-room0", "site-room1"]
    assert all(s.depth_m is None and s.segments is None for s in samples)
    assert {s.source for s in samples} == {"site"}
    # taken from within the doorway, which covers most of the picture
    text = (marked / "doorways.csv").read_text().replace("79.5,119.5", "9.5,119.5")
    (marked / "doorways.csv").write_text(text)
    assert [s.weight for s in read_marked(marked)[:3]] == pytest.approx([0.3, 0.8, 0.12])
    whole, _, _, halved = samples[:4]
    assert (whole.image.shape, halved.image.shape) == ((120, 160, 3), (150, 200, 3))
    assert (whole.spans[0].left, whole.spans[0].right) == (79.5, 119.5)
    assert (halved.spans[0].left, halved.spans[0].right) == (99.5, 149.5)
    # the camera file is for 640x480: a quarter of it, by pixel centres
    assert whole.camera == pytest.approx((150, 152.5, 320.5 / 4 - 0.5, 240.5 / 4 - 0.5))


def test_places_are_those_told_and_those_that_look_alike(marked: Path) -> None:
    from doorway3ds.lab.train.doornet.data.samples import read_marked

    rng = np.random.default_rng(1)
    lines = ["image,open,left_px,right_px,place"]
    for index in range(8):
        image = cv2.resize(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8), (160, 120))
        if index == 0:
            first = image
        if index == 7:  # the first again, mirrored and larger
            image = cv2.resize(np.ascontiguousarray(first[:, ::-1]), (320, 240))
        name = f"room{index // 2}/{index}.png"
        cv2.imwrite(str(marked / name), image)
        lines.append(f"{name},1,10,90,{'attic' if index in (2, 5) else ''}")
    (marked / "doorways.csv").write_text("\n".join(lines) + "\n")
    (marked / "camera.yaml").unlink()
    places = [s.place for s in read_marked(marked)]
    assert places[0] == places[7]
    assert places[2] == places[5]
    assert len(set(places)) == 6


def test_encoders_run_alike_in_keras_and_in_onnx_runtime(teachers: Path) -> None:
    import keras
    import torch

    keras.config.set_image_data_format("channels_first")
    from doorway3ds.lab.train.doornet.export import OnnxEncoder
    from doorway3ds.lab.train.doornet.model import DoorNetConfig, build_doornet

    small = DoorNetConfig(8, 8, 8, 8, 2, 0.0)
    net = build_doornet(
        teachers / "deeplabv3_mnv2_ade20k_512.onnx", teachers / "fastdepth_nyu_224.onnx", small
    )
    image = np.random.default_rng(1).uniform(0, 255, (2, 3, 64, 96)).astype(np.float32)
    with torch.no_grad():
        expected = net.encoder(torch.from_numpy(image), training=False)
    for got, want in zip(OnnxEncoder(net.encoder)(image), expected, strict=True):
        scale = max(1.0, float(want.abs().max()))
        assert np.abs(got - want.numpy()).max() / scale < 1e-4


def test_places_never_cross_the_split(rendered: Path) -> None:
    from doorway3ds.lab.train.doornet.data.samples import read_rendered
    from doorway3ds.lab.train.doornet.run import split

    samples = read_rendered(rendered)
    for fold in range(3):
        kept, held = split(samples, fold, 3)
        assert {s.place for s in kept}.isdisjoint({s.place for s in held})
        assert len(kept) + len(held) == len(samples)


def test_places_are_found_by_likeness() -> None:
    from doorway3ds.lab.train.doornet.data.samples import cluster_places

    rng = np.random.default_rng(0)
    centres = rng.normal(0, 1, (5, 64))
    one = centres[np.arange(20) % 5] + rng.normal(0, 0.1, (20, 64))
    mirrored = rng.normal(0, 1, (20, 64))
    mirrored[0] = one[3]  # picture 0 is the mirror image of picture 3's place
    places = cluster_places(np.stack([one, mirrored], axis=1).astype(np.float32), 0.8)
    assert places[0] == places[3]
    assert len(set(places)) == 4


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
    net = build_doornet(found.semantic, found.depth, read_recipe(recipe).network)

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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stages: [{epochs: 1, learning_rate: 0.1, warmth: 3}]", "unknown warmth"),
        ("batch: 4", "needs a list `stages`"),
        ("{", "is not valid YAML"),
        ("stages: [{epochs: 1, learning_rate: fast}]", "learning_rate must be a number"),
        ("{stages: [{epochs: 1, learning_rate: 1}], same_place: near}", "same_place must be a n"),
        ("{stages: [{epochs: 1, learning_rate: 1}], closed_weight: -1}", "closed_weight must be"),
        ("{stages: [{epochs: 1, learning_rate: 1}], costs: {missed: 0}}", "must be above 0"),
        ("{stages: [{epochs: 1, learning_rate: 1}], costs: {missed: high}}", "missed must be a n"),
        ("{stages: [{epochs: 1, learning_rate: 1}], costs: 3}", "costs: expected a mapping"),
        ("{stages: [{epochs: 1, learning_rate: 1}], init_share: 1.5}", "a share from 0 to 1"),
        ("{stages: [{epochs: 1, learning_rate: 1}], first_share: 2}", "first_share must be a sh"),
        ("{stages: [{epochs: 1, learning_rate: 1}], shares: 2}", "shares must be a mapping"),
        ("{stages: [{epochs: 1, learning_rate: 1}], shares: {nyu: most}}", "nyu must be a number"),
        ("{stages: [{epochs: 1, learning_rate: 1}], shares: {nyu: .nan}}", "nyu must be a number"),
        ("{stages: [{epochs: 1, learning_rate: 1}], portrait_shares: {nyu: -1}}", "nyu must be a"),
    ],
)
def test_a_wrong_recipe_is_named(tmp_path: Path, text: str, message: str) -> None:
    from doorway3ds.lab.train.doornet.recipe import read_recipe

    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        read_recipe(path)


def test_the_packaged_recipe_is_whole() -> None:
    from doorway3ds.lab.train.doornet.recipe import read_recipe

    recipe = read_recipe()
    assert sum(stage.epochs for stage in recipe.fit.stages) > 0
    assert replace(recipe.fit, seed=3).seed == 3


def test_close_ups_of_closed_doors_count_as_told(tmp_path: Path) -> None:
    from doorway3ds.lab.train.doornet.data.samples import read_doors

    rows = ["image,state,left,top,right,bottom"]
    (tmp_path / "images").mkdir()
    for number, state in enumerate(("closed", "open", "semi", "closed")):
        cv2.imwrite(
            str(tmp_path / "images" / f"{number}.png"), np.full((104, 104, 3), 90, np.uint8)
        )
        rows.append(f"{number}.png,{state},0.2,0.1,0.8,0.9")
    rows.append("3.png,open,0.8,0.1,0.9,0.9")
    (tmp_path / "boxes.csv").write_text("\n".join(rows) + "\n")
    samples = read_doors(tmp_path, {}, closed_weight=1.7)
    assert [sample.open for sample in samples] == [0, 1, None, 1]
    assert [sample.weight for sample in samples] == [1.7, 1.0, 1.0, 1.0]


def test_what_is_no_data_set_is_refused(
    tmp_path: Path, teachers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["train", "doornet", str(tmp_path), "--teachers", str(teachers)]) == 1
    assert "is not a data set" in capsys.readouterr().err
    assert run(["train", "doornet", str(tmp_path), "--teachers", str(tmp_path)]) == 1
    assert "holds no deeplabv3" in capsys.readouterr().err
