"""The rows of a batch: the JSON contract as columns, written so that a batch can be taken up again.

A data set is a folder of Parquet files that pyarrow, DuckDB or Spark read as one table. Each file
is whole or not there; `_settings.json` beside them says how the rows were made.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from doorway3ds.errors import CallError, UserError
from doorway3ds.files import alone, read_text, write_bytes
from doorway3ds.types import Decision

Row = dict[str, Any]

_PIXEL = pa.list_(pa.int32())
_OPENING = pa.struct(
    [
        ("left_deg", pa.float64()),
        ("right_deg", pa.float64()),
        ("bearing_deg", pa.float64()),
        ("range_m", pa.float64()),
        ("score", pa.float64()),
        ("cut", pa.string()),
        ("left_px", pa.float64()),
        ("right_px", pa.float64()),
    ]
)
SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("occurrence", pa.int32()),
        ("digest", pa.string()),
        ("width", pa.int32()),
        ("height", pa.int32()),
        ("method", pa.string()),
        ("network", pa.string()),
        ("camera", pa.string()),
        ("camera_assumed", pa.bool_()),
        ("p_open", pa.float64()),
        ("open", pa.bool_()),
        ("reason", pa.string()),
        ("turn_deg", pa.float64()),
        ("bearing_deg", pa.float64()),
        ("range_m", pa.float64()),
        ("clear", pa.bool_()),
        ("floor_from_m", pa.float64()),
        ("look", pa.string()),
        ("openings", pa.list_(_OPENING)),
        ("pixel", _PIXEL),
        ("max_pixel", _PIXEL),
        ("best_pixel", _PIXEL),
        ("trigger_pixel", _PIXEL),
        ("max_depth", pa.float64()),
        ("best_depth", pa.float64()),
        ("error", pa.string()),
    ]
)

ROWS_PER_FILE = 2000
FLUSH_S = 60.0


def answered(name: str, occurrence: int, digest: str, decision: Decision) -> Row:
    """The row of a decision: `Decision.to_dict` without its timings, which differ by run."""
    answer = decision.to_dict(name)
    answer.pop("timings_ms")
    camera = answer.pop("camera")
    height, width = decision.frame.image.shape[:2]
    return {
        **answer,
        "occurrence": occurrence,
        "digest": digest,
        "width": width,
        "height": height,
        "camera": camera["name"],
        "camera_assumed": camera["assumed"],
        "error": None,
    }


def unanswered(name: str, occurrence: int, digest: str | None, error: str) -> Row:
    """The row of an image without an answer; without a digest it is tried again next time."""
    return {"image": name, "occurrence": occurrence, "digest": digest, "error": error}


@dataclass
class DataSet:
    """Rows in a folder, opened by one process at a time.

    folder: made if missing. settings: what the rows depend on; a folder with others is refused.

    Raises CallError for a folder of other settings or in use, UserError if it cannot be written.
    """

    folder: Path
    settings: Mapping[str, Any]
    _known: dict[int, bytes] = field(default_factory=dict, repr=False)
    _rows: list[Row] = field(default_factory=list, repr=False)
    _stale: list[Row] = field(default_factory=list, repr=False)
    _flushed_s: float = field(default_factory=time.monotonic, repr=False)
    _open: contextlib.ExitStack = field(default_factory=contextlib.ExitStack, repr=False)

    def __enter__(self) -> DataSet:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"cannot write {self.folder}: {error.strerror or error}") from error
        with contextlib.ExitStack() as opening:
            busy = f"{self.folder} is being written by another batch"
            opening.enter_context(alone(self.folder, busy, file="_lock"))
            self._check_settings()
            for left in self.folder.glob(".*.part"):
                left.unlink(missing_ok=True)
            self._read_known()
            self._open = opening.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # What is decided is kept, also after Ctrl-C; an error of writing would hide the first one.
        with self._open:
            if error is None or not isinstance(error, UserError):
                self.flush()

    def known(self, name: str, occurrence: int) -> str | None:
        """The digest of an image that has a row, or None."""
        digest = self._known.get(_key(name, occurrence))
        return None if digest is None else digest.hex()

    def __len__(self) -> int:
        return len(self._known)

    def add(self, row: Row) -> None:
        """Adds a row, or puts it in the place of the one of the same image; written in time."""
        key = _key(row["image"], row["occurrence"])
        if self._known.pop(key, None) is not None:
            self._stale.append(row)
        if row["digest"] is not None:
            self._known[key] = bytes.fromhex(row["digest"])
        self._rows.append(row)
        late = time.monotonic() - self._flushed_s > FLUSH_S
        if len(self._rows) >= ROWS_PER_FILE or late:
            self.flush()

    def flush(self) -> None:
        """Writes what was added since. Raises UserError if the disk does not take it."""
        self._flushed_s = time.monotonic()
        if self._stale:
            # First out, then in: killed in between, the image is decided again, never twice there.
            self._drop(self._stale)
            self._stale = []
        if self._rows:
            used = [int(path.stem[5:]) for path in self.folder.glob("part-*.parquet")]
            path = self.folder / f"part-{max(used, default=-1) + 1:06d}.parquet"
            _write(path, pa.Table.from_pylist(self._rows, SCHEMA))
            self._rows = []

    def _check_settings(self) -> None:
        path = self.folder / "_settings.json"
        text = json.dumps(self.settings, indent=1, sort_keys=True)
        found = read_text(path) if path.exists() else None
        if found is None:
            if any(self.folder.glob("part-*.parquet")):
                raise CallError(f"{self.folder} holds Parquet files of something else")
            write_bytes(path, text.encode())
        elif found != text:
            try:
                before = json.loads(found)
            except ValueError:
                before = {}
            other = [k for k in self.settings if before.get(k) != json.loads(text)[k]]
            raise CallError(
                f"{self.folder} holds rows of other settings ({', '.join(other)}); "
                f"choose another --out or repeat the call that made them"
            )

    def _read_known(self) -> None:
        """Digests by image; rows that could not be read at all are dropped and tried again."""
        retry: list[Row] = []
        for path in sorted(self.folder.glob("part-*.parquet")):
            for row in _read(path, ["image", "occurrence", "digest"]).to_pylist():
                if row["digest"] is None:
                    retry.append(row)
                else:
                    key = _key(row["image"], row["occurrence"])
                    self._known[key] = bytes.fromhex(row["digest"])
        if retry:
            self._drop(retry)

    def _drop(self, rows: list[Row]) -> None:
        gone = {(row["image"], row["occurrence"]) for row in rows}
        for path in sorted(self.folder.glob("part-*.parquet")):
            keys = _read(path, ["image", "occurrence"]).to_pylist()
            keep = [(row["image"], row["occurrence"]) not in gone for row in keys]
            if all(keep):
                continue
            if any(keep):
                _write(path, _read(path, None).filter(pa.array(keep)))
            else:
                path.unlink()


def read_rows(folder: Path, columns: list[str] | None = None) -> pa.Table:
    """All rows of a data set, in the order in which they were decided.

    Raises UserError if the folder holds no such data set.
    """
    paths = sorted(folder.glob("part-*.parquet"))
    if not paths:
        raise UserError(f"{folder} holds no rows; expected the --out folder of `3ds batch`")
    return pa.concat_tables(_read(path, columns) for path in paths)


def counts(folder: Path) -> dict[str, dict[str, int]]:
    """Numbers of images, open, turn, blocked, unsure and errors in each folder, archive or film.

    They are in name order.
    """
    table = read_rows(folder, ["image", "open", "reason", "error"])
    where = pc.replace_substring_regex(table["image"], "[/#][^/#]*$", "")
    loose = pc.equal(where, table["image"])
    where = pc.if_else(loose, ".", where)
    reason = table["reason"]
    flags = {
        "images": pc.is_valid(table["image"]),
        "open": pc.fill_null(table["open"], False),
        "turn": pc.fill_null(pc.is_in(reason, pa.array(["turn", "aligned"])), False),
        "blocked": pc.fill_null(pc.equal(reason, "blocked"), False),
        "unsure": pc.fill_null(pc.equal(reason, "unsure"), False),
        "errors": pc.is_valid(table["error"]),
    }
    sums = pa.table({"where": where, **{k: pc.cast(v, pa.int64()) for k, v in flags.items()}})
    grouped = sums.group_by("where").aggregate([(name, "sum") for name in flags])
    return {
        row["where"]: {name: row[f"{name}_sum"] for name in flags}
        for row in sorted(grouped.to_pylist(), key=lambda row: str(row["where"]))
    }


def _key(name: str, occurrence: int) -> int:
    digest = hashlib.blake2b(f"{occurrence}:{name}".encode(errors="surrogateescape"), digest_size=8)
    return int.from_bytes(digest.digest(), "little")


def _read(path: Path, columns: list[str] | None) -> pa.Table:
    try:
        return pq.ParquetFile(path).read(columns)
    except (pa.ArrowException, OSError) as error:
        raise UserError(
            f"{path} cannot be read ({str(error).splitlines()[0]}); remove it, and its images are "
            f"decided again"
        ) from error


def _write(path: Path, table: pa.Table) -> None:
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    write_bytes(path, buffer.getvalue())
