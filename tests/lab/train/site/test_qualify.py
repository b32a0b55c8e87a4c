"""Qualification of a site: its pictures in parts without leaks, and what is written."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from doorway3ds.cli.main import run
from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.data.augment import view
from doorway3ds.lab.train.doornet.data.samples import Sample
from doorway3ds.lab.train.doornet.export import export_onnx
from doorway3ds.lab.train.doornet.model import DoorNetConfig, build_doornet
from doorway3ds.lab.train.engine.backend import start
from doorway3ds.lab.train.site.qualify import part, read_replay, read_site
from tests import factories
from tests.factories import write_site


@pytest.fixture(scope="module")
def network(teachers: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An untrained network whose batch norm knows pictures like the site's."""
    torch = pytest.importorskip("torch")
    keras = start(1)
    keras.utils.set_random_seed(4)
    net = build_doornet(
        teachers / "deeplabv3_mnv2_ade20k_512.onnx",
        DoorNetConfig(16, 16, 16, 16, 2, 0.0),
    )
    folder = tmp_path_factory.mktemp("network")
    files = sorted(write_site(folder / "other", rooms=3, each=2).rglob("*.png"))
    images = np.stack([cv2.resize(cv2.imread(str(f))[..., ::-1], (96, 64)) for f in files])
    for layer in net.decoder.layers:
        if isinstance(layer, keras.layers.BatchNormalization):
            layer.momentum = 0.0
    with torch.no_grad():
        net.whole(torch.from_numpy(images.transpose(0, 3, 1, 2).astype(np.float32)), training=True)
    # Training leaves no offset at zero, and a tidied graph leaves out what adds nothing.
    rng = np.random.default_rng(4)
    for weight in net.decoder.trainable_variables:
        values = keras.ops.convert_to_numpy(weight)
        if not values.any():
            weight.assign(rng.normal(0, 0.01, values.shape))
    path = folder / "tiny.onnx"
    export_onnx(net.whole, path, metadata={"depth_error": 0.2})
    return path


