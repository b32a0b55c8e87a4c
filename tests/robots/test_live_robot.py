"""`3ds live --robot`: the closed loop of `3ds run` while every frame is watched."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import pytest

from doorway3ds.lab.sim.robot.body import Body, Gait
from doorway3ds.robots.runlog import read_log
from tests import factories

NET = ("--network", "net.onnx")


def sees_no_door() -> tuple[str, str]:
    """A network whose robot looks around for ever: turns that do not depend on the picture."""
    return "--network", str(factories.doornet(Path("none.onnx"), p_open=-3.0))


def test_without_move_it_only_says(cli: Any) -> None:
    ran = cli("live", "photo.jpg", *NET, "--robot", "dry", "--record", "a")
    assert (ran.status, ran.out.splitlines()[-1].split()[0]) == (0, "dry:")
    assert "it would go" in ran.out
    assert [e["event"] for e in read_log(Path("a"))] == ["start", "look", "end"]
    assert cli("replay", "a").status == 0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--robot", "pr2://x"), "--robot must be nao://"),
        (("--robot", "sim"), "needs a sim:// source"),
        (("--robot", "dry", "--frames", "3"), "--frames would stop a robot half-way"),
        (("--move",), "name it by --robot"),
    ],
)
def test_a_wrong_call_is_one_line(cli: Any, arguments: tuple[str, ...], expected: str) -> None:
    ran = cli("live", "photo.jpg", *NET, *arguments)
    assert ran.status == 2 and expected in ran.err and ran.err.count("\n") == 1


@pytest.mark.nao
def test_a_virtual_nao_is_turned_while_every_frame_is_told(cli: Any, virtual: Any) -> None:
    nao, where = virtual()
    uri = f"nao://{where}"
    ran = cli("live", f"{uri}?resolution=qvga&fps=20", "--robot", uri, "--move", "--json",
              "--record", "a", "--out", "seen.avi", *sees_no_door())  # fmt: skip
    lines = [json.loads(line) for line in ran.out.splitlines()]
    events = read_log(Path("a"))
    turns = [e for e in events if e["event"] == "turn"]
    assert (ran.status, lines[-1]["outcome"], events[-1]["outcome"]) == (3, "no_door", "no_door")
    assert events[-1]["stopped"] is True and not nao.body.moving
    assert len(turns) == 8 and all(turn["end"] == "done" for turn in turns)
    # More frames are watched than are acted on.
    assert lines[-1]["looks"] == len(turns) + 1
    assert len(lines) - 1 > 1.5 * lines[-1]["looks"]
    assert cv2.VideoCapture("seen.avi").read()[0]
    assert nao.video.getSubscribers() == []
    assert cli("replay", "a").status == 0


@pytest.mark.nao
def test_without_move_a_robot_is_not_even_woken(cli: Any, virtual: Any) -> None:
    nao, where = virtual()
    cli("live", f"nao://{where}?resolution=qvga&fps=20", *NET, "--robot", f"nao://{where}",
        "--record", "a")  # fmt: skip
    assert not nao.body.awake
    assert nao.body.place() == (0.0, 0.0, 0.0)


@pytest.mark.nao
def test_a_film_that_cannot_be_written_stops_the_robot_first(cli: Any, virtual: Any) -> None:
    nao, where = virtual()
    Path("file").write_text("")
    ran = cli("live", f"nao://{where}?resolution=qvga&fps=20", *NET, "--robot", f"nao://{where}",
              "--move", "--record", "a", "--out", "file/seen.avi")  # fmt: skip
    assert ran.status == 1 and "cannot write file/seen.avi" in ran.err
    assert read_log(Path("a"))[-1]["stopped"] is True and not nao.body.moving


@pytest.mark.nao
def test_sigterm_in_the_middle_of_a_turn_stops_the_robot(cli: Any, virtual: Any) -> None:
    nao, where = virtual(body=Body(gait=Gait(speed_deg_s=2.0, ramp_s=0.05)))
    uri = f"nao://{where}"
    call = [sys.executable, "-m", "doorway3ds.cli.main", "live", f"{uri}?resolution=qvga&fps=20"]
    process = subprocess.Popen(
        [*call, "--robot", uri, "--move", "--json", "--record", "a", *sees_no_door()],
        stdout=subprocess.DEVNULL,
    )
    end = time.monotonic() + 30
    while not nao.body.moving and time.monotonic() < end:
        time.sleep(0.02)
    assert nao.body.moving
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=20) == 130
    assert not nao.body.moving
    log = read_log(Path("a"))
    assert log[-1]["event"] == "end" and log[-1]["stopped"] is True
