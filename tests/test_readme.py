"""README, CI and documentation say the same and lead nowhere wrong."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("page", ["README.md", *(f"docs/{p.name}" for p in ROOT.glob("docs/*.md"))])
def test_links_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text()
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if not target.startswith("http"):
            assert (ROOT / page).parent.joinpath(target).exists(), target


def test_architecture_names_files_that_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    table = text.split("## Where things are")[1].split("Imports point")[0]
    for name in re.findall(r"`([a-z_]+(?:\.py|/))`", table):
        assert (ROOT / "src" / "doorway3ds" / name).exists(), name
