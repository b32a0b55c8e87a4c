"""`3ds reproduce` as a user calls it, without a training."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tests.conftest import Cli
from tests.factories import encode, scene


@pytest.fixture
def twelve(cli: Cli) -> Path:
    """Six pictures in each of two classes."""
    for name in ("open-door", "no-door"):
        folder = Path("twelve") / name
        folder.mkdir(parents=True)
        for index in range(6):
            (folder / f"{index}.jpg").write_bytes(encode(scene(160, 120)))
    return Path("twelve")


def test_alone_it_does_what_needs_no_data(cli: Cli) -> None:
    ran = cli("reproduce", "--json")
    assert ran.status == 0, ran.err
    told = json.loads(ran.out)
    assert len(told["tables_3_and_4"]) == 14
    assert all(row["agrees"] for row in told["tables_3_and_4"])
    assert told["tables_1_and_2"] is None and told["table_2"]["here"] is None
    assert told["not_rerun"]
    ran = cli("reproduce")
    assert "contradict" in ran.out and "authors'" in ran.out
    assert not Path("report.html").exists()


def test_twelve_pictures_and_a_report(cli: Cli, twelve: Path) -> None:
    ran = cli("reproduce", "--pictures", twelve, "--network", "net.onnx", "--json", "--out", "rep")
    assert ran.status == 0, ran.err
    told = json.loads(ran.out)
    assert told["table_2"] == {
        "printed": {"tn": 5, "fp": 1, "tp": 5, "fn": 1},
        "here": {"tn": 0, "fp": 6, "tp": 6, "fn": 0},  # the test's network sees a door everywhere
    }
    answer = told["tables_1_and_2"][0]
    assert (answer["method"], answer["network"]) == ("paper", "net.onnx")
    assert answer["camera"] == {"name": "fov 60.9 deg", "assumed": False}
    assert json.loads(Path("rep/report.json").read_text()) == told
    page = Path("rep/report.html").read_text()
    assert "Tables 3 and 4" in page and "open-door/5.jpg" in page and "–" in page
    ran = cli("reproduce", "--pictures", twelve, "--network", "net.onnx", "--json", "--fov-deg", 50)
    wide, narrow = (t["bearing_deg"] for t in (answer, json.loads(ran.out)["tables_1_and_2"][0]))
    assert narrow == pytest.approx(wide * 50 / 60.9)


def test_wrong_calls_are_one_line(cli: Cli, twelve: Path) -> None:
    (twelve / "no-door" / "0.jpg").unlink()
    for call, status, message in (
        (("--pictures", twelve), 1, "expected 12 images"),
        (("--pictures", "nowhere"), 1, "expected a folder"),
        (("--dataset", twelve), 2, "--dataset trains; add --out"),
        (("--pictures", twelve, "--fov-deg", 0), 2, "--fov-deg"),
    ):
        ran = cli("reproduce", *call, "--network", "net.onnx")
        assert ran.status == status
        assert message in ran.err and ran.err.count("\n") == 1


def test_a_training_without_its_extra_is_an_install_hint(
    cli: Cli, twelve: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "keras", None)
    ran = cli("reproduce", "--dataset", twelve, "--out", "rep")
    assert ran.status == 1
    assert "pip install 'doorway3ds[train]'" in ran.err
    assert not Path("rep").exists()
