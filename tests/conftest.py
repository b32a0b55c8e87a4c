from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest

from doorway3ds.cli.main import run
from doorway3ds.networks import registry
from tests import factories
from tests.factories import encode, scene

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
    if before is signal.SIG_IGN:
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
