"""The help of every command, as a terminal of 80 columns shows it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from doorway3ds.cli.main import application, run


def walked(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield path
    for name, inner in getattr(command, "commands", {}).items():
        yield from walked(inner, (*path, name))


PATHS = list(walked(application([])))


def test_every_command_is_walked() -> None:
    assert len(PATHS) > 25
    assert {(), ("look",), ("sim", "trial"), ("eval", "direction"), ("train", "doornet")} < {*PATHS}


@pytest.fixture(params=PATHS, ids=[" ".join(path) or "3ds" for path in PATHS])
def shown(
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> tuple[tuple[str, ...], str]:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    assert run([*request.param, "--help"]) == 0
    text = capsys.readouterr().out
    assert run([*request.param, "-h"]) == 0
    assert capsys.readouterr().out == text
    return request.param, text


def test_help_reads_well_at_80_columns(shown: tuple[tuple[str, ...], str]) -> None:
    path, text = shown
    lines = [line.rstrip() for line in text.splitlines()]
    assert max(map(len, lines)) <= 80
    prose, *panels = re.split(r"╭─.*\n", text)
    if path:
        assert re.search(rf"^ Example: .*3ds {' '.join(path)}", prose, re.MULTILINE)
    # A line ends because the next word would not fit, not because the source's did.
    for line, following in zip(prose.splitlines(), prose.splitlines()[1:], strict=False):
        if line.strip() and following.strip() and not line.startswith("  "):
            assert len(line.rstrip()) + 1 + len(following.split()[0]) > 79, line
    for panel in panels:
        rows = [line[1:-1].rstrip() for line in panel.partition("╰")[0].splitlines()]
        starts = {_last_cell(row) for row in rows if not row.startswith("    " * 3)}
        assert len(starts) == 1, panel  # of the column of help, beside every option
        (start,) = starts
        assert 78 - start >= 30, panel
        for row in rows:
            assert row[:start].strip() == "" or row[start - 1] == " ", panel
            if row.startswith("    " * 3):
                assert row[:start].strip() == "", panel


def _last_cell(row: str) -> int:
    """Where a row's last cell begins; cells are two spaces or more apart."""
    return max(found.end() for found in re.finditer(r"  +", row))
