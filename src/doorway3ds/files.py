"""Files written whole or not at all, by one process at a time; digests; text read or refused."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from doorway3ds.errors import CallError, UserError


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A temporary name beside `path`, renamed to it at the end: a reader, a full disk or Ctrl-C
    never leaves half a file under the final name. Makes the folder if missing.

    Raises UserError if the folder or file cannot be written.
    """
    # Not by tempfile, whose files are private to the user.
    # Of a short name: that of the file may be as long as the file system allows.
    temporary = path.with_name(f".{secrets.token_hex(8)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_bytes(path: str | os.PathLike[str], data: bytes) -> Path:
    """Writes `data` to a file that is `whole`, and raises as that does."""
    path = Path(path)
    with whole(path) as temporary, temporary.open("xb") as file:
        file.write(data)
    return path


def write_json(path: str | os.PathLike[str], value: Any, indent: int = 1) -> Path:
    """Writes a value as JSON, as `write_bytes` does and raises."""
    return write_bytes(path, (json.dumps(value, indent=indent) + "\n").encode())


def read_text(path: Path) -> str:
    """The text of a file in UTF-8. Raises UserError if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"cannot read {path}: {reason}") from error


def write_array(path: str | os.PathLike[str], array: Any) -> Path:
    """Writes an array as float32 in NumPy's .npy format, as `write_bytes` does and raises."""
    import numpy as np

    buffer = io.BytesIO()
    np.save(buffer, np.asarray(array, np.float32))
    return write_bytes(path, buffer.getvalue())


@contextlib.contextmanager
def alone(folder: Path, busy: str | None = None, *, file: str = "") -> Iterator[None]:
    """Keeps out other processes that ask for the same folder, however this one ends.

    They wait, or are refused with the line `busy` that they bring. Nobody is kept out where the
    system (Windows) or the file system knows no such locks. Some network folders know those of a
    `file` in the folder, which is made if missing, but not the folder's own.

    Raises CallError if the folder is `busy`, UserError if it cannot be opened.
    """
    try:
        import fcntl
    except ModuleNotFoundError:
        yield
        return
    try:
        held = os.open(folder / file, os.O_RDWR | os.O_CREAT if file else os.O_RDONLY, 0o666)
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror}") from error
    try:
        with contextlib.suppress(OSError):
            try:
                fcntl.flock(held, fcntl.LOCK_EX | (fcntl.LOCK_NB if busy else 0))
            except BlockingIOError as error:
                raise CallError(str(busy)) from error
        yield
    finally:
        os.close(held)


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            found.update(block)
    return found.hexdigest()
