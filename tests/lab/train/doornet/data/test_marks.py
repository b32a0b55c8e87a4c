"""Closer marks in place of a data set's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.data.marks import apply_marks, read_marks
from doorway3ds.lab.train.doornet.data.samples import Sample, Span

HEADER = "image,open,left,right,clear,confidence,second,kind\n"


def sample(name: str, is_open: int | None = 1) -> Sample:
    spans = (Span(10.0, 90.0, loose=True),) if is_open != 0 else ()
    image = np.zeros((40, 100, 3), np.uint8)
    return Sample(name, "doors", "p", image, (80.0, 80.0, 49.5, 19.5), is_open, spans)


def write(folder: Path, rows: str) -> Path:
    path = folder / "marks.csv"
    path.write_text(HEADER + rows)
    return path


def test_exact_openings_replace_boxes(tmp_path: Path) -> None:
    marks = read_marks(
        write(tmp_path, "a.jpg,1,0.25,0.5,1,2,0,door\na.jpg,1,0.8,1,,3,1,corridor\n")
    )
    one, other = apply_marks([sample("a.jpg"), sample("b.jpg")], marks)
    assert one.spans == (Span(24.5, 49.5, clear=1), Span(79.5, 99.5, clear=None))
    assert (one.open, one.weight) == (1, 0.8)
    assert other.spans == sample("b.jpg").spans


def test_a_half_open_door_stays_half_open(tmp_path: Path) -> None:
    marks = read_marks(write(tmp_path, "a.jpg,1,0.1,0.2,0,3,0,door\n"))
    (found,) = apply_marks([sample("a.jpg", None)], marks)
    assert found.open is None
    assert found.spans == (Span(9.5, 19.5, clear=0),)


def test_an_open_door_that_is_boxed_as_closed_is_open(tmp_path: Path) -> None:
    closed = sample("a.jpg", 0)
    closed.extra["leaf"] = (0.1, 0.1, 0.9, 0.9)
    marks = read_marks(write(tmp_path, "a.jpg,1,0.1,0.2,,3,0,door\n"))
    (found,) = apply_marks([closed], marks)
    assert (found.open, found.spans) == (1, (Span(9.5, 19.5, clear=None),))
    assert "leaf" not in found.extra  # its box is no closed leaf to build into other walls
    assert closed.extra["leaf"]


def test_an_open_closet_is_left_out(tmp_path: Path) -> None:
    marks = read_marks(write(tmp_path, "a.jpg,0,,,,3,0,closet\n"))
    (found,) = apply_marks([sample("a.jpg")], marks)
    assert (found.open, found.spans, found.weight) == (None, (), 0.0)


@pytest.mark.parametrize(
    "row",
    [
        "a.jpg,1,0.5,0.4,1,3,0,door",
        "a.jpg,1,-0.1,0.4,1,3,0,door",
        "a.jpg,1,10,40,1,3,0,door",
        "a.jpg,2,0.1,0.4,1,3,0,door",
        "a.jpg,1,0.1,0.4,yes,3,0,door",
        "a.jpg,1,0.1,0.4,1,4,0,door",
        "a.jpg,1,,0.4,1,3,0,door",
    ],
)
def test_a_wrong_row_is_named(tmp_path: Path, row: str) -> None:
    with pytest.raises(UserError, match=r"line 3: expected open 0 or 1"):
        read_marks(write(tmp_path, f"b.jpg,0,,,,3,0,door\n{row}\n"))


def test_marks_of_other_pictures_are_refused(tmp_path: Path) -> None:
    marks = read_marks(write(tmp_path, "z.jpg,1,0.1,0.4,1,3,0,door\n"))
    with pytest.raises(UserError, match="none of the 1 marked images"):
        apply_marks([sample("a.jpg")], marks)


def test_files_that_are_no_marks(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"cannot read .*missing\.csv"):
        read_marks(tmp_path / "missing.csv")
    (tmp_path / "other.csv").write_text("name,x\n1,2\n")
    with pytest.raises(UserError, match="lacks the column image; expected image, open"):
        read_marks(tmp_path / "other.csv")
