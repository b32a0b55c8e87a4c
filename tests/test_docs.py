"""The command blocks of the documentation: run as they stand, or marked with the reason why not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.draw.words import help_page
from doorway3ds.images.codec import read_image, write_image
from doorway3ds.types import Reason

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "CONTRIBUTING.md",
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
_BLOCK = re.compile(
    r"(?:<!-- not run: (?P<why>[^>]+) -->\n)?```sh\n(?P<commands>.*?)```", re.DOTALL
)


def blocks(page: Path) -> list[tuple[str | None, str]]:
    """(why it is not run or None, commands) of each block of a page."""
    return [(m["why"], m["commands"]) for m in _BLOCK.finditer(page.read_text(encoding="utf-8"))]


# Installing is what .ci/run does; CONTRIBUTING and README have only that.
RUN = [
    pytest.param(commands, id=f"{page.stem}-{number}")
    for page in PAGES[2:]
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
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_stand_in_blocks_that_are_run_or_marked(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    loose = re.findall(
        r"(?m)^ {4,}(?:3ds|pip|curl|python3?) .*$", re.sub(r"(?s)```.*?```", "", text)
    )
    assert loose == []
    others = re.findall(r"```(?:bash|shell|console)", text)
    assert others == []


@pytest.mark.parametrize("page", ["README.md", "docs/python.md"])
def test_python_blocks_run_as_they_stand(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    found = re.findall(r"(?s)```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"))
    assert found
    for program in found:
        exec(compile(program, page, "exec"), {})


def test_the_showroom_puts_stands_beside_doorways_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "homes" / "images").mkdir(parents=True)
    rows = ["image,open,left_px,right_px,home"]
    for number in range(12):
        name = f"{number:06d}.jpg"
        write_image(tmp_path / "homes" / "images" / name, np.full((240, 320, 3), 90, np.uint8))
        rows.append(f"{name},1,10.5,90.0,1" if number < 6 else f"{name},0,,,1")
    (tmp_path / "homes" / "doorways.csv").write_text("\n".join(rows) + "\n")
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "qualify.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"(?s)```python\n(# showroom.py\n.*?)```", page)
    exec(compile(program, "showroom.py", "exec"), {})
    images = [read_image(f).image for f in sorted((tmp_path / "showroom" / "images").iterdir())]
    stands = [int((image > 230).all(axis=2).sum()) for image in images]
    assert len(images) == 12
    assert sum(margin > 2000 for margin in stands) >= 4
    assert all((image[:, 14:86] < 120).all() for image in images[:6])  # no doorway is hidden


_FIGURE = re.compile(r"(\d+\.\d+)( %)? \((\d+\.\d+)–(\d+\.\d+)\)")


def test_figures_that_are_repeated_are_those_of_the_results() -> None:
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    short, full = results.split("## On places held out from training")
    measured = set(_FIGURE.findall(full))
    for text in (short, (ROOT / "README.md").read_text(encoding="utf-8")):
        repeated = set(_FIGURE.findall(text))
        assert len(repeated) >= 6
        assert repeated <= measured


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


def test_each_reason_has_a_section_that_the_outputs_link_to() -> None:
    page, _, _ = help_page().partition("#")
    headings = re.findall(r"^## (.+)$", (ROOT / page).read_text(), re.MULTILINE)
    assert [help_page(reason) for reason in Reason] == [f"{page}#{name}" for name in headings]
