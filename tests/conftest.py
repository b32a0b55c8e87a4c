from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from doorway3ds.cli.main import run
from doorway3ds.networks import registry
from tests import factories
from tests.factories import HEADER, encode, scene, write_picture

# What the tests of a marker need beside the package; each says so where it is missing.
EXTRAS = {"train": "torch", "sim": "mujoco", "nao": "qi"}


def pytest_runtest_setup(item: pytest.Item) -> None:
    for extra, module in EXTRAS.items():
        if item.get_closest_marker(extra) and find_spec(module) is None:
            pytest.skip(f"needs the extra '{extra}': pip install 'doorway3ds[{extra}]'")


class Ran(NamedTuple):
    """How one command line ended."""

    status: int
    out: str
    err: str


Cli = Callable[..., Ran]


@pytest.fixture(scope="session", autouse=True)
def ctrl_c() -> Iterator[None]:
    """Ctrl-C works in what tests start, also where a shell has it ignored: in the background."""
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cli:
    """Runs `3ds` in this process, in an empty folder that holds net.onnx and photo.jpg."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(registry.FOLDER_VARIABLE, str(tmp_path / "models"))
    factories.doornet(tmp_path / "net.onnx", left=0.2, right=0.4)
    (tmp_path / "photo.jpg").write_bytes(encode(scene(160, 120)))

    def call(*arguments: object) -> Ran:
        capsys.readouterr()
        status = run([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return Ran(status, out, err)

    return call


@pytest.fixture
def nyu(tmp_path: Path) -> Path:
    """Three pictures of two places: a doorway with a further one, one doorway, none."""
    root = tmp_path / "nyu"
    for number in (2, 3, 45):
        write_picture(root / "images" / f"{number:04d}.jpg", 640, 480)
        depth = np.full((480, 640), 51, np.uint8)
        depth[:, 300:400] = 255
        labels = np.zeros((480, 640), np.uint8)
        labels[:, :100] = 7
        for folder, picture in (("depth", depth), ("labels", labels)):
            (root / folder).mkdir(exist_ok=True)
            cv2.imwrite(str(root / folder / f"{number:04d}.png"), picture)
    rows = [
        HEADER,
        "0002.jpg,1,300,400,1,3,0",
        "0002.jpg,1,10.0,60.5,0,1,1",
        "0003.jpg,1,500,630,,2,0",
        "0045.jpg,0,,,,3,0",
    ]
    (root / "doorways.csv").write_text("\n".join(rows) + "\n")
    return root
