"""CSV files as spreadsheets of all countries write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.csvfile import csv_columns, csv_rows, number

TEXT = "image,left_px,place\nTür.jpg,10.5,hall\nb.jpg,20,\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("first", ["", "sep"])
def test_spreadsheets_files_are_read(
    tmp_path: Path, encoding: str, delimiter: str, first: str
) -> None:
    text = TEXT.replace(",", delimiter)
    if delimiter == ";":
        text = text.replace("10.5", "10,5")
    if first:
        text = f"sep={delimiter}\r\n" + text.replace("\n", "\r\n")
    path = tmp_path / "marks.csv"
    path.write_bytes(text.encode(encoding))
    assert csv_columns(path) == ["image", "left_px", "place"]
    rows = csv_rows(path, ("image", "left_px"))
    assert [row["image"] for _, row in rows] == ["Tür.jpg", "b.jpg"]
    assert [number(row, "left_px", where) for where, row in rows] == [10.5, 20.0]


def test_what_is_no_table_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    for data, says in (
        (b"", "lacks the column image"),
        (b"image;left\na.jpg;1;2\n", "line 2: expected 2 fields"),
        ("Tür".encode("latin-1"), "not a CSV file in UTF-8 or UTF-16"),
        (b'image,left\n"a.jpg,1\n', "not a CSV file"),
    ):
        path.write_bytes(data)
        with pytest.raises(UserError, match=says) as caught:
            csv_rows(path, ("image",))
        assert "\n" not in str(caught.value)
