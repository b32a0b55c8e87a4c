from __future__ import annotations

import io
import json
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from rich.console import Console

from doorway3ds.cli.shared.panel import Panel
from doorway3ds.errors import UserError
from doorway3ds.images.film import Film
from doorway3ds.live.session import Session
from doorway3ds.robots.runlog import looks, read_log
from doorway3ds.sources import open_source
from doorway3ds.sources.base import Source
from doorway3ds.sources.live import LiveSource
from tests.conftest import Cli
from tests.factories import encode, film, number, scene
from tests.live.test_tracker import look, opening, settled
from tests.sources.servers import MjpegServer

NET = ("--network", "net.onnx")


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_a_video_as_json_lines(cli: Cli) -> None:
    film(Path("film.avi"), 12, 10)
    ran = cli("live", "film.avi", "--json", *NET)
    assert ran.status == 0
    found = lines(ran.out)
    assert [line["image"] for line in found] == [f"film.avi#{i}" for i in range(1, 13)]
    assert found[0]["reason"] == "turn" and found[0]["tracked"]["reason"] == "unsure"
    last = found[-1]
    assert last["stamp_s"] == pytest.approx(1.1)
    tracked = last["tracked"]
    assert tracked["reason"] == "turn" and tracked["number"] == 1
    assert tracked["bearing_deg"] == pytest.approx(last["bearing_deg"])
    assert tracked["belief"] > last["p_open"]
    assert last["source"] == {"skipped": 0, "damaged": 0, "reconnects": 0}


def test_without_a_terminal_a_line_is_printed_when_the_decision_changes(cli: Cli) -> None:
    film(Path("film.avi"), 12, 10)
    ran = cli("live", "film.avi", *NET)
    said = ran.out.splitlines()
    assert said[0].startswith("film.avi#1: Stay: not sure.")
    assert said[1].startswith("film.avi#3: Turn left ")
    assert len(said) <= 4


def test_camera_and_method_are_those_of_look(cli: Cli) -> None:
    film(Path("film.avi"), 3, 10)
    options = ["--camera", "nao-v5-top", "--method", "paper", "--width-m", "0.5", *NET]
    ran = cli("live", "film.avi", "--json", "--frames", "2", *options)
    first, second = lines(ran.out)
    assert first["camera"] == {"name": "nao-v5-top", "assumed": False}
    assert first["method"] == "paper" and "best_pixel" in second


def test_an_annotated_film_keeps_the_films_time(cli: Cli) -> None:
    film(Path("film.avi"), 20, 10, width=320)
    ran = cli("live", "film.avi", "--json", "--out", "out/seen.mp4", *NET)
    assert ran.status == 0
    seen = cv2.VideoCapture("out/seen.mp4")
    assert (seen.get(cv2.CAP_PROP_FPS), seen.get(cv2.CAP_PROP_FRAME_COUNT)) == (10, 20)
    done, image = seen.read()
    assert done and image.shape == (240, 320, 3)
    assert image.std() > 10  # the frames are plain grey: the marks are there
    assert [path.name for path in Path("out").iterdir()] == ["seen.mp4"]


def test_a_recording_holds_every_picture_and_decision(cli: Cli) -> None:
    film(Path("film.avi"), 5, 10)
    assert cli("live", "film.avi", "--record", "kept", *NET).status == 0
    events = read_log(Path("kept"))
    seen = list(looks(Path("kept"), events))
    assert [number(each.frame.image) for each in seen] == pytest.approx(range(5), abs=1)
    assert [event["event"] for event in events] == ["start", *["look", "tracked"] * 5, "end"]
    ran = cli("replay", "kept")
    assert ran.status == 0 and "5 of 5 decisions are the same" in ran.out + ran.err
    again = cli("live", "film.avi", "--record", "kept", *NET)
    assert again.status == 1 and "already holds a run" in again.err


