"""The command line as a whole."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from doorway3ds import __version__
from doorway3ds.cli import main as command
from tests.conftest import Cli


def test_every_command_has_help(cli: Cli) -> None:
    names = command.commands()
    assert names[:5] == ["look", "live", "serve", "run", "replay"]
    ran = cli("--help")
    assert ran.status == 0
    for name in names:
        assert name in ran.out
        assert cli(name, "--help").status == 0


def test_version(cli: Cli) -> None:
    assert cli("--version").out == f"doorway3ds {__version__}\n"


def test_unknown_commands_are_wrong_calls(cli: Cli) -> None:
    ran = cli("fly")
    assert ran.status == 2
    assert "No such command 'fly'" in ran.err


def test_a_missing_extra_is_an_install_hint(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ModuleNotFoundError("No module named 'torch'", name="torch")

    monkeypatch.setattr("doorway3ds.decide.pipeline.load", broken)
    ran = cli("look", "photo.jpg", "--network", "net.onnx")
    assert ran.status == 1
    assert ran.err == (
        "3ds: look needs the extra 'train': pip install 'doorway3ds[train]' (torch is missing)\n"
    )


def test_without_qi_the_hint_says_where_it_exists(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "qi", None)
    ran = cli("live", "nao://127.0.0.1:1")
    assert ran.status == 1
    assert ran.err == (
        "3ds: live needs the extra 'nao': pip install 'doorway3ds[nao]' (qi is missing; it exists "
        "for Python 3.10 to 3.12 on Linux x86-64 and Python 3.12 on macOS with Apple silicon)\n"
    )


def test_a_missing_module_of_our_own_is_a_bug(monkeypatch: pytest.MonkeyPatch, cli: Cli) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ModuleNotFoundError("No module named 'doorway3ds.x'", name="doorway3ds.x")

    monkeypatch.setattr("doorway3ds.decide.pipeline.load", broken)
    with pytest.raises(ModuleNotFoundError):
        cli("look", "photo.jpg", "--network", "net.onnx")


@pytest.mark.parametrize("arguments", [["--help"], ["look", "--help"], ["models"]])
def test_help_starts_without_heavy_modules(arguments: list[str]) -> None:
    code = (
        "import sys; from doorway3ds.cli.main import run; run(sys.argv[1:]);"
        "heavy = {'cv2', 'onnxruntime', 'torch', 'keras', 'matplotlib', 'requests'};"
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_decision_needs_no_slow_imports(cli: Cli) -> None:
    code = (
        "import sys; from doorway3ds.cli.main import run; run(sys.argv[1:]);"
        "slow = {'torch', 'keras', 'pooch', 'requests', 'matplotlib', 'asyncio', 'onnx'};"
        "sys.exit(', '.join(slow & set(sys.modules)) or 0)"
    )
    call = ["look", "photo.jpg", "--network", "net.onnx"]
    done = subprocess.run([sys.executable, "-c", code, *call], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert Path("3ds-out/photo_3ds.jpg").exists()
