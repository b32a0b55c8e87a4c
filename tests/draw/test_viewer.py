"""Recordings for Rerun, read back by its own tools."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from doorway3ds.cli.shared.viewer import with_viewer
from doorway3ds.errors import CallError
from tests.conftest import Cli


def read_back(file: Path) -> dict[str, tuple[int, str]]:
    """Rows and columns of each entity, of a file that Rerun has verified."""

    def rerun(*arguments: str) -> str:
        command = [sys.executable, "-m", "rerun", "rrd", *arguments, str(file)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    rerun("verify")
    found: dict[str, tuple[int, str]] = {}
    for line in rerun("print").splitlines():
        if line.startswith("Chunk(") and "/view" not in line and "/container" not in line:
            chunk, entity, columns = line.split(" - ", 2)
            rows, before = int(chunk.split(" with ")[1].split()[0]), found.get(entity, (0, ""))
            found[entity] = (before[0] + rows, before[1] + columns)
    return found


def test_look_and_live_write_what_the_viewer_shows(cli: Cli, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the extra rerun")
    given = ("--network", "net.onnx", "--json", "--rerun")
    assert cli("look", "photo.jpg", "photo.jpg", *given, "look.rrd").status == 0
    assert cli("live", "photo.jpg", *given, "live.rrd").status == 0
    for name, frames in (("look.rrd", 2), ("live.rrd", 1)):
        entities = read_back(tmp_path / name)
        for entity, kind in {
            "/robot/camera/image/openings": "LineStrips2D",
            "/depth": "DepthImage",
            "/robot/points": "Points3D",
            "/robot/doorways": "LineStrips3D",
            "/robot/corridor": "LineStrips3D",
            "/plots/belief": "Scalars",
            "/plots/bearing": "Scalars",
            "/plots/latency": "Scalars",
        }.items():
            rows, columns = entities[entity]
            assert rows == frames and kind in columns, entity
        assert "EncodedImage" in entities["/robot/camera/image"][1]
        assert entities["/reason"][0] == 1  # said once, as it stays the same
    assert not list(tmp_path.glob(".*.part"))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["live", "--rerun"], ["live", "--rerun=viewer"]),
        (["live", "--rerun", "webcam://0"], ["live", "--rerun=viewer", "webcam://0"]),
        (["live", "--rerun", "a.rrd", "x"], ["live", "--rerun", "a.rrd", "x"]),
        (["live", "--rerun=a.rrd"], ["live", "--rerun=a.rrd"]),
        (["look", "a.jpg"], ["look", "a.jpg"]),
    ],
)
def test_rerun_alone_means_the_viewer(given: list[str], expected: list[str]) -> None:
    assert with_viewer(given) == expected


def test_other_files_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the extra rerun")
    from doorway3ds.draw.viewer import Viewer

    with pytest.raises(CallError, match=r"writes \.rrd files, got .*a\.txt"):
        Viewer(tmp_path / "a.txt")
