"""A newcomer's walk: every command of the first half hour, from the wheel, outside the clone.

DOORWAY3DS_WHEEL names the wheel; without it these tests are skipped. What a newcomer brings stands
in for itself: a film is the webcam, rendered boards the printed one, a virtual NAO the robot.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.images.codec import read_image
from tests.camera.test_calibration import CHESS, photograph
from tests.camera.test_guide import FPS, HELD, POSES

ROOT = Path(__file__).resolve().parent.parent
WHEEL = os.environ.get("DOORWAY3DS_WHEEL")
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)
COMMANDS = [
    line
    for block in BLOCK.findall((ROOT / "docs" / "start.md").read_text(encoding="utf-8"))
    for line in block.splitlines()
]

pytestmark = pytest.mark.skipif(WHEEL is None, reason="DOORWAY3DS_WHEEL names no wheel")


@dataclass
class Desk:
    """Where the newcomer sits, and what of theirs is used for what they lack."""

    folder: Path
    robot: str
    stands_in: dict[str, str] = field(default_factory=dict)
    nao: subprocess.Popen[str] | None = None

    def start(self, command: str) -> subprocess.Popen[str]:
        """A command in a shell, in the environment of the page's first block."""
        path = os.pathsep.join([str(self.folder / ".venv" / "bin"), os.environ["PATH"]])
        kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        return subprocess.Popen(
            ["bash", "-ec", f"exec {command}" if command.startswith("3ds") else command],
            cwd=self.folder,
            env={**kept, "PATH": path},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    folder = tmp_path_factory.mktemp("desk")
    shutil.copytree(ROOT / "examples", folder / "examples")
    shutil.copy(ROOT / "examples" / "doorway.jpg", folder / "photo.jpg")
    rooms = [read_image(folder / "examples" / f"{n}.jpg").image for n in ("doorway", "blocked")]
    film(folder / "walk.mp4", [room for room in rooms for _ in range(8)])
    film(folder / "board.avi", [photograph(CHESS, pose) for pose in POSES for _ in range(HELD)])
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        robot = f"127.0.0.1:{free.getsockname()[1]}"
    desk = Desk(folder, robot)
    desk.stands_in = {
        "'.[": f"'{WHEEL}[",
        "install -e ": "install ",
        "[sim]": "[sim,nao]",
        "live webcam://0": "live walk.mp4 --json",
        "serve webcam://0": "serve walk.mp4 --loop --port 0",
        "calibrate webcam://0": "calibrate board.avi",
        # a busy machine, too: small images and patience
        "192.168.1.10 --robot": f"{robot}?timeout_s=20\\&resolution=qvga --ttl-s 15 --robot",
        "192.168.1.10": robot,
    }
    yield desk
    if desk.nao is not None:
        desk.nao.terminate()
        desk.nao.communicate()


def film(path: Path, images: list[np.ndarray]) -> None:
    height, width = images[0].shape[:2]
    code = "mp4v" if path.suffix == ".mp4" else "MJPG"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), FPS, (width, height))
    for image in images:
        writer.write(image[..., ::-1])
    writer.release()


def test_the_page_still_has_its_six_steps() -> None:
    assert {line.split()[1] for line in COMMANDS if line.startswith("3ds")} >= {
        "look", "live", "serve", "calibrate", "run",
    }  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_first_half_hour(desk: Desk, command: str) -> None:
    for theirs, ours in desk.stands_in.items():
        command = command.replace(theirs, ours)
    if "nao://" in command and desk.nao is None:
        desk.nao = desk.start(f"3ds sim nao --listen tcp://{desk.robot} --seed 7")
        assert desk.nao.stdout is not None
        assert "virtual nao" in desk.nao.stdout.readline()
    run = desk.start(command)
    if " serve " in command:
        assert run.stdout is not None
        link = run.stdout.readline().split()[1]
        with urllib.request.urlopen(f"{link.rstrip('/')}/healthz", timeout=10) as answer:
            assert answer.status == 200
        run.terminate()
    stopped = -signal.SIGTERM if " serve " in command else 0  # it ends by the signal, tidied up
    said, wrong = run.communicate(timeout=900)
    if "--move" in command:  # any outcome, as long as it is one
        assert re.search(r"^(aligned|no_door|blocked|unsure): ", said, re.MULTILINE), wrong
    else:
        assert run.returncode == stopped, wrong
