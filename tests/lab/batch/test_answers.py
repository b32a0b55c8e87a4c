"""A batch's rows scored against marks, as the lines of `3ds look --json` are."""

from __future__ import annotations

from pathlib import Path

import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.evaluate.runners import match_answers
from doorway3ds.lab.evaluate.stored import read_answers
from tests.conftest import Cli

pytest.importorskip("pyarrow", reason="needs the extra 'batch'")


def test_rows_score_as_lines_do(cli: Cli, nyu: Path) -> None:
    net = ("--network", "net.onnx")
    assert cli("batch", nyu / "images", "--out", "out", "--workers", "1", *net).status == 0
    Path("look.jsonl").write_text(cli("look", nyu / "images", "--json", *net).out)
    samples = read_dataset(nyu).samples
    rows = match_answers(samples, read_answers([Path("out")])).records
    (records,) = rows.values()
    assert len(records) == 3
    assert rows == match_answers(samples, read_answers([Path("look.jsonl")])).records


def test_another_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="the stored answers"):
        read_answers([tmp_path])
