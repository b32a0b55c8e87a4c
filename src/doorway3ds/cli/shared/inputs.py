"""What the command line calls an image: a file, a folder, or `-`."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from doorway3ds.errors import UserError

_LONGEST_STEM = 230


@dataclass(frozen=True)
class Input:
    """One image: its name as given, and a stem for files about it that no other one has."""

    name: str
    stem: str

    def read(self) -> Path | bytes:
        """What `read_image` takes. Raises UserError where standard input is a terminal."""
        if self.name != "-":
            return Path(self.name)
        from doorway3ds.images.codec import MAX_BYTES

        if sys.stdin is None or sys.stdin.isatty():
            raise UserError("- means standard input, but no image is piped in: 3ds look - < IMAGE")
        return sys.stdin.buffer.read(MAX_BYTES + 1)


def expand(names: Iterable[str]) -> tuple[list[Input], list[str]]:
    """The images of the arguments, folders in natural order, and an error per unusable folder."""
    from doorway3ds.images.folder import images_in

    found: list[str] = []
    errors: list[str] = []
    for name in names:
        if name == "-" or not Path(name).is_dir():
            found.append(name)
            continue
        try:
            inside = [str(path) for path in images_in(Path(name))]
        except UserError as error:
            errors.append(str(error))
            continue
        if not inside:
            errors.append(f"{name} holds no image; expected .jpg, .png, .webp, .tif, .bmp or .ppm")
        found += inside
    return list(_with_stems(found)), errors


def _with_stems(names: Iterable[str]) -> Iterator[Input]:
    taken: set[str] = set()
    for name in names:
        first = "stdin" if name == "-" else Path(name).stem
        # Room for what is put behind it, in file systems that take names of 255 bytes.
        first = os.fsencode(first)[:_LONGEST_STEM].decode(errors="ignore")
        stem = first
        number = 1
        while stem in taken:
            number += 1
            stem = f"{first}-{number}"
        taken.add(stem)
        yield Input(name, stem)