def test_a_damaged_film_ends_with_status_1_after_its_last_frame(cli: Cli) -> None:
    path = film(Path("film.avi"), 40, 20, width=160)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    ran = cli("live", "film.avi", "--json", "--out", "seen.mp4", *NET)
    assert ran.status == 1 and len(lines(ran.out)) > 10
    *cut, last = ran.err.splitlines()
    assert last.startswith("3ds: film.avi breaks off: ")
    assert all("is truncated" in line for line in cut) and len(cut) <= 1
    assert cv2.VideoCapture("seen.mp4").read()[0]


class ReadAhead(Session):
    """Comes into being slowly: meanwhile its threads read as far ahead as they may."""

    def __init__(self, source: Source, *given: Any, **options: Any) -> None:
        super().__init__(source, *given, **options)
        end = time.monotonic() + 10
        while not source.damaged and time.monotonic() < end:
            time.sleep(0.01)


def test_a_folder_with_a_damaged_picture_answers_the_others(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("doorway3ds.live.session.Session", ReadAhead)
    Path("album").mkdir()
    for name in "abc":
        Path(f"album/{name}.jpg").write_bytes(encode(scene()))
    Path("album/b.jpg").write_bytes(b"nothing")
    ran = cli("live", "album", "--json", "--fps", "2", *NET)
    assert ran.status == 1 and len(lines(ran.out)) == 2
    assert "b.jpg" in ran.err
    assert lines(ran.out)[1]["stamp_s"] == 1.0


def test_standard_input(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    data = encode(scene()) * 3
    stdin = SimpleNamespace(buffer=io.BytesIO(data), isatty=lambda: False)
    monkeypatch.setattr(sys, "stdin", stdin)
    ran = cli("live", "-", "--json", *NET)
    assert [line["image"] for line in lines(ran.out)] == ["-#1", "-#2", "-#3"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["film.avi", "--out", "seen.gif"], "must end in .mp4, .mkv, .avi, .webm"),
        (["film.avi", "--method", "guess"], "'guess' is not one of 'opening', 'paper'"),
        (["film.avi", "--fps", "0"], "--fps must be a number"),
        (["ftp://host"], "no source is called ftp://"),
        (["webcam://one"], "expected webcam://0"),
    ],
)
def test_a_wrong_call_is_one_line(cli: Cli, arguments: list[str], expected: str) -> None:
    film(Path("film.avi"), 3)
    ran = cli("live", *arguments, *(() if "--method" in arguments else NET))
    assert ran.status == 2 and expected in ran.err


def test_a_camera_that_goes_away_is_said_to_be_lost_and_ends(cli: Cli) -> None:
    server = MjpegServer()

    def unplug() -> None:
        while server.sent < 80:
            time.sleep(0.01)
        server.stop()

    plug = threading.Thread(target=unplug, daemon=True)
    plug.start()
    ran = cli("live", server.url, "--json", "--patience-s", "1.5", *NET)
    plug.join()
    assert ran.status == 1
    found = lines(ran.out)
    assert "turn" in {line["tracked"]["reason"] for line in found}
    assert found[-1]["reason"] == "lost" and found[-1]["turn_deg"] is None
    assert found[-1]["tracked"]["reason"] == "lost" and found[-1]["problem"]
    assert "is lost" in ran.err and "sent no image for 1.5 s" in ran.err


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT", "background"])
def test_stopped_by_a_signal_the_film_is_whole(cli: Cli, name: str) -> None:
    """In the background of a script Ctrl-C is ignored: it is for what runs in front."""
    ignoring = ["sh", "-c", 'trap "" INT; exec "$@"', "sh"] if name == "background" else []
    with MjpegServer() as server:
        call = [sys.executable, "-m", "doorway3ds.cli.main", "live", server.url, "--json", *NET]
        process = subprocess.Popen(
            [*ignoring, *call, "--out", "seen.mp4"], stdout=subprocess.PIPE, text=True
        )
        try:
            assert process.stdout is not None
            told = [process.stdout.readline() for _ in range(5)]
            if ignoring:
                process.send_signal(signal.SIGINT)
                told += [process.stdout.readline() for _ in range(20)]
            assert all(told)
            process.send_signal(signal.SIGTERM if ignoring else getattr(signal, name))
            process.communicate(timeout=20)
        finally:
            process.kill()
        assert process.returncode == 130
    assert cv2.VideoCapture("seen.mp4").read()[0]
    assert not list(Path().glob(".*part*"))


