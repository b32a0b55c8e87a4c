"""CSV files of marks: rows with where they stand, and values that are checked."""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from doorway3ds.errors import UserError

Row = dict[str, str]

# What every doorways.csv begins with; tables of others may lack all but the first four.
MARKS = ("image", "open", "left_px", "right_px", "clear", "confidence", "second")


def csv_rows(path: Path, columns: Sequence[str]) -> list[tuple[str, Row]]:
    """("file line N", row) pairs of a file with commas, semicolons or tabs between its fields.

    Raises UserError on a file without these columns.
    """
    try:
        text, delimiter = _read(path)
        reader = csv.DictReader(io.StringIO(text, newline=""), strict=True, delimiter=delimiter)
        missing = [c for c in columns if c not in (reader.fieldnames or [])]
        if missing:
            raise UserError(f"{path} lacks the column {missing[0]}; expected {', '.join(columns)}")
        rows = []
        for row in reader:
            where = f"{path} line {reader.line_num}"
            if None in row or None in row.values():
                raise UserError(f"{where}: expected {len(reader.fieldnames or [])} fields")
            if not row["image"]:
                raise UserError(f"{where}: names no image")
            rows.append((where, {k: v.strip() for k, v in row.items()}))
    except csv.Error as error:
        raise UserError(f"{path} is not a CSV file: {error}") from error
    return rows


def csv_columns(path: Path) -> list[str]:
    """The names in a CSV file's first line; none if it is empty. Raises UserError."""
    try:
        text, delimiter = _read(path)
        return next(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter), [])
    except csv.Error as error:
        raise UserError(f"{path} is not a CSV file: {error}") from error


def csv_bytes(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> bytes:
    """The rows as a CSV file with a header; a value that a row lacks stays empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _read(path: Path) -> tuple[str, str]:
    """A file's text, UTF-8 or the UTF-16 of spreadsheets, and what separates its fields."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    marked = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    # Without its mark, UTF-16 shows by the zero byte beside the first letter.
    bare = {b"\0": "utf-16-be"}.get(data[:1]) or {b"\0": "utf-16-le"}.get(data[1:2])
    try:
        text = data.decode("utf-16" if marked else bare or "utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not a CSV file in UTF-8 or UTF-16: {error}") from error
    text = re.sub(r"\A\ufeff?(?:sep=.\r?\n)?", "", text)
    head = text.partition("\n")[0]
    return text, max(",;\t", key=head.count)


def number(row: Mapping[str, str], column: str, where: str) -> float | None:
    """A finite number, None where there is nothing. Raises UserError for anything else."""
    text = row.get(column, "")
    if not text:
        return None
    try:
        # A decimal comma goes with semicolons, in the spreadsheets of half the world.
        value = float(text.replace(",", ".", 1))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UserError(f"{where}: expected a number for {column}, got '{text}'")
    return value


def flag(row: Mapping[str, str], column: str, where: str) -> bool | None:
    """1, 0 or nothing as True, False or None. Raises UserError for anything else."""
    text = row.get(column, "")
    if text not in ("", "0", "1"):
        raise UserError(f"{where}: expected 0, 1 or nothing for {column}, got '{text}'")
    return None if text == "" else text == "1"
