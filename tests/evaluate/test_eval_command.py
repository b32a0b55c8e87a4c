import json

import numpy as np
import pytest

from doorway3ds.cli.main import run
from doorway3ds.evaluate.datasets import NYU_KINDS
from doorway3ds.networks import registry

from .conftest import HEADER, write_picture
from .test_runners import Oracle


@pytest.fixture(autouse=True)
def oracle(monkeypatch):
    asked = []

    def load(name, *, threads=None, needs=()):
        asked.append(name)
        return Oracle()

    monkeypatch.setattr(registry, "load", load)
    return asked


def numbers(path):
    return json.loads(path.read_text())


def test_direction_writes_table_report_and_answers(nyu, tmp_path, capsys):
    out, answers = tmp_path / "out", tmp_path / "answers.jsonl"
    status = run(f"eval direction {nyu} --repeats 20 --out {out} --save-answers {answers}".split())
    assert status == 0
    assert "bearing within 5 deg" in capsys.readouterr().out
    result = numbers(out / "report.json")
    assert [r["method"] for r in result["runs"]] == ["opening", "paper"]
    opening = result["runs"][0]
    assert (opening["pictures"], opening["doorway_pictures"], opening["places"]) == (3, 2, 2)
    assert opening["metrics"]["within_5deg"]["value"] == 0.5  # 0003's doorway lies elsewhere
    assert opening["metrics"]["go_without_door"]["n"] == 1
    assert len(result["differences_to_first"]) == 1
    again = tmp_path / "again.json"
    assert run(f"eval direction {nyu} --answers {answers} --repeats 20 --json {again}".split()) == 0
    assert numbers(again)["runs"] == result["runs"]


def test_folds_use_their_own_networks_and_score_every_picture(nyu, tmp_path, oracle):
    file = tmp_path / "a.json"
    call = f"eval direction {nyu} --folds 2 --network f{{k}}.onnx --repeats 0 --json {file}"
    assert run(call.split()) == 0
    assert oracle == ["f1.onnx", "f2.onnx"]
    (opening, _) = numbers(file)["runs"]
    assert opening["pictures"] == 3
    assert opening["network"] == "f{k}.onnx"
    assert opening["metrics"]["within_5deg"]["low"] is None


def test_split_and_images_choose_pictures(nyu, tmp_path):
    names = tmp_path / "names.txt"
    names.write_text("# held out\n0045.jpg\n")
    for option in ("--split 2/2", f"--images {names}"):
        file = tmp_path / "a.json"
        call = f"eval direction {nyu} {option} --method opening --repeats 0 --json {file}"
        assert run(call.split()) == 0
        assert numbers(file)["runs"][0]["pictures"] == 1


def test_standard_out_holds_only_json(nyu, capsys):
    assert run(f"eval direction {nyu} --repeats 0 --json -".split()) == 0
    assert json.loads(capsys.readouterr().out)["task"] == "direction"


def test_classifier(nyu, tmp_path):
    out = tmp_path / "out"
    assert run(f"eval classifier {nyu} --repeats 20 --out {out}".split()) == 0
    (scored,) = numbers(out / "report.json")["runs"]
    assert scored["confusion"] == {"tp": 2, "fp": 1, "tn": 0, "fn": 0}
    assert scored["false_open_by_kind"]["door leaf"]["value"] == 1
    assert set(scored["false_open_by_kind"]) <= set(NYU_KINDS.values())


def test_depth(nyu, tmp_path):
    out = tmp_path / "out"
    assert run(f"eval depth {nyu} --mirror --repeats 20 --out {out}".split()) == 0
    result = numbers(out / "report.json")
    assert {(r["crop"], r["mirrored"]) for r in result["runs"]} == {
        ("whole", False),
        ("whole", True),
        ("eigen", False),
        ("eigen", True),
    }
    assert all(r["metrics"]["delta1"]["value"] == 1 for r in result["runs"])


def test_a_camera_is_for_photographs_without_one(nyu, tmp_path, capsys):
    assert run(f"eval direction {nyu} --fov-deg 60".split()) == 2
    assert "brings its camera" in capsys.readouterr().err
    photos = tmp_path / "photos"
    write_picture(photos / "a.png", 64, 48)
    (photos / "doorways.csv").write_text(f"{HEADER}\na.png,1,31.5,63.5,1,3,0\n")
    answers = tmp_path / "answers.jsonl"
    call = f"eval direction {photos} --method paper --fov-deg 90 --repeats 0"
    assert run(f"{call} --save-answers {answers}".split()) == 0
    assert json.loads(answers.read_text())["camera"] == {"name": "fov 90 deg", "assumed": False}


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        ("--split 9", 2, "K/N"),
        ("--folds 5", 2, "2 to 2 folds"),
        ("--split 1/2 --folds 2", 2, "give one of them"),
        ("--network f{k}.onnx", 2, "stands for the fold"),
        ("--method best", 2, "got 'best'"),
        ("--layout jpeg", 2, "expected a layout"),
        ("--answers missing.jsonl", 1, "cannot read the stored answers"),
        ("--answers a --network b", 2, "leave the network's options out"),
        ("--images missing.txt", 1, "cannot read the list"),
        ("--network none --method opening", 2, "opening columns"),
    ],
)
def test_wrong_calls_are_one_line(nyu, capsys, options, status, message):
    assert run(f"eval direction {nyu} {options}".split()) == status
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_damage_is_one_line(nyu, capsys):
    (nyu / "doorways.csv").write_text("image,open\n0002.jpg,1\n")
    for task in ("direction", "classifier", "depth"):
        assert run(["eval", task, str(nyu)]) == 1
        error = capsys.readouterr().err
        assert "lacks the column left_px" in error
        assert error.count("\n") == 1


def test_one_picture_alone_gives_values_without_intervals(tmp_path):
    photos = tmp_path / "photos"
    write_picture(photos / "a.png", 64, 48)
    (photos / "doorways.csv").write_text(f"{HEADER}\na.png,0,,,,3,0\n")
    file = tmp_path / "a.json"
    assert run(f"eval direction {photos} --method opening --json {file}".split()) == 0
    metrics = numbers(file)["runs"][0]["metrics"]
    assert metrics["bearing_median_deg"]["value"] is None
    assert metrics["go_without_door"] == {
        "value": float(np.float64(metrics["go_without_door"]["value"])),
        "low": None,
        "high": None,
        "n": 1,
    }
