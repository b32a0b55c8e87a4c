"""`3ds run` and `3ds replay` as a user calls them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera
from doorway3ds.lab.sim.robot.body import Body, Gait
from doorway3ds.lab.sim.robot.nao import Faults
from doorway3ds.robots.runlog import read_log
from tests import factories


def test_without_move_it_only_says(cli: Any) -> None:
    ran = cli("run", "photo.jpg", "--network", "net.onnx", "--log", "a")
    assert (ran.status, ran.out.split()[0]) == (0, "dry:")
    assert "it would go" in ran.out
    assert [e["event"] for e in read_log(Path("a"))] == ["start", "look", "end"]


def test_a_replay_gives_the_same_decisions_and_another_method_does_not(cli: Any) -> None:
    cli("run", "photo.jpg", "--network", "net.onnx", "--log", "a")
    ran = cli("replay", "a")
    assert (ran.status, ran.err) == (0, "1 of 1 decisions are the same; reasons: docs/reasons.md\n")
    assert cli("replay", "a", "--method", "paper").status == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("--robot", "pr2://x"),
        ("--robot", "sim"),
        ("--max-turn-deg", "500"),
        ("--method", "guess"),
    ],
)
def test_a_wrong_call_is_one_line_and_status_two(cli: Any, arguments: tuple[str, ...]) -> None:
    ran = cli("run", "photo.jpg", "--network", "net.onnx", "--log", "a", *arguments)
    assert ran.status == 2
    assert ran.err.count("\n") == 1


def test_a_folder_without_a_run_is_one_line(cli: Any) -> None:
    ran = cli("replay", ".")
    assert ran.status == 1
    assert "holds no run" in ran.err


@pytest.mark.nao
@pytest.mark.parametrize(
    ("p_open", "status", "turns"),
    [
        (-3.0, 3, ["done"] * 8),  # no door: a full circle
        (3.0, 4, []),  # a door, but no floor on the way to it
    ],
)
def test_a_virtual_nao_is_driven_and_the_run_replayed(
    cli: Any, virtual: Any, p_open: float, status: int, turns: list[str]
) -> None:
    nao, where = virtual()
    uri = f"nao://{where}"
    factories.doornet(Path("same.onnx"), p_open=p_open)
    ran = cli(
        "run", f"{uri}?resolution=qvga&fps=20", "--robot", uri, "--move", "--say",
        "--network", "same.onnx", "--log", "a", "--blocked-s", "0",
    )  # fmt: skip
    events = read_log(Path("a"))
    assert ran.status == status
    assert [e["end"] for e in events if e["event"] == "turn"] == turns
    assert events[-1]["stopped"] is True
    assert not nao.body.moving
    assert nao.video.getSubscribers() == []
    assert len(nao.said) == 1
    assert nao.body.awake
    assert cli("replay", "a").status == 0


@pytest.mark.nao
def test_a_camera_file_keeps_the_pose_that_the_robot_measured(cli: Any, virtual: Any) -> None:
    _, where = virtual()
    write_camera_info(Camera.from_fov(320, 240, 70.0, name="front"), "front.yaml")
    cli("run", f"nao://{where}?resolution=qvga&fps=20", "--network", "net.onnx", "--log", "a",
        "--camera", "front.yaml")  # fmt: skip
    look = read_log(Path("a"))[1]
    assert look["camera"]["name"] == "front"
    assert look["pose"]["height_m"] > 0.4
    assert look["pose"]["forward_m"] != 0


@pytest.mark.nao
def test_without_move_a_robot_is_not_even_woken(cli: Any, virtual: Any) -> None:
    nao, where = virtual()
    cli("run", f"nao://{where}?resolution=qvga&fps=20", "--robot", f"nao://{where}",
        "--network", "net.onnx", "--log", "a")  # fmt: skip
    assert not nao.body.awake
    assert nao.body.place() == (0.0, 0.0, 0.0)


@pytest.mark.nao
def test_a_camera_that_never_answers_ends_the_process_with_its_status(
    cli: Any, virtual: Any
) -> None:
    _, where = virtual(faults=Faults(hang_s=3.0))
    uri = f"nao://{where}"
    call = [
        "run", f"{uri}?resolution=qvga&timeout_s=0.5", "--robot", uri, "--move",
        "--network", "net.onnx", "--log", "a",
    ]  # fmt: skip
    program = "import sys; from doorway3ds.cli.main import main; main()"
    ended = subprocess.run([sys.executable, "-c", program, *call], check=False, timeout=60)
    assert ended.returncode == 6
    assert read_log(Path("a"))[-1]["outcome"] == "lost"


@pytest.mark.nao
def test_a_camera_that_fails_ends_with_its_own_status(cli: Any, virtual: Any) -> None:
    nao, where = virtual(faults=Faults(null=True))
    ran = cli("run", f"nao://{where}?resolution=qvga&fps=20", "--robot", f"nao://{where}",
              "--move", "--network", "net.onnx", "--log", "a")  # fmt: skip
    assert (ran.status, ran.out.split()[0]) == (6, "lost:")
    assert nao.body.place()[2] == 0.0


@pytest.mark.nao
def test_a_run_that_moves_says_that_autonomous_life_is_off_and_puts_it_back(
    cli: Any, virtual: Any
) -> None:
    nao, where = virtual()
    life = nao.services["ALAutonomousLife"]
    life.setState("solitary")
    uri = f"nao://{where}"
    source = (f"{uri}?resolution=qvga&fps=20", "--robot", uri, "--network", "net.onnx")
    ran = cli("run", *source, "--log", "dry")
    assert "autonomous life" not in ran.err
    nao.faults.null = True  # the run ends with an error
    ran = cli("run", *source, "--log", "moving", "--move")
    assert "autonomous life was solitary, now disabled" in ran.err
    assert "autonomous life is solitary again" in ran.err
    assert life.getState() == "solitary"


@pytest.mark.nao
def test_ctrl_c_puts_autonomous_life_back_too(cli: Any, virtual: Any) -> None:
    nao, where = virtual(body=Body(gait=Gait(speed_deg_s=5.0)))
    life = nao.services["ALAutonomousLife"]
    life.setState("solitary")

    def interrupt() -> None:
        while not nao.body.awake:
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    uri = f"nao://{where}"
    ran = cli("run", f"{uri}?resolution=qvga&fps=20", "--robot", uri, "--network", "net.onnx",
              "--log", "a", "--move")  # fmt: skip
    assert ran.status == 130
    assert life.getState() == "solitary"
    assert not nao.body.moving
