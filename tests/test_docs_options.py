"""Documentation and commands name the same options; each help text has an example."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from doorway3ds.cli.main import application, commands

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*")
# Of programs that are not ours.
FOREIGN = {
    *(
        "--force-reinstall",
        "--data-binary",
        "--logdir",
        "--system-site-packages",
        "--packages-select",
        "--nproc-per-node",
        "--nnodes",
        "--node-rank",
        "--master-addr",
        "--master-port",
        "--module",
        "--packages-select",
        "--ros-args",
    ),
    *("--minutes", "--seconds", "--ip"),  # of benchmarks/ and examples/
}
# Said by `--help` alone.
EVERYWHERE = {"--help", "--version"}


def options_of(command: Any, secondary: bool = True) -> set[str]:
    """The options of a command and of its subcommands; secondary: --no-x beside --x, too."""
    found = {name for p in command.params for name in p.opts}
    if secondary:
        found |= {name for p in command.params for name in p.secondary_opts}
    for inner in getattr(command, "commands", {}).values():
        found |= options_of(inner, secondary)
    return {name for name in found if name.startswith("--")}


@pytest.fixture(scope="module")
def options() -> dict[str, set[str]]:
    return {name: options_of(application([name]).commands[name]) for name in commands()}


def called(text: str) -> list[tuple[str, list[str]]]:
    """Calls of `3ds` in code, with the lines that they go on in: (command, words)."""
    joined = re.sub(r"\\?\n {4,}(?=[\[-])", " ", text)
    found = []
    for line in re.findall(r"(?:^ *|`|&& |\| |\$ |bin/)(3ds [a-z][^`\n]*)", joined, re.MULTILINE):
        words = re.split(r"  #| \| | && ", line)[0].split()
        found.append((words[1], OPTION.findall(" ".join(words[2:]))))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_the_documentation_calls_exists(page: Path, options: dict[str, set[str]]) -> None:
    text = page.read_text()
    known = set().union(*options.values()) | FOREIGN | EVERYWHERE
    assert sorted(set(OPTION.findall(text)) - known) == []
    for command, given in called(text):
        if command in options:
            assert sorted(set(given) - options[command] - EVERYWHERE) == [], command


def test_what_a_command_takes_is_documented() -> None:
    said = set().union(*(OPTION.findall(page.read_text()) for page in PAGES))
    said |= {name.replace("--no-", "--") for name in said}
    for name in commands():
        known = options_of(application([name]).commands[name], secondary=False)
        assert sorted(known - said) == [], name


@pytest.mark.parametrize(
    ("page", "command"),
    [("look", "look"), ("live", "live"), ("robot", "run"), ("api", "serve")],
)
def test_a_synopsis_is_whole(page: str, command: str) -> None:
    text = (ROOT / "docs" / f"{page}.md").read_text()
    synopsis = next(set(g) for c, g in called(text) if c == command and len(g) > 8)
    known = options_of(application([command]).commands[command])
    assert known - synopsis - {"--record"} == set()


@pytest.mark.parametrize("name", commands())
def test_help_shows_an_example_that_can_be_called(name: str, options: dict[str, set[str]]) -> None:
    text = application([name]).commands[name].help
    example = re.search(r"^Example: (3ds .*)$", text, re.MULTILINE)
    assert example, text
    words = shlex.split(example[1])
    assert words[1] == name
    assert {w for w in words if w.startswith("--")} <= options[name] | FOREIGN
