"""`--rerun` of several commands: a viewer, or a file for it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from doorway3ds.draw.viewer import Viewer

_VIEWER = "viewer"

Rerun = Annotated[
    str | None,
    typer.Option(
        "--rerun", metavar="[FILE.rrd]", help="Show everything in Rerun, or write it to FILE.rrd."
    ),
]


def with_viewer(arguments: Sequence[str]) -> list[str]:
    """The arguments with a value for each `--rerun` that no .rrd file follows."""
    following = [*arguments[1:], ""]
    return [
        f"--rerun={_VIEWER}" if one == "--rerun" and not after.endswith(".rrd") else one
        for one, after in zip(arguments, following, strict=True)
    ]


def recorded(rerun: str | None) -> Path | None:
    """The file that `--rerun` names; None without it, or for a viewer."""
    return None if rerun in (None, _VIEWER) else Path(str(rerun))


@contextlib.contextmanager
def viewer_of(rerun: str | None) -> Iterator[Viewer | None]:
    """What `--rerun` asks for, closed at the end; None without it."""
    if rerun is None:
        yield None
        return
    from doorway3ds.draw.viewer import Viewer

    viewer = Viewer(recorded(rerun))
    try:
        yield viewer
    finally:
        viewer.close()
