"""Standard output that takes nothing more ends a command with one line and status 1."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import pytest

from doorway3ds.cli.main import run


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
