"""Files written whole or not at all, their digests, and text that is read or refused."""

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

from doorway3ds.errors import UserError


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


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            found.update(block)
    return found.hexdigest()
