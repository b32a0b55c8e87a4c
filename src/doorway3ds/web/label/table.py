"""`doorways.csv` on the disk, which several people may write to at once."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Mapping
from itertools import chain
from pathlib import Path

from doorway3ds.errors import UserError
from doorway3ds.files import alone, write_bytes
from doorway3ds.lab.datasets.csvfile import Row, csv_bytes, csv_columns, csv_rows
from doorway3ds.web.label.marks import COLUMNS, NEEDED, Marks, from_rows, to_rows

NAME = "doorways.csv"
UNMARKED = "unmarked"  # the revision of an image without rows


class MarkedMeanwhile(Exception):
    """The image's rows are no longer those that the change was made on."""


class Table:
    """The rows of a folder's doorways.csv, read again whenever the file has changed.

    Every change replaces one image's rows, and only where they still are those that its author
    saw. Rows of images that are not there stay, as do columns of others. The file is written
    whole, under a lock that other processes on this machine respect.

    Raises UserError, one line, where the file is damaged or another's; it is then left alone.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        self._lock = threading.RLock()
        self._seen: tuple[int, ...] | None = ()
        self._columns: list[str] = []
        self._rows: dict[str, list[Row]] = {}
        self._marks: dict[str, Marks] = {}
        self._read()

    def get(self, name: str) -> tuple[Marks | None, str]:
        """An image's marks, None if it has none, and the revision to change them by."""
        with self._lock:
            self._read()
            return self._marks.get(name), self._revision(name)

    def states(self) -> Mapping[str, str]:
        """The state of every image that has rows, by name."""
        with self._lock:
            self._read()
            return {name: marks.state for name, marks in self._marks.items()}

    def put(self, name: str, marks: Marks | None, revision: str, place: str = "") -> str:
        """Writes an image's marks, or with None takes its rows away; returns the new revision.

        Raises MarkedMeanwhile if the rows are not of `revision`, UserError if the file
        cannot be read or written; it then is as it was.
        """
        with self._lock, alone(self.path.parent):
            self._read()
            if revision != self._revision(name):
                raise MarkedMeanwhile
            rows = dict(self._rows)
            in_order = list(rows) == sorted(rows)
            if marks is None:
                rows.pop(name, None)
            else:
                rows[name] = to_rows(name, marks, place, rows.get(name, ()))
            if in_order:
                rows = dict(sorted(rows.items()))
            columns = [*self._columns, *(c for c in COLUMNS if c not in self._columns)]
            write_bytes(self.path, csv_bytes(columns, chain(*rows.values())))
            self._columns, self._rows, self._seen = columns, rows, _signature(self.path)
            if marks is None:
                self._marks.pop(name, None)
            else:
                self._marks[name] = marks
            return self._revision(name)

    def _revision(self, name: str) -> str:
        rows = self._rows.get(name)
        if rows is None:
            return UNMARKED
        filled = [{k: v for k, v in row.items() if v} for row in rows]
        return hashlib.sha256(json.dumps(filled, sort_keys=True).encode()).hexdigest()[:16]

    def _read(self) -> None:
        now = _signature(self.path)
        if now == self._seen:
            return
        grouped: dict[str, list[tuple[str, Row]]] = {}
        columns: list[str] = []
        if now is not None:
            columns = csv_columns(self.path)
            found = csv_rows(self.path, NEEDED)
            if "fx_px" in columns:
                raise UserError(
                    f"{self.path} holds the exact truth of rendered images (column fx_px), which "
                    "no hand improves; label a copy of the images without it"
                )
            for where, row in found:
                grouped.setdefault(row["image"], []).append((where, row))
        marks = {name: from_rows(rows) for name, rows in grouped.items()}
        self._rows = {name: [row for _, row in rows] for name, rows in grouped.items()}
        self._columns, self._marks, self._seen = columns, marks, now


def _signature(path: Path) -> tuple[int, ...] | None:
    """What changes with the file; None if there is none."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    return found.st_mtime_ns, found.st_size, found.st_ino
