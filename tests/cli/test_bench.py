"""`3ds bench`: what it measures and how it labels it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image
from doorway3ds.lab import benchmark
from tests import factories
from tests.conftest import Cli


def result() -> dict[str, Any]:
    (path,) = Path("res").iterdir()
    return json.loads(path.read_text())


def test_stages_cold_start_and_memory(cli: Cli) -> None:
    ran = cli("bench", "--network", "net.onnx", "--repeat", 5, "--starts", 1, "--out", "res")
    assert ran.status == 0, ran.err
    (network,) = result()["networks"]
    stages = {name: ms["median"] for name, ms in network["stages_ms"].items()}
    assert list(stages) == ["decode", "prepare", "network", "selection", "decision", "total"]
    assert sum(stages.values()) - stages["total"] <= stages["total"] * 1.1
    assert len(network["samples_ms"]) == 5
    assert 0.05 < network["process"]["start_s"]["median"] < 60
    assert 30 < network["process"]["peak_mb"] < 1000
    for word in ("decode", "cold start", "peak memory", "budget 33 ms"):
        assert word in ran.out
    assert result()["image"] == {"name": "made up", "width": 640, "height": 480}


def test_two_networks_as_a_ratio_and_random_weights_labelled(cli: Cli) -> None:
    factories.doornet(Path("raw.onnx"), metadata=factories.METADATA | {"weights": "random"})
    names = ("--network", "net.onnx", "--network", "raw.onnx")
    ran = cli("bench", *names, "--repeat", 20, "--starts", 0, "--out", "res")
    assert ran.status == 0, ran.err
    assert [n["weights"] for n in result()["networks"]] == ["trained", "random"]
    assert "raw.onnx (opening, random weights: only its timing means anything)" in ran.out
    (ratio,) = result()["ratios"]
    low, high = ratio["interval"]
    assert low <= ratio["total"] <= high
    assert "net.onnx takes" in ran.out


def test_ratio_of_known_samples() -> None:
    stage = {"network": {"median": 3.0}}
    slow = {"name": "a", "samples_ms": [30.0, 31.0, 29.0], "stages_ms": stage}
    fast = {"name": "b", "samples_ms": [10.0, 11.0, 9.0], "stages_ms": stage}
    found = benchmark.ratio(slow, fast)
    assert found["total"] == 3.0
    assert found["network_stage"] == 1.0
    assert 29 / 11 - 1e-9 <= found["interval"][0] <= 3.0 <= found["interval"][1] <= 31 / 9 + 1e-9


def test_the_paper_s_networks_run_the_paper_s_method(cli: Cli) -> None:
    factories.cnn_srin(Path("c.onnx"))
    factories.densedepth(Path("d.onnx"))
    pair = ("--network", "c.onnx+d.onnx")
    ran = cli("bench", *pair, "--repeat", 3, "--starts", 1, "--out", "res")
    assert ran.status == 0, ran.err
    assert result()["networks"][0]["method"] == "paper"


def test_wrong_calls(cli: Cli) -> None:
    assert cli("bench", "--network", "a", "--network", "b", "--network", "c").status == 2
    assert cli("bench", "--repeat", "1").status == 2
    assert cli("bench", "--network", "magic").status == 2
    assert cli("bench", "--network", "none.onnx").status == 1
    assert cli("bench", "--image", "none.jpg").status == 1


def test_a_start_that_fails_says_why(cli: Cli) -> None:
    result = {"name": "none.onnx", "method": "opening"}
    with pytest.raises(UserError, match=r"^no network file none\.onnx"):
        benchmark.measure_starts(result, benchmark.made_up_jpeg(), 1)


def test_the_made_up_picture_is_a_vga_jpeg_and_always_the_same() -> None:
    data = benchmark.made_up_jpeg()
    assert data == benchmark.made_up_jpeg()
    assert read_image(data).image.shape == (480, 640, 3)
