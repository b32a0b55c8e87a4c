"""Answers that are stored: JSON lines of `3ds look` and `3ds eval`, Parquet of `3ds batch`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from doorway3ds.errors import UserError
from doorway3ds.files import read_text


@dataclass(frozen=True)
class Label:
    """Which column of the table: a method on a network."""

    method: str
    network: str

    def __str__(self) -> str:
        return f"{self.method} on {self.network}"


def read_answers(paths: Sequence[Path]) -> dict[Label, dict[str, dict[str, Any]]]:
    """Stored answers by column and by the image's name as written.

    paths: files with one JSON object a line, or folders that `3ds batch` wrote.

    Raises UserError if one cannot be read or holds something else.
    """
    answers: dict[Label, dict[str, dict[str, Any]]] = {}
    for path in paths:
        for where, read in _rows(path) if path.is_dir() else _lines(path):
            try:
                answer = read()
                label = Label(str(answer["method"]), str(answer["network"]))
                answers.setdefault(label, {})[str(answer["image"])] = answer
            except (ValueError, KeyError, TypeError) as error:
                raise UserError(
                    f"{path} {where}: expected an object as `3ds look --json` writes it"
                ) from error
    if not answers:
        raise UserError(f"{', '.join(map(str, paths))}: no stored answers")
    return answers


_Read = tuple[str, Callable[[], dict[str, Any]]]
"""Where an answer stands, and a function that reads it."""


def _lines(path: Path) -> Iterator[_Read]:
    return (
        (f"line {number}", partial(json.loads, line))
        for number, line in enumerate(read_text(path).splitlines(), 1)
        if line.strip()
    )


def _rows(folder: Path) -> Iterator[_Read]:
    """Rows of a batch that have an answer."""
    import pyarrow.dataset

    try:
        data = pyarrow.dataset.dataset(folder, format="parquet")
        answered = data.to_table(filter=pyarrow.dataset.field("error").is_null())
    except (pyarrow.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"cannot read the stored answers {folder}: {reason}") from error
    rows = (row for batch in answered.to_batches() for row in batch.to_pylist())
    return ((f"row {number}", partial(dict, row)) for number, row in enumerate(rows, 1))


def by_name_end(answers: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Answers by every tail of their path, so that `photos/images/a.jpg` answers `a.jpg`."""
    ends: dict[str, dict[str, Any]] = {}
    for written, answer in answers.items():
        parts = Path(written).parts
        for start in range(len(parts)):
            ends.setdefault("/".join(parts[start:]), answer)
    return ends