def test_films_follow_the_stamps(tmp_path: Path) -> None:
    made = Film(tmp_path / "a.mp4", 10)
    for stamp, size in ((0.0, (48, 64)), (0.5, (48, 64)), (0.6, (64, 40)), (9.0, (49, 65))):
        made.add(np.full((*size, 3), 90, np.uint8), stamp)
    made.close()
    # 0.5 s, 0.1 s, 2 s instead of 8.4 s, and one frame of the last.
    assert made.frames == 5 + 1 + 20 + 1
    assert cv2.VideoCapture(str(made.path)).get(cv2.CAP_PROP_FRAME_COUNT) == made.frames


def test_a_film_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    made = Film(tmp_path / "file" / "a.mp4", 10)
    with pytest.raises(UserError, match=r"cannot write .*a\.mp4"):
        made.add(np.zeros((48, 64, 3), np.uint8), 0)
    made.close()


def shown(source: LiveSource | Any, tracked: Any, **console: Any) -> list[str]:
    panel = Panel("webcam://0 · opening · doornet", source)
    panel._console = Console(file=io.StringIO(), **console)
    panel.means.add({"network": 14.2, "selection": 1.6})
    with panel._console.capture() as captured:
        panel._console.print(panel.render(tracked))
    return [line.rstrip() for line in captured.get().splitlines()]


def test_the_panel_stays_in_place_whatever_it_says(tmp_path: Path) -> None:
    source = open_source(str(film(tmp_path / "film.avi", 2)))
    tracker, tracked = settled(2.0, bearing=12.4)
    turn = shown(source, tracked, width=80)
    assert "Turn left 12.4°" in turn[2]
    dial = next(line for line in turn if line.startswith("bearing"))
    assert dial.index("●") < dial.index("┼") and "12.4° left, steady to " in dial
    measured = replace(tracked.decision.perception, bearing_error_deg=2.4)
    known = replace(tracked, decision=replace(tracked.decision, perception=measured))
    measured_lines = shown(source, known, width=80)
    assert any("12.4° left ± 2.4°, steady to " in line for line in measured_lines)
    assert len(measured_lines) == len(turn)
    range_line = next(line for line in turn if line.startswith("distance"))
    assert re.fullmatch(r"distance +2\.00 m, steady to 0\.\d\d m", range_line)
    assert any("15.8 ms: network 14.2, selection 1.6" in line for line in turn)
    source.problem, source.skipped = "no image for 5 s", 7
    silent = tracker.without_picture(60.0)
    lost = shown(source, silent, width=80)
    assert "doorway lost" in lost[2] and any("7 skipped" in line for line in lost)
    assert any("no image for 5 s" in line for line in lost)
    first = tracker.update(look(70.0, opening(-5)))
    unsure = shown(source, first, width=80)
    assert len(turn) == len(lost) == len(unsure)
    assert all(len(line) <= 80 for line in turn + lost + unsure)


def test_the_panel_draws_at_most_five_times_a_second(tmp_path: Path) -> None:
    source = open_source(str(film(tmp_path / "film.avi", 2)))
    _, tracked = settled()
    panel = Panel("film", source)
    drawn = []
    panel._live.update = lambda *_, **__: drawn.append(1)  # type: ignore[method-assign]
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        panel.show(tracked)
        time.sleep(0.01)
    assert 1 <= len(drawn) <= 3
