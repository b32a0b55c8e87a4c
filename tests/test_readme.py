"""README, CI and documentation say the same and lead nowhere wrong."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from doorway3ds.cli.main import commands

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()


def test_two_shell_commands_and_ci_runs_the_second() -> None:
    blocks = re.findall(r"```sh\n(.*?)\n```", README, re.DOTALL)
    assert len(blocks) == 2
    assert all("\n" not in block for block in blocks)
    assert "3ds look examples" in blocks[0]
    assert blocks[1] in (ROOT / ".ci" / "run").read_text().splitlines()


def test_every_command_is_listed() -> None:
    listed = set(re.findall(r"^\| `3ds (\w+)", README, re.MULTILINE))
    assert listed == set(commands())


@pytest.mark.parametrize(
    "page", ["README.md", *(str(p.relative_to(ROOT)) for p in ROOT.glob("docs/**/*.md"))]
)
def test_links_lead_somewhere(page: str) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", (ROOT / page).read_text()):
        if link.startswith("http"):
            continue
        target, _, anchor = link.partition("#")
        file = (ROOT / page).parent / target if target else ROOT / page
        assert file.exists(), link
        if anchor:
            headings = re.findall(r"^#+ (.*)", file.read_text(), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", h).strip().lower().replace(" ", "-") for h in headings}
            assert anchor in slugs, link


def test_architecture_names_every_room_and_no_other() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    table = text.split("## Where things are")[1].split("Imports point")[0]
    named = {name for name in re.findall(r"`([a-z_/]+/)`", table) if name != "lab/"}
    package = ROOT / "src" / "doorway3ds"
    inside = {f.parent.relative_to(package) for f in package.rglob("*") if f.is_file()}
    rooms = {f"{folder.as_posix()}/" for folder in inside if "__pycache__" not in folder.parts}
    # Folders that only hold an __init__.py and other rooms are storeys.
    storeys = {"lab/", "lab/train/", "lab/sim/", "web/"}
    assert named - {"web/"} == rooms - storeys - {"./", "lab/train/doornet/recipes/"}


def test_the_storeys_are_those_that_the_import_linter_holds() -> None:
    tomllib = pytest.importorskip("tomllib", reason="Python 3.11 brings it")
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = contracts["contracts"][0]["layers"]
    text = (ROOT / "docs" / "architecture.md").read_text()
    assert "\n\n" + "".join(f"    {layer}\n" for layer in layers) + "\n" in text


@pytest.mark.parametrize(
    ("system", "machine", "python", "wanted"),
    [
        ("Linux", "x86_64", "3.10", True),
        ("Linux", "x86_64", "3.12", True),
        ("Linux", "x86_64", "3.13", False),
        ("Linux", "aarch64", "3.12", False),
        ("Darwin", "arm64", "3.12", True),
        ("Darwin", "arm64", "3.11", False),
        ("Darwin", "x86_64", "3.12", False),
        ("Windows", "AMD64", "3.12", False),
    ],
)
def test_the_extra_nao_asks_for_qi_where_it_has_a_wheel(
    system: str, machine: str, python: str, wanted: bool
) -> None:
    """By https://pypi.org/simple/qi/, as docs/boards.md says."""
    where = {"platform_system": system, "platform_machine": machine, "python_version": python}
    lines = re.findall(r'^    "(qi>.*)",$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    markers = [Requirement(line).marker for line in lines]
    assert sum(bool(marker and marker.evaluate(where)) for marker in markers) == int(wanted)