@pytest.mark.train
def test_nothing_is_written_when_it_is_not_better(
    network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = write_site(tmp_path / "site", marked=False, rooms=12, each=2)
    out = tmp_path / "made" / "site.onnx"
    arguments = ["qualify", str(site), "--network", str(network), "--out", str(out)]
    assert run([*arguments, "--learning-rate", "1e-9", "--epochs", "1"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("not better: ")
    assert not out.parent.exists()


@pytest.mark.train
def test_ctrl_c_writes_nothing_and_says_so(
    network: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from doorway3ds.lab.train.site import fit as qualifyfit

    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(qualifyfit, "fit", interrupted)
    site = write_site(tmp_path / "site", rooms=12, each=2)
    out = tmp_path / "site.onnx"
    assert run(["qualify", str(site), "--network", str(network), "--out", str(out)]) == 130
    assert "stopped; nothing was written" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("marked", [True, False])
def test_no_place_is_in_two_parts(tmp_path: Path, marked: bool, seed: int) -> None:
    pictures = read_site(write_site(tmp_path / "site", marked=marked))
    parts = part(pictures, 0.4, seed)
    sides = (parts.learn, parts.inner, parts.held)
    places = [{picture.place for picture in side} for side in sides]
    assert sum(map(len, places)) == len(set.union(*places)) == 16
    assert sum(map(len, sides)) == len(pictures.samples) == 64
    for side in sides:
        assert {picture.is_open for picture in side} == {True, False}
    assert parts == part(pictures, 0.4, seed)


def test_what_is_not_marked_counts_by_its_folder(tmp_path: Path) -> None:
    site = write_site(tmp_path / "site", marked=False)
    (site / "doorways.csv").write_text(
        "image,open,left_px,right_px,place\nno-door/room00/1.png,1,10,50,room00\n"
    )
    samples = {s.name: s for s in read_site(site).samples}
    assert len(samples) == 64
    assert samples["no-door/room00/1.png"].is_open
    assert samples["no-door/room00/1.png"].openings[0].right_px == 50
    assert not samples["no-door/room00/3.png"].is_open


@pytest.mark.parametrize(
    ("rooms", "each", "gone", "message"),
    [
        (3, 6, "", "shows 3 places .* at least 8 are needed"),
        (3, 4, "", "has 6 readable images of class no-door; at least 8"),
        (8, 2, "open-door", "no readable image of class open-door; two classes are needed"),
    ],
)
def test_too_little_is_refused_in_one_line(
    tmp_path: Path, rooms: int, each: int, gone: str, message: str
) -> None:
    site = write_site(tmp_path / "site", marked=False, rooms=rooms, each=each)
    if gone:
        for file in (site / gone).rglob("*.png"):
            file.unlink()
    with pytest.raises(UserError, match=message):
        read_site(site)


def test_a_places_file_that_leaves_an_image_out_is_refused(tmp_path: Path) -> None:
    site = write_site(tmp_path / "site", marked=False)
    with pytest.raises(UserError, match=r"names no place for no-door/room00/1\.png"):
        read_site(site, places={"no-door/room00/0.png": "hall"})


def test_unreadable_pictures_are_left_out_and_named(tmp_path: Path) -> None:
    site = write_site(tmp_path / "site")
    (site / "room03" / "0.png").write_bytes(b"no image")
    pictures = read_site(site)
    assert list(pictures.left_out) == ["room03/0.png"]
    assert len(pictures.samples) == 63


def test_near_copies_of_what_judges_are_not_replayed(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for folder in ("site", "other"):
        (tmp_path / folder / "open-door").mkdir(parents=True)
    for number in range(3):
        small = rng.integers(0, 255, (12, 16, 3), dtype=np.uint8)
        image = cv2.resize(small, (320, 240), interpolation=cv2.INTER_CUBIC)
        if number < 2:
            cv2.imwrite(str(tmp_path / "site" / "open-door" / f"{number}.png"), image)
        if number > 0:
            copy = cv2.resize(image[:, ::-1], (160, 120), interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(tmp_path / "other" / "open-door" / f"{number}.jpg"), copy)
    from doorway3ds.lab.datasets.readers import read_dataset

    judged = read_dataset(tmp_path / "site").samples
    samples, left_out = read_replay([tmp_path / "other"], judged)
    assert [s.name for s in samples] == ["open-door/2.jpg"]
    assert left_out == 1


def test_an_unmarked_opening_teaches_p_open_and_no_column() -> None:
    image = np.zeros((120, 160, 3), np.uint8)
    sample = Sample("a", "site", "room", image, (140, 140, 79.5, 59.5), 1, ())
    rng = np.random.default_rng(0)
    for target in (view(sample, (192, 256), None), view(sample, (192, 256), rng)):
        assert (target.p_open, target.p_open_weight) == (1, 1)
        assert not target.score_weight.any()
    # a portrait window leaves most of the picture out: perhaps the opening
    assert view(sample, (256, 192), rng).p_open_weight == 0
    closed = view(replace(sample, open=0), (192, 256), None)
    assert (closed.p_open, closed.score_weight.min()) == (0, 1)


def test_stored_answers_of_two_networks_are_judged_by_the_same_rule(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = write_site(tmp_path / "site", marked=False, rooms=10, each=2)
    net = factories.doornet(tmp_path / "net.onnx")  # sees a doorway everywhere
    capsys.readouterr()
    assert run(["look", str(site), "--recursive", "--json", "--network", str(net)]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    for name in ("before", "after"):
        for line in lines:
            if name == "after" and "no-door" in line["image"]:
                line.update(p_open=0.01, open=False, reason="no_door")
        (tmp_path / name).write_text("".join(json.dumps(line) + "\n" for line in lines))
    call = ["qualify", str(site), "--json", "-"]
    for first, second, better in (("before", "after", True), ("after", "before", False)):
        both = ["--answers", str(tmp_path / first), "--answers", str(tmp_path / second)]
        assert run([*call, *both]) == 0
        said = capsys.readouterr()
        found = json.loads(said.out)
        assert found["better"] is better and "depth is not compared" in said.err
        assert found["held_out"]["difference"]["refused"]["value"] == (1 if better else -1)
    assert run([*call, "--answers", str(tmp_path / "after")]) == 2
    assert "give it twice, before and after" in capsys.readouterr().err
