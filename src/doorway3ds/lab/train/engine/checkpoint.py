"""Checkpoints: arrays and a JSON state in one file that is whole or not there."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError

_STATE = "state"


def save(path: Path, arrays: Mapping[str, NDArray[Any]], state: Mapping[str, Any]) -> Path:
    """Writes a file beside `path`, then renames: the earlier checkpoint lives until then.

    Streamed to the disk, as a network with its optimizer may be a gigabyte. Raises UserError
    where it cannot be written; the earlier checkpoint stays.
    """
    temporary = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            np.savez(file, **{_STATE: np.array(json.dumps(state))}, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise UserError(
            f"cannot write the checkpoint {path}: {error.strerror or error}; "
            f"the one before it is kept"
        ) from error
    return path


def load(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """(arrays, state) of a checkpoint; UserError where it is damaged or none."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return arrays, json.loads(str(arrays.pop(_STATE)))
    except FileNotFoundError as error:
        raise UserError(f"there is no checkpoint {path}") from error
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise UserError(
            f"the checkpoint {path} is damaged ({str(error).splitlines()[0][:80]}); "
            f"delete it and train without --resume"
        ) from error
