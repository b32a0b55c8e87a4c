"""Every number that a command takes has bounds: none is accepted that means nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from doorway3ds.cli.main import application, run

USELESS = ("nan", "inf", "-inf", "1e30", str(-(10**30)))


def leaves(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Commands that do something, with the words that call them."""
    inner = getattr(command, "commands", {})
    if not inner:
        yield path, command
    for name, one in inner.items():
        yield from leaves(one, (*path, name))


def is_number(parameter: Any) -> bool:
    kind = str(parameter.type_descriptor.annotation)
    return parameter.param_type_name == "option" and ("int" in kind or "float" in kind)


def needed(command: Any, folder: Path) -> list[str]:
    """The least that a command must be given."""
    words = []
    for parameter in command.params:
        if parameter.required:
            option = parameter.param_type_name == "option"
            words += [*parameter.opts[: int(option)], "1" if is_number(parameter) else str(folder)]
    return words


LEAVES = dict(leaves(application([])))
OPTIONS = [
    (path, p.opts[0]) for path, command in LEAVES.items() for p in command.params if is_number(p)
]


def test_numbers_are_found() -> None:
    assert len(OPTIONS) > 100
    assert (("look",), "--fov-deg") in OPTIONS
    assert (("sim", "view"), "--x") in OPTIONS


@pytest.mark.parametrize(("path", "option"), OPTIONS, ids=[" ".join((*p, o)) for p, o in OPTIONS])
def test_a_number_has_bounds(
    path: tuple[str, ...], option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = needed(LEAVES[path], tmp_path)
    for value in USELESS:
        status = run([*path, *given, option, value])
        line = capsys.readouterr().err
        assert status == 2, (value, line)
        assert option in line and line.count("\n") == 1, (value, line)
