"""The command blocks of the documentation: run as they stand, or marked with the reason why not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(
    r"(?:<!-- not run: (?P<why>[^>]+) -->\n)?```sh\n(?P<commands>.*?)```", re.DOTALL
)


def blocks(page: Path) -> list[tuple[str | None, str]]:
    """(why it is not run or None, commands) of each block of a page."""
    return [(m["why"], m["commands"]) for m in _BLOCK.finditer(page.read_text(encoding="utf-8"))]


# Installing is what .ci/run does; CONTRIBUTING has only that.
RUN = [
    pytest.param(commands, id=f"{page.stem}-{number}")
    for page in PAGES[1:]
    for number, (why, commands) in enumerate(blocks(page))
    if why is None
]


def test_the_first_half_hour_is_mostly_run() -> None:
    assert len([why for why, _ in blocks(ROOT / "docs" / "start.md") if why is None]) >= 3


@pytest.mark.parametrize("commands", RUN)
def test_a_block_runs_as_it_stands(commands: str, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    ran = subprocess.run(
        ["bash", "-ec", commands],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip()


def test_the_python_files_that_the_documentation_names_exist() -> None:
    roots = (ROOT, ROOT / "src", ROOT / "src" / "doorway3ds")
    named = [
        (page.name, name)
        for page in [ROOT / "README.md", *PAGES]
        for name in re.findall(r"`([\w-]+(?:/[\w-]+)+\.py)`", page.read_text(encoding="utf-8"))
    ]
    assert len(named) >= 5
    assert [
        (page, name) for page, name in named if not any((r / name).is_file() for r in roots)
    ] == []
