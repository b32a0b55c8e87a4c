"""Which files of a folder are images, and in which order they were meant."""

from __future__ import annotations

import os
import re
from pathlib import Path

from doorway3ds.errors import UserError
from doorway3ds.images.codec import SUFFIXES

# Of files that are refused by name, as nobody who put them there expects them to be left out.
_NAMED = SUFFIXES | {".gif", ".jxl", ".jp2"}


_Part = tuple[tuple[int, int, str], ...]


def natural(path: str | os.PathLike[str]) -> tuple[tuple[_Part, ...], str]:
    """A key that sorts 1, 2, 10 as numbers, folder by folder; equal numbers by their digits."""
    return tuple(_part(part) for part in Path(path).parts), os.fspath(path)


def _part(name: str) -> _Part:
    pieces = re.split(r"([0-9]+)", name)
    return tuple((1, int(p), "") if i % 2 else (0, 0, p) for i, p in enumerate(pieces))


def images_in(folder: Path, recursive: bool = False) -> list[Path]:
    """The images of a folder in natural order; hidden files and folders are left out.

    Raises UserError if it cannot be read.
    """
    found: list[Path] = []

    def fail(error: OSError) -> None:
        raise UserError(f"{error.filename} cannot be read: {error.strerror}") from error

    for place, folders, files in os.walk(folder, onerror=fail):
        folders[:] = [name for name in folders if recursive and not name.startswith(".")]
        found += [
            Path(place, name)
            for name in files
            if not name.startswith(".") and Path(name).suffix.lower() in _NAMED
        ]
    return sorted(found, key=natural)
