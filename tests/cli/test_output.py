"""Standard output that takes nothing more ends a command with one line and status 1."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import pytest

from doorway3ds.cli.main import run
from doorway3ds.cli.shared.output import apart, linked
from doorway3ds.errors import CallError
from doorway3ds.types import Reason


@pytest.fixture
def full() -> Iterator[TextIO]:
    with Path("/dev/full").open("w") as stream:
        yield stream


@pytest.fixture
def broken_pipe() -> Iterator[TextIO]:
    out, into = os.pipe()
    os.close(out)
    with os.fdopen(into, "w") as stream:
        yield stream


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("full", "3ds: cannot write to standard output: No space left on device\n"),
        ("broken_pipe", ""),  # a reader that has seen enough, such as head
    ],
)
def test_a_failed_write_is_one_line_and_a_reader_that_left_none(
    kind: str,
    says: str,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stream = request.getfixturevalue(kind)
    monkeypatch.setattr(sys, "stdout", stream)
    assert run(["models"]) == 1
    assert capsys.readouterr().err == says
    assert sys.stdout is stream


def test_closed_streams_are_no_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", None)
        assert run(["models"]) == 1
    assert capsys.readouterr().err.startswith("3ds: standard output is closed; ")
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", None)
        assert run(["models"]) == 0
        assert run(["no-such-command"]) == 2


def test_a_reason_is_a_link_to_its_page_in_a_terminal_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for name, value in (("TERM", "xterm-256color"), ("COLUMNS", "40")):
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("NO_COLOR", raising=False)
    words = "open door 0.94 · 12.4 deg left · way blocked · stay"
    link, text = linked(words, Reason.BLOCKED, Terminal()).split("\x1b\\")[:2]
    page, _, anchor = link.partition(";file://")[2].partition("#")
    assert (anchor, text.partition("\x1b")[0]) == ("blocked", words)
    assert "\n## blocked\n" in Path(page).read_text(encoding="utf-8")
    assert linked(words, Reason.BLOCKED, io.StringIO()) == words
    monkeypatch.setenv("TERM", "dumb")
    assert linked(words, Reason.BLOCKED, Terminal()) == words


@pytest.mark.parametrize(
    ("written", "read", "message"),
    [
        ({"--out": "a.onnx", "--json": "a.json"}, [], ""),
        ({"--out": None, "--json": None, "--log": "-", "--rerun": "-"}, [None], ""),
        ({"--out": "a/run.jsonl", "--bag": "a/bag"}, [], ""),
        (
            {"--out": "a.json", "--json": "b/../a.json"},
            [],
            "--out and --json are both b/../a.json; name another file",
        ),
        (
            {"--bag": "a", "--out": "a/b/film.mp4"},
            [],
            "--out would lie in what --bag writes; name another file",
        ),
        (
            {"--out": "a/b/film.mp4", "--bag": "a"},
            [],
            "--out would lie in what --bag writes; name another file",
        ),
        (
            {"--out": "film.mp4"},
            ["webcam://0", "./film.mp4"],
            "--out would replace film.mp4, which is read; name another file",
        ),
    ],
)
def test_no_file_replaces_another(
    written: dict[str, str | None], read: list[str | None], message: str
) -> None:
    if not message:
        apart(written, read)
        return
    with pytest.raises(CallError) as caught:
        apart(written, read)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("qualify in --json site.json", "the card (.json) of --out and --json are both site.json"),
        (
            "qualify in --out r/report.onnx --report r",
            "the card (.json) of --out and report.json of --report are both r/report.json",
        ),
        (
            "qualify in --answers a --answers b.jsonl --json b.jsonl",
            "--json would replace b.jsonl, which is read",
        ),
        (
            "eval direction in --json a.json --save-answers a.json",
            "--json and --save-answers are both a.json",
        ),
        (
            "eval classifier in --out r --json r/report.html",
            "report.html of --out and --json are both r/report.html",
        ),
        ("eval depth in --places p.csv --json p.csv", "--json would replace p.csv, which is read"),
        (
            "eval overview in --held-out h.csv --json h.csv",
            "--json would replace h.csv, which is read",
        ),
        ("live film.mp4 --out film.mp4", "--out would replace film.mp4, which is read"),
        ("live in --bag a --log a", "--log would lie in what --bag writes"),
        ("run in --rerun a.rrd --log a.rrd", "--log would lie in what --rerun writes"),
        ("calibrate a.jpg --out a.jpg", "--out would replace a.jpg, which is read"),
    ],
)
def test_a_call_whose_files_collide_ends_before_anything_is_read(
    call: str,
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(call.split()) == 2
    assert capsys.readouterr().err == f"3ds: {message}; name another file\n"
    assert not list(tmp_path.iterdir())
