import json
import re

import cv2
import numpy as np
import pytest

from doorway3ds.cli.main import run
from doorway3ds.lab.datasets.samples import NYU_KINDS
from doorway3ds.networks import registry
from tests.factories import HEADER, write_picture
from tests.lab.evaluate.test_runners import Oracle


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


def test_direction_tells_false_alarms_by_kind(nyu, tmp_path, capsys):
    """0045, the picture without a doorway, shows a closed door beside the candidate."""
    out, answers = tmp_path / "out", tmp_path / "answers.jsonl"
    call = f"eval direction {nyu} --method opening --repeats 20 --out {out}"
    assert run(f"{call} --save-answers {answers}".split()) == 0
    assert "No doorway, by what is shown: opening on doornet" in capsys.readouterr().out
    (told,) = numbers(out / "report.json")["runs"]
    by_kind = told["no_doorway_by_kind"]
    assert list(by_kind) == ["all without a doorway", "closed door"]
    door = by_kind["closed door"]
    assert (door["pictures"], door["places"], door["p_open_from_0.5"]["value"]) == (1, 1, 1)
    assert door["best_candidate_on_it"]["value"] == 0
    assert "closed door" in (out / "report.html").read_text()
    # the same answers where the door stands under the candidate's columns
    labels = np.zeros((480, 640), np.uint8)
    labels[:, 300:400] = 7
    cv2.imwrite(str(nyu / "labels" / "0045.png"), labels)
    again = tmp_path / "again.json"
    assert run(f"eval direction {nyu} --answers {answers} --repeats 20 --json {again}".split()) == 0
    (told,) = numbers(again)["runs"]
    assert told["no_doorway_by_kind"]["closed door"]["best_candidate_on_it"]["value"] == 1


def test_a_data_set_that_tells_no_kinds_has_no_table_of_them(tmp_path, capsys):
    write_picture(tmp_path / "images" / "a.jpg", 64, 48)
    write_picture(tmp_path / "images" / "b.jpg", 64, 48)
    rows = [HEADER, "a.jpg,1,20,40,1,3,0", "b.jpg,0,,,,3,0"]
    (tmp_path / "doorways.csv").write_text("\n".join(rows) + "\n")
    file = tmp_path / "a.json"
    assert run(f"eval direction {tmp_path} --repeats 0 --json {file}".split()) == 0
    assert "No doorway" not in capsys.readouterr().out
    assert "no_doorway_by_kind" not in numbers(file)["runs"][0]


def test_marks_by_hand_tell_kinds_but_not_where(tmp_path, capsys):
    write_picture(tmp_path / "images" / "a.jpg", 64, 48)
    rows = [HEADER + ",state", "a.jpg,0,,,,3,0,closed"]
    (tmp_path / "doorways.csv").write_text("\n".join(rows) + "\n")
    file = tmp_path / "a.json"
    assert run(f"eval direction {tmp_path} --repeats 0 --json {file}".split()) == 0
    shown = capsys.readouterr().out
    assert "No doorway" in shown
    assert "false turns (no doorway), n = 1" in shown
    assert "best candidate" not in shown
    door = numbers(file)["runs"][0]["no_doorway_by_kind"]["closed door"]
    assert door["p_open_from_0.5"]["value"] == 1
    assert door["best_candidate_on_it"]["value"] is None


def test_a_folder_per_class_is_scored_for_p_open_and_goes_where_no_doorway_is(tmp_path):
    for name in ("open-door/a.png", "open-door/b.png", "closed-door/c.png", "half-open/d.png"):
        write_picture(tmp_path / "site" / name, 620, 460)
    file = tmp_path / "a.json"
    call = f"eval direction {tmp_path / 'site'} --method opening --repeats 0 --json {file}"
    assert run(call.split()) == 0
    (scored,) = numbers(file)["runs"]
    assert (scored["pictures"], scored["doorway_pictures"]) == (4, 0)
    counts = {name: metric["n"] for name, metric in scored["metrics"].items()}
    assert counts.pop("auc") == 3
    assert counts.pop("go_without_door") == 1
    assert counts.pop("turns_inside") == 1  # there is nothing to turn to behind a closed door
    assert set(counts.values()) == {0}


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


def test_classifier(nyu, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(f"eval classifier {nyu} --repeats 20 --out {out}".split()) == 0
    shown = dict(
        re.split(r"  +", line.strip())[:2]
        for line in capsys.readouterr().out.splitlines()
        if "called" in line and "Wilson" not in line
    )
    assert shown == {
        "open, called open": "2",
        "open, called not open": "0",
        "not open, called open": "1",
        "not open, called not open": "0",
    }
    (scored,) = numbers(out / "report.json")["runs"]
    assert scored["confusion"] == {"tp": 2, "fp": 1, "tn": 0, "fn": 0}
    assert scored["false_open_by_kind"]["closed door"]["value"] == 1
    assert set(scored["false_open_by_kind"]) <= set(NYU_KINDS)


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
        ("--split 1/2 --folds 2", 2, "pass one of them"),
        ("--network f{k}.onnx", 2, "stands for the fold"),
        ("--method best", 2, "got 'best'"),
        ("--layout jpeg", 2, "expected a layout"),
        ("--answers missing.jsonl", 1, "cannot read missing.jsonl"),
        ("--answers a --network b", 2, "leave the network's options out"),
        ("--images missing.txt", 1, "cannot read missing.txt"),
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
