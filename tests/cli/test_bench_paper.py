"""`3ds bench --against-paper`: a network beside the paper's pair."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from doorway3ds.lab.train.paper import convert
from tests import factories
from tests.conftest import Cli


def test_the_pair_is_made_where_it_is_not_installed(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []

    def write(name: str, path: Path) -> None:
        made.append(name)
        factories.densedepth(path)

    monkeypatch.setattr(convert, "write_untrained", write)
    factories.cnn_srin(tmp_path / "models" / "cnn-srin.onnx")
    options = ("--against-paper", "--network", "net.onnx", "--repeat", 3, "--starts", 0)
    ran = cli("bench", *options, "--out", "res")
    assert ran.status == 0, ran.err
    assert made == ["densedepth"]
    (path,) = Path("res").iterdir()
    report = json.loads(path.read_text())
    assert [n["method"] for n in report["networks"]] == ["paper", "opening"]
    assert report["ratios"][0]["of"] == ["cnn-srin+densedepth", "net.onnx"]
    assert "cnn-srin+densedepth takes" in ran.out
    assert cli("bench", "--against-paper", "--network", "a", "--network", "b").status == 2
