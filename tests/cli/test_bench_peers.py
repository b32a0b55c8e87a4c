"""`3ds bench --against peers`: a network beside what would be taken today."""

from __future__ import annotations

import json
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from doorway3ds.lab import peers
from tests.conftest import Cli


def test_the_peers_take_turns_with_a_network(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    monkeypatch.setattr(peers, "DETECTOR_SIDE", 64)
    monkeypatch.setattr(peers, "DEPTH_SIDE", 28)
    options = ("--network", "net.onnx", "--repeat", 3, "--starts", 0, "--threads", 1)
    ran = cli("bench", "--against", "peers", *options, "--out", "res")
    assert ran.status == 0, ran.err
    (path,) = Path("res").iterdir()
    *both, own = json.loads(path.read_text())["networks"]
    ways = ["", ", 8 bits", *([", OpenVINO"] if find_spec("openvino") else [])]
    assert [one["name"] for one in both] == [f"detector+depth{way}" for way in ways]
    for one in both:
        assert list(one["stages_ms"]) == ["decode", "prepare", "network", "total"]
        assert (len(one["samples_ms"]), one["weights"]) == (3, "random")
        assert f"{one['name']} (networks alone, random weights: only its timing" in ran.out
        assert f"{one['name']} takes" in ran.out
    assert len(own["samples_ms"]) == 3
    assert ran.out.count("budget") == 1  # the peers make no decision


def test_peers_need_the_extra_and_exclude_the_paper(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran = cli("bench", "--against", "peers", "--against-paper")
    assert (ran.status, "exclude each other" in ran.err) == (2, True)
    monkeypatch.setitem(sys.modules, "torch", None)
    ran = cli("bench", "--against", "peers", "--network", "net.onnx", "--repeat", 3)
    assert ran.status == 1
    assert "pip install 'doorway3ds[train]'" in ran.err
