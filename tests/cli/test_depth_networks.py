"""Anybody's depth network beside a classifier, through the commands."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.cli.main import run
from doorway3ds.networks.depth.presets import METRIC, RELATIVE
from doorway3ds.networks.registry import install
from tests import factories
from tests.conftest import Cli
from tests.factories import encode, scene

METRES = "depth: {unit: cm, short_side: 56, multiple: 14, focal_px: 100}\n"
NO_METRES = "depth: {unit: relative-inverse, width: 64, height: 48}\n"


def network(name: str, sidecar: str, gain: float = 0.0, offset: float = 250.0) -> str:
    """A file beside net.onnx and its sidecar, joined with the doorway network."""
    factories.depth_file(Path(f"{name}.onnx"), gain=gain, offset=offset)
    Path(f"{name}.yaml").write_text(sidecar)
    return f"net.onnx+{name}.onnx"


def test_look_with_metres_by_a_sidecar(cli: Cli) -> None:
    joined = network("mine", METRES)
    for method in ("opening", "paper"):
        ran = cli(
            *("look", "--json", "photo.jpg", "--network", joined, "--method", method),
            *("--fov-deg", "60.9", "--depth-dir", "depth"),
        )
        assert ran.status == 0, ran.err
        assert json.loads(ran.out)["network"] == joined
        depth = np.load(Path("depth") / "photo.npy")
        Path("depth/photo.npy").unlink()
        assert depth.shape == (56, 70)
        # 2.5 m at 100 px; this lens has 80 / tan(30.45 deg) px at 160x120
        focal = 80 / np.tan(np.radians(60.9 / 2)) * np.sqrt(70 / 160 * 56 / 120)
        assert depth == pytest.approx(2.5 * focal / 100, rel=1e-5)


def test_live_with_metres_by_a_sidecar(cli: Cli) -> None:
    joined = network("mine", METRES)
    ran = cli("live", "photo.jpg", "--json", "--frames", 1, "--network", joined)
    assert ran.status == 0, ran.err
    assert json.loads(ran.out)["network"] == joined


def test_relative_depth_needs_the_lens_height(cli: Cli) -> None:
    joined = network("rel", NO_METRES, gain=1.0)
    ran = cli("look", "--json", "photo.jpg", "--network", joined)
    assert ran.status == 1
    (line,) = ran.err.splitlines()
    assert "expected the lens height, got none; give --height-m" in line
    ran = cli("live", "photo.jpg", "--json", "--network", joined)
    assert ran.status == 1
    assert ran.err.count("\n") == 1
    ran = cli("look", "--json", "photo.jpg", "--network", joined, "--height-m", 0.5)
    assert ran.status == 0, ran.err
    assert json.loads(ran.out)["network"] == joined


def test_relative_depth_needs_a_floor(cli: Cli) -> None:
    network("rel", NO_METRES)
    factories.cnn_srin(Path("srin.onnx"))
    ran = cli(
        *("look", "photo.jpg", "--method", "paper", "--network", "srin.onnx+rel.onnx"),
        *("--height-m", 0.5),
    )
    assert ran.status == 2
    (line,) = ran.err.splitlines()
    assert (
        "returns depth without metres, which are needed here; join one that returns floor" in line
    )


@pytest.mark.parametrize(
    ("sidecar", "part"),
    [
        ("depth: {unit: yards, short_side: 56}\n", "mine.yaml: depth expects unit to be one of m"),
        ("depth: {unit: m}\n", "mine.onnx: expected a fixed size, or width and height"),
        ("licence: MIT\n", "mine.yaml beside it that says what its depth is"),
        ("depth: [\n", "model card mine.yaml cannot be read"),
    ],
)
def test_sidecars_are_refused_in_one_line(cli: Cli, sidecar: str, part: str) -> None:
    ran = cli("look", "photo.jpg", "--network", network("mine", sidecar))
    assert ran.status == 2
    (line,) = ran.err.splitlines()
    assert part in line


def test_a_preset_is_imported_and_used_by_name(cli: Cli) -> None:
    factories.depth_file(Path("da.onnx"), gain=0.1, offset=2.0)
    assert cli("models", "import", METRIC, "da.onnx").status == 0
    assert cli("models", "import", RELATIVE, "net.onnx").status == 1
    ran = cli("look", "--json", "photo.jpg", "--network", f"net.onnx+{METRIC}")
    assert ran.status == 0, ran.err
    assert json.loads(ran.out)["network"] == f"net.onnx+{METRIC}"


def test_eval_measures_it_beside_others(cli: Cli) -> None:
    for folder in ("images", "depth"):
        Path("rooms", folder).mkdir(parents=True)
    Path("rooms/images/0001.jpg").write_bytes(encode(scene(160, 120)))
    cv2.imwrite("rooms/depth/0001.png", np.full((120, 160), 2500, np.uint16))  # millimetres
    Path("rooms/doorways.csv").write_text(
        "image,open,left_px,right_px,clear,confidence,second\n0001.jpg,0,,,,3,0\n"
    )
    joined = network("mine", "depth: {unit: m, width: 16, height: 12}\n", offset=2.5)
    assert run(f"eval depth rooms --network {joined} --repeats 0 --json d.json".split()) == 0
    whole = next(r for r in json.loads(Path("d.json").read_text())["runs"] if r["crop"] == "whole")
    assert whole["network"] == joined
    assert whole["metrics"]["abs_rel"]["value"] == pytest.approx(0, abs=1e-4)


def test_the_server_offers_what_is_there_and_can_be_used(cli: Cli) -> None:
    choice = pytest.importorskip("doorway3ds.web.serve.fields")
    from doorway3ds.web.serve.fields import Settings

    made = factories.depth_file(Path("da.onnx"), offset=2.0)
    for name in (METRIC, RELATIVE):
        install(name, made, source="da.onnx")
    pipelines = choice.Pipelines(Settings())
    assert list(pipelines.networks) == ["doornet", f"doornet+{METRIC}", f"doornet+{RELATIVE}"]
    for name in pipelines.networks:
        assert pipelines.methods(name) == ["opening", "paper"]
