"""A folder per class from what is marked, as `3ds train cnn-srin` reads it."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections import Counter
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from doorway3ds.errors import UserError
from doorway3ds.files import whole, write_json
from doorway3ds.web.label.pictures import Pictures

FOLDERS = {
    "open": "open-door",
    "half": "half-open-door",
    "closed": "closed-door",
    "none": "no-door",
}
_LIST = ".3ds-label.json"  # what an earlier export put there, and may take away again


def export_classes(pictures: Pictures, states: Mapping[str, str], out: Path) -> Counter[str]:
    """Puts every marked image into the folder of its class; returns their numbers by folder.

    Images are linked where the file system can, else copied. An earlier export is brought up
    to date: what it had put into another class is taken away.

    Raises UserError if `out` lies among the images or holds what no export made.
    """
    root = pictures.root.resolve()
    if out.resolve() == root or root in out.resolve().parents:
        raise UserError(f"{out} lies among the images of {root}; choose a folder outside")
    before = _listed(out)
    wanted: dict[str, Path] = {}
    for number, name in enumerate(pictures.names):
        if name in states:
            wanted[f"{FOLDERS[states[name]]}/{name}"] = pictures.path(number)
    # Listed first: an export that is stopped half-way can be brought up to date, too.
    _write_list(out, sorted(before | set(wanted)))
    for relative in sorted(before - set(wanted)):
        _take_away(out, relative)
    for relative, source in wanted.items():
        _put(source, out / relative)
    _write_list(out, sorted(wanted))
    return Counter(relative.partition("/")[0] for relative in wanted)


def _listed(out: Path) -> set[str]:
    file = out / _LIST
    try:
        listed = {str(name) for name in json.loads(file.read_text(encoding="utf-8"))}
    except FileNotFoundError:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise UserError(
                f"{out} holds files that `3ds label` did not put there; choose a new folder"
            ) from None
        return set()
    except (OSError, ValueError, TypeError) as error:
        raise UserError(f"{file} is not a list of an earlier export: {error}") from error
    for name in listed:
        parts = PurePosixPath(name).parts
        if len(parts) < 2 or parts[0] not in FOLDERS.values() or ".." in parts:
            raise UserError(f"{file} is not a list of an earlier export: it names {name!r}")
    return listed


def _write_list(out: Path, names: list[str]) -> None:
    write_json(out / _LIST, names, 0)


def _take_away(out: Path, relative: str) -> None:
    path = out / relative
    with contextlib.suppress(OSError):
        path.unlink()
        for folder in path.relative_to(out).parents:
            (out / folder).rmdir()  # refused where something is left in it


def _put(source: Path, target: Path) -> None:
    """A link to, or a copy of, `source`: whole or not there."""
    with contextlib.suppress(OSError):
        if target.samefile(source):
            return
    with whole(target) as temporary:
        try:
            temporary.hardlink_to(source.resolve())
        except OSError:
            shutil.copy2(source, temporary)
