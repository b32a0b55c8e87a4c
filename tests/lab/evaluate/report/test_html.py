import json
import math
from dataclasses import replace

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.lab.datasets import samples as datasets
from doorway3ds.lab.datasets.truth import PictureTruth, TruthOpening
from doorway3ds.lab.evaluate import classifier
from doorway3ds.lab.evaluate.classifier import ClassifierRecord
from doorway3ds.lab.evaluate.direction import DirectionRecord, judge
from doorway3ds.lab.evaluate.intervals import Interval
from doorway3ds.lab.evaluate.report import pages, plots, sheets
from doorway3ds.lab.evaluate.report.html import Report, Table, cell, render, write_report
from doorway3ds.types import Frame


@pytest.mark.parametrize(
    ("interval", "unit", "text"),
    [
        (Interval(0.6214, 0.55, 0.689, 10), "share", "62.1 % (55.0–68.9)"),
        (Interval(3.55, math.nan, math.nan, 10), "deg", "3.5°"),
        (Interval(0.5, 0.4, 0.6, 10), "m", "0.50 m (0.40–0.60)"),
        (Interval(0.87, 0.8, 0.9, 10), "", "0.870 (0.800–0.900)"),
        (Interval(math.nan, math.nan, math.nan, 0), "share", "–"),
    ],
)
def test_cells(interval, unit, text):
    assert cell(interval, unit) == text


def test_the_page_is_whole_and_escapes_names(tmp_path):
    report = Report("A & B", {"data": "<folder>"}, [Table("T", ["x<y"], [("row", "", ["1"])])])
    report.add_sheet("worst-1", "Worst", np.zeros((4, 5, 3), np.uint8))
    page = write_report(report, tmp_path / "out", {"value": None})
    text = page.read_text()
    assert "<title>A &amp; B</title>" in text
    assert "&lt;folder&gt;" in text and "x&lt;y" in text
    assert "data:image/png;base64," in text
    assert (tmp_path / "out" / "worst-1.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == {"value": None}


def test_unknown_numbers_are_null_in_the_json(tmp_path):
    write_report(Report("t", {}), tmp_path, {"values": [math.nan, 1.5]})
    assert json.loads((tmp_path / "report.json").read_text()) == {"values": [None, 1.5]}


def test_sheets_hold_every_tile():
    tiles = [sheets.Tile(np.full((h, 30, 3), 200, np.uint8), "a caption") for h in (20, 40, 30)]
    sheet = sheets.contact_sheet(tiles, columns=2)
    assert sheet.shape[1] == 2 * sheets.TILE_WIDTH + 3 * sheets.GAP
    assert sheet.shape[0] > (400 + 300) + 3 * sheets.GAP
    with pytest.raises(ValueError, match="at least one"):
        sheets.contact_sheet([])


@pytest.mark.parametrize("pose", [Pose(), Pose(pitch_deg=10, roll_deg=3, yaw_deg=-5)])
def test_the_answers_line_stands_where_its_bearing_is(pose):
    camera = Camera.from_fov(64, 48, 60)
    frame = Frame(np.zeros((48, 64, 3), np.uint8), camera, pose)
    assert datasets.bearing_to_column(frame, pose.yaw_deg) == pytest.approx(31.5, abs=0.6)
    assert datasets.bearing_to_column(frame, pose.yaw_deg + 10) < 31


def record(reason, listed, openings, p_open=0.9):
    truth = PictureTruth("a", "p", bool(openings), tuple(openings))
    return DirectionRecord(truth, tuple((b, None) for b in listed), reason, p_open, None)


def test_worst_first():
    blocked = TruthOpening(5, -5, 0, clear=False)
    clear = TruthOpening(5, -5, 0, clear=True)
    in_order = [
        record("turn", [40], [clear]),
        record("turn", [10], [clear]),
        record("turn", [3], []),
        record("turn", [1], [blocked]),
        record("no_door", [], [clear]),
        record("unsure", [9], [clear]),
        record("turn", [1], [clear]),
    ]
    harm = [pages.badness(judge(r), r) for r in in_order]
    assert harm == sorted(harm, reverse=True)
    assert harm[-1] == 0
    assert pages.badness(judge(record("no_door", [3], [])), record("no_door", [3], [])) == 0
    unmarked = replace(record("turn", [3], []), truth=PictureTruth("a", "p", True))
    assert pages.badness(judge(unmarked), unmarked) == 0  # nobody can tell


def test_a_kind_that_only_some_columns_show_has_no_share_in_the_others():
    shown = ClassifierRecord("a", "1", False, 0.7, ("mirror",))
    scored = {"x": classifier.score([shown]), "y": classifier.score([replace(shown, kinds=())])}
    title, _, cells = pages.classifier_table(scored).rows[-1]
    assert title == "called open: mirror, Wilson, n = 0 to 1"
    assert cells[0].startswith("100.0 %") and cells[1] == "–"


def test_plots_are_pictures():
    pytest.importorskip("matplotlib")
    records = [record("turn", [4], [TruthOpening(5, -5, 0)]), record("no_door", [], [])]
    assert plots.bearing_errors({"a": records}).startswith(b"\x89PNG")


def test_render_needs_no_pictures():
    assert "<img" not in render(Report("t", {}))


def test_reasons_are_explained_on_the_page_itself():
    page = render(Report("t", {}, reasons=True))
    assert '<a href="#reasons">' in page
    assert '<h2 id="reasons">Reasons</h2>' in page
    assert '<h3 id="blocked">blocked</h3>' in page
    assert "reasons" not in render(Report("t", {}))
