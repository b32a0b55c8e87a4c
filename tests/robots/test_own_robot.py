"""The program in docs/mounting.md, with made-up motors and an MJPEG camera."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.networks import load
from tests import factories
from tests.sources.servers import MjpegServer

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_program_of_the_docs_looks_around_and_stops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (DOCS / "mounting.md").read_text(encoding="utf-8")
    program = next(
        b for b in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "TurnLoop(" in b
    )
    asked: list[float] = []
    stops: list[int] = []
    motors = SimpleNamespace(
        rotate=lambda deg, timeout_s: asked.append(deg),
        turned_deg=lambda: asked[-1],
        stop=lambda: stops.append(1),
    )
    monkeypatch.setitem(sys.modules, "motors", motors)  # type: ignore[arg-type]
    monkeypatch.chdir(tmp_path)
    write_camera_info(Camera.from_fov(64, 48, 60.0), "front.yaml")
    net = factories.doornet(tmp_path / "none.onnx", p_open=-3.0)
    monkeypatch.setattr(Pipeline, "default", lambda: Pipeline(load(str(net))))
    with MjpegServer() as server:
        exec(compile(program.replace("webcam://0", server.url), "mounting.md", "exec"), {})
    # No door anywhere: a full circle in steps of 40 degrees, each stopped, and once at the end.
    assert asked == [40.0] * 8
    assert len(stops) == 9
    assert capsys.readouterr().out.startswith("no_door a full circle")
