"""What the command line calls an image: a file, a folder, an address, or `-`."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from doorway3ds.errors import UserError

_LONGEST_STEM = 230
_WAIT_S = 20.0  # for an address to begin to answer, and between its parts
# What `3ds sim`, `3ds eval` and `3ds look` itself put beside images.
_NO_IMAGES = frozenset({"truth", "depth", "floor", "labels", "3ds-out"})


@dataclass(frozen=True)
class Input:
    """One image: its name as given, and a stem for files about it that no other one has."""

    name: str
    stem: str

    @property
    def shown(self) -> str:
        """The name as it may be printed, without an address's password."""
        from doorway3ds.sources.address import without_password

        return without_password(self.name) if is_address(self.name) else self.name

    def read(self) -> Path | bytes:
        """What `read_image` takes.

        Raises UserError if standard input is a terminal, or an address gives no file.
        """
        if is_address(self.name):
            return fetch(self.name)
        if self.name != "-":
            return Path(self.name)
        from doorway3ds.images.codec import MAX_BYTES

        if sys.stdin is None or sys.stdin.isatty():
            raise UserError("- means standard input, but no image is piped in: 3ds look - < IMAGE")
        return sys.stdin.buffer.read(MAX_BYTES + 1)


def is_address(name: str) -> bool:
    return name.startswith(("http://", "https://"))


def fetch(address: str) -> bytes:
    """The file at an address; UserError, one line, if it cannot be had or is too large."""
    import requests

    from doorway3ds.images.codec import MAX_BYTES
    from doorway3ds.sources.address import without_password

    shown = without_password(address)
    try:
        with requests.get(address, timeout=_WAIT_S, stream=True) as answer:
            if not answer.ok:
                raise UserError(f"{shown} cannot be read: the server answered {answer.status_code}")
            data = bytearray()
            for part in answer.iter_content(1 << 16):
                data += part
                if len(data) > MAX_BYTES:
                    raise UserError(f"{shown} is too large: over {MAX_BYTES >> 20} MiB")
            return bytes(data)
    except requests.Timeout as error:
        raise UserError(f"{shown} cannot be read: no answer within {_WAIT_S:g} s") from error
    except (requests.RequestException, ValueError) as error:
        raise UserError(f"{shown} cannot be read: the server does not answer") from error


def images_of(names: Iterable[str], recursive: bool = False) -> tuple[list[Input], list[str]]:
    """The images of the arguments, folders in natural order, and an error per unusable folder.

    recursive: those of a folder's folders, too, but for folders that hold truth or answers.
    """
    from doorway3ds.images.folder import images_in

    found: list[str] = []
    errors: list[str] = []
    for name in names:
        if not name:
            errors.append("the name of an image is empty; expected a file, a folder or an address")
            continue
        if name == "-" or is_address(name) or not Path(name).is_dir():
            found.append(name)
            continue
        try:
            inside = [
                str(path)
                for path in images_in(Path(name), recursive)
                if not _NO_IMAGES.intersection(path.relative_to(name).parts)
            ]
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
        file = urlsplit(name).path if is_address(name) else name
        first = "stdin" if name == "-" else Path(file).stem or "image"
        # Room for what is put behind it, in file systems that take names of 255 bytes.
        first = os.fsencode(first)[:_LONGEST_STEM].decode(errors="ignore")
        stem = first
        number = 1
        while stem in taken:
            number += 1
            stem = f"{first}-{number}"
        taken.add(stem)
        yield Input(name, stem)
