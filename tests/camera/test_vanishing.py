"""The check of a focal length, in rooms whose camera is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.camera.vanishing import FocalWatch, check_focal
from doorway3ds.cli.main import run
from doorway3ds.images.codec import read_image

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def room(name: str) -> tuple[np.ndarray, Camera]:
    image = read_image(EXAMPLES / f"{name}.jpg").image
    known = json.loads((EXAMPLES / "truth" / f"{name}.json").read_text())["camera"]
    height, width = image.shape[:2]
    return image, Camera(name, width, height, *(known[key] for key in ("fx", "fy", "cx", "cy")))


@pytest.mark.parametrize("name", ["blocked", "doorway", "nao-low", "no-doorway"])
@pytest.mark.parametrize("wrong", [1.0, 0.75])
def test_a_room_tells_the_focal_length_within_8_percent(name, wrong):
    image, camera = room(name)
    found = check_focal(image, replace(camera, fx=camera.fx * wrong, fy=camera.fy * wrong))
    assert found is not None
    assert found.factor * wrong == pytest.approx(1, abs=0.08)
    assert found.low <= found.factor <= found.high
    assert found.agrees == (wrong == 1.0)


def test_a_wall_straight_ahead_and_no_edges_tell_nothing():
    assert check_focal(*room("mirror")) is None
    image, camera = room("mirror")
    assert check_focal(np.full_like(image, 128), camera) is None


def test_the_command_reports_the_deviation(capsys):
    call = ["calibrate", "--check", str(EXAMPLES / "doorway.jpg")]
    assert run([*call, "--camera", "pepper-top"]) == 0
    assert "they agree" in capsys.readouterr().out
    assert run([*call, "--fov-deg", "80"]) == 1
    assert "does not fit the lines of" in capsys.readouterr().err
    mirror = str(EXAMPLES / "mirror.jpg")
    assert run(["calibrate", "--check", mirror, "--camera", "pepper-top"]) == 1
    assert "do not determine a focal length" in capsys.readouterr().err
    assert run(call) == 2
    assert "--camera" in capsys.readouterr().err
    assert run(["calibrate", "board/", "--camera", "pepper-top"]) == 2
    assert "--check" in capsys.readouterr().err


def test_a_watch_warns_of_a_wrong_camera_and_not_of_the_right_one():
    doubts = {}
    for wrong in (1.0, 0.75):
        watch = FocalWatch()
        for name in ("doorway", "mirror", "blocked", "nao-low"):
            image, camera = room(name)
            watch.look(image, replace(camera, fx=camera.fx * wrong, fy=camera.fy * wrong))
        assert watch.done
        doubts[wrong] = watch.doubt
    assert doubts[1.0] is None
    assert "nao-low has a focal length" in doubts[0.75]


def test_a_watch_leaves_an_assumed_camera_alone():
    image, camera = room("doorway")
    watch = FocalWatch()
    watch.look(image, replace(camera, fx=camera.fx / 2, fy=camera.fy / 2, assumed=True))
    assert not watch.done
    assert watch.doubt is None


def test_look_warns_of_a_wrong_field_of_view_and_answers_all_the_same(capsys):
    image = str(EXAMPLES / "doorway.jpg")
    assert run(["look", "--json", image, "--fov-deg", "80"]) == 0
    wrong = capsys.readouterr()
    assert len(wrong.out.splitlines()) == 1
    assert "3ds: fov 80 deg has a focal length of 381 px, and the room's lines fit" in wrong.err
    assert run(["look", "--json", image, "--camera", "pepper-top"]) == 0
    assert "focal length" not in capsys.readouterr().err
