"""CSV files of marks: rows with where they stand, and values that are checked."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from doorway3ds.errors import UserError

Row = dict[str, str]


def csv_rows(path: Path, columns: Sequence[str]) -> list[tuple[str, Row]]:
    """("file line N", row) pairs. Raises UserError on a file without these columns."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, strict=True)
            missing = [c for c in columns if c not in (reader.fieldnames or [])]
            if missing:
                raise UserError(
                    f"{path} lacks the column {missing[0]}; expected {', '.join(columns)}"
                )
            rows = []
            for row in reader:
                where = f"{path} line {reader.line_num}"
                if None in row or None in row.values():
                    raise UserError(f"{where}: expected {len(reader.fieldnames or [])} fields")
                if not row["image"]:
                    raise UserError(f"{where}: names no picture")
                rows.append((where, {k: v.strip() for k, v in row.items()}))
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path} is no CSV file in UTF-8: {error}") from error
    return rows


def csv_columns(path: Path) -> list[str]:
    """The names in a CSV file's first line, whatever its encoding; none where it is empty."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
            return next(csv.reader(file), [])
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    except csv.Error as error:
        raise UserError(f"{path} is no CSV file in UTF-8: {error}") from error


def number(row: Mapping[str, str], column: str, where: str) -> float | None:
    """A finite number, None where there is nothing. Raises UserError for anything else."""
    text = row.get(column, "")
    if not text:
        return None
    try:
        value = float(text)
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
