"""doorways.csv as it is written, shared and protected."""

from __future__ import annotations

import csv
import threading
from pathlib import Path

import pytest

from doorway3ds.errors import UserError
from doorway3ds.web.label.marks import MarkedOpening, Marks, from_rows, to_rows
from doorway3ds.web.label.table import UNMARKED, MarkedMeanwhile, Table

TWO = Marks(
    (MarkedOpening(10.5, 99.94, clear=True), MarkedOpening(-0.5, 7, True, None, 2)), confidence=3
)


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "doorways.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_marks_become_the_rows_that_readers_know(tmp_path: Path) -> None:
    table = Table(tmp_path)
    table.put("b.jpg", TWO, UNMARKED)
    table.put("hall/a.jpg", Marks(closed=True, confidence=2), UNMARKED, "hall")
    table.put("a.jpg", Marks(), UNMARKED)
    assert (tmp_path / "doorways.csv").read_text() == (
        "image,open,left_px,right_px,clear,confidence,second,state,place\n"
        "a.jpg,0,,,,3,0,none,\n"
        "b.jpg,1,10.5,99.9,1,3,0,open,\n"
        "b.jpg,1,-0.5,7.0,,2,1,half,\n"
        "hall/a.jpg,0,,,,2,0,closed,hall\n"
    )
    again = Table(tmp_path)
    marks, _ = again.get("b.jpg")
    assert marks is not None
    assert marks.openings[1] == TWO.openings[1]
    assert again.get("hall/a.jpg")[0] == Marks(closed=True, confidence=2)
    assert again.states() == {"a.jpg": "none", "b.jpg": "open", "hall/a.jpg": "closed"}


@pytest.mark.parametrize(
    ("marks", "state"),
    [
        (TWO, "open"),
        (Marks((MarkedOpening(1, 2, True),)), "half"),
        (Marks(closed=True), "closed"),
        (Marks(), "none"),
    ],
)
def test_marks_survive_the_table(marks: Marks, state: str) -> None:
    written = [("line", row) for row in to_rows("x.jpg", marks, "")]
    found = from_rows(written)
    assert found.state == marks.state == state
    assert len(found.openings) == len(marks.openings)


def test_nothing_of_others_is_lost(tmp_path: Path) -> None:
    (tmp_path / "doorways.csv").write_text(
        "image,open,left_px,right_px,clear,confidence,second,note,place\n"
        "0002.jpg,1,152.6,177.4,0,2,0,the pantry,ground floor\n"
        "0002.jpg,1,300,400,,1,1,,\n"
        "gone.jpg,0,,,,3,0,was deleted,\n"
    )
    table = Table(tmp_path)
    marks, revision = table.get("0002.jpg")
    assert marks == Marks(
        (MarkedOpening(152.6, 177.4, False, False, 2), MarkedOpening(300, 400, confidence=1))
    )
    table.put("0002.jpg", Marks((MarkedOpening(150, 180),)), revision, "elsewhere")
    first, gone = rows(tmp_path)
    assert (first["left_px"], first["note"], first["place"]) == (
        "150.0",
        "the pantry",
        "ground floor",
    )
    assert (gone["image"], gone["note"], gone["state"]) == ("gone.jpg", "was deleted", "")


def test_a_change_on_what_somebody_else_changed_is_refused(tmp_path: Path) -> None:
    mine, theirs = Table(tmp_path), Table(tmp_path)
    _, seen = mine.get("a.jpg")
    theirs.put("a.jpg", Marks(closed=True), seen)
    theirs.put("b.jpg", TWO, UNMARKED)
    with pytest.raises(MarkedMeanwhile):
        mine.put("a.jpg", Marks(), seen)
    # what the other one wrote is there, also for a picture that was not looked at before
    assert mine.get("a.jpg")[0] == Marks(closed=True)
    mine.put("c.jpg", Marks(), UNMARKED)
    assert [row["image"] for row in rows(tmp_path)] == ["a.jpg", "b.jpg", "b.jpg", "c.jpg"]
    marks, revision = theirs.get("c.jpg")
    assert marks == Marks()
    assert theirs.put("c.jpg", None, revision) == UNMARKED
    assert mine.get("c.jpg") == (None, UNMARKED)


def test_two_writers_at_once_lose_nothing(tmp_path: Path) -> None:
    def write(letter: str) -> None:
        table = Table(tmp_path)
        for number in range(25):
            table.put(f"{letter}{number:02d}.jpg", Marks(), UNMARKED)

    threads = [threading.Thread(target=write, args=(letter,)) for letter in "abc"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(rows(tmp_path)) == 75
    assert [p.name for p in tmp_path.iterdir()] == ["doorways.csv"]


HEADER = "image,open,left_px,right_px,clear,confidence,second,state\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "lacks the column image"),
        ("picture,door\na.jpg,1\n", "lacks the column image"),
        (HEADER + "a.jpg,1,10,20,1,3\n", "line 2: expected 8 fields"),
        (HEADER + "a.jpg,1,20,10,1,3,0,open\n", "line 2: an opening's left edge must lie left"),
        (HEADER + "a.jpg,1,,,1,3,0,open\n", "line 2: an open row needs left_px"),
        (HEADER + "a.jpg,,,,,3,0,\n", "line 2: expected open 0 or 1"),
        (HEADER + "a.jpg,0,,,,9,0,none\n", "line 2: expected a confidence of 1, 2 or 3"),
        (HEADER + "a.jpg,0,,,,3,0,ajar\n", "line 2: expected a state of none, closed, got 'ajar'"),
        (HEADER + "a.jpg,0,,,,3,0,\na.jpg,0,,,,3,0,\n", "line 3: a second row"),
        (HEADER + "a.jpg,1,1,2,,3,0,\na.jpg,0,,,,3,1,\n", "line 3: a row without an opening"),
        ("image,open,left_px,right_px,fx_px\na.jpg,0,,,300\n", "exact truth of rendered images"),
        (HEADER + 'a.jpg,0,,,,3,0,"no', "not a CSV file"),
    ],
)
def test_a_table_that_is_damaged_or_anothers_is_refused_and_kept(
    tmp_path: Path, content: str, message: str
) -> None:
    file = tmp_path / "doorways.csv"
    file.write_text(content)
    with pytest.raises(UserError) as caught:
        Table(tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert file.read_text() == content


def test_damage_done_meanwhile_is_not_written_over(tmp_path: Path) -> None:
    table = Table(tmp_path)
    table.put("a.jpg", Marks(), UNMARKED)
    file = tmp_path / "doorways.csv"
    file.write_text("half a li")
    with pytest.raises(UserError, match="lacks the column"):
        table.put("b.jpg", Marks(), UNMARKED)
    assert file.read_text() == "half a li"
    file.write_text(HEADER + "z.jpg,0,,,,3,0,none\n")
    table.put("b.jpg", Marks(), UNMARKED)
    assert [row["image"] for row in rows(tmp_path)] == ["b.jpg", "z.jpg"]


def test_a_folder_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    table = Table(tmp_path / "gone")
    with pytest.raises(UserError, match="cannot write"):
        table.put("a.jpg", Marks(), UNMARKED)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: MarkedOpening(2, 1),
        lambda: MarkedOpening(0, float("nan")),
        lambda: MarkedOpening(0, 1, confidence=4),
        lambda: Marks((MarkedOpening(0, 1),), closed=True),
        lambda: Marks(tuple(MarkedOpening(k, k + 1) for k in range(21))),
    ],
)
def test_marks_that_make_no_sense_cannot_be_made(wrong: object) -> None:
    with pytest.raises(ValueError):
        wrong()  # type: ignore[operator]
