"""The printable board, read back out of its PDF."""

from __future__ import annotations

import io
import re
import struct

import cv2
import numpy as np
import pytest
from PIL import Image

from doorway3ds.camera.board import RULER_MM, Board, find_corners, printable
from doorway3ds.cli.main import run

PER_POINT = 25.4 / 72


def page_of(pdf: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The dots (H, W) of the one image of a PDF and the page's size in millimetres, x then y."""
    box = re.search(rb"/MediaBox \[ 0 0 (\S+) (\S+) \]", pdf)
    width, height = (int(re.search(rb"/%s (\d+)" % key, pdf)[1]) for key in (b"Width", b"Height"))
    begin = pdf.index(b"stream\n") + 7
    data = pdf[begin : begin + int(re.search(rb"/Length (\d+)", pdf)[1])]
    assert b"/CCITTFaxDecode" in pdf
    assert b"/BlackIs1 true" in pdf
    # What a fax sends, under the header of a TIFF in which 1 is white, as it is in the PDF.
    tags = [(256, width), (257, height), (258, 1), (259, 4), (262, 1), (273, 122)]
    tags += [(277, 1), (278, height), (279, len(data))]
    head = b"II*\0" + struct.pack("<IH", 8, len(tags))
    head += b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    dots = Image.open(io.BytesIO((head + bytes(4)).ljust(122, b"\0") + data))
    return np.asarray(dots.convert("L")), np.array([float(v) for v in box.groups()]) * PER_POINT


@pytest.mark.parametrize(
    "board",
    [
        Board(9, 6, 0.025),
        Board(6, 9, 0.0237),
        Board(8, 5, 0.03, 0.0225),
    ],
)
def test_the_page_is_a4_and_its_squares_are_as_long_as_asked(board):
    dots, size_mm = page_of(printable(board, ("check", "3ds calibrate")))
    assert sorted(size_mm) == pytest.approx([210, 297], abs=0.05)
    assert (size_mm[0] > size_mm[1]) == (board.columns >= board.rows)
    per_mm = dots.shape[1] / size_mm[0]
    assert dots.shape[0] / size_mm[1] == pytest.approx(per_mm, rel=1e-6)
    shrunk = 5  # the corners of the whole page, which is large
    small = cv2.resize(dots, None, fx=1 / shrunk, fy=1 / shrunk, interpolation=cv2.INTER_AREA)
    points, pixels = find_corners(np.repeat(small[..., None], 3, 2), board)
    mm = pixels * (shrunk / per_mm)
    for axis in (0, 1):
        slope = np.polyfit(points[:, axis] * 1e3, mm[:, axis], 1)[0]
        assert abs(slope) == pytest.approx(1, abs=1e-3)
    # Of a chessboard every square, to the dot.
    if board.marker_m is None:
        row = np.flatnonzero(np.diff(dots[round(11 * per_mm)].astype(int)))
        assert np.diff(row) / per_mm == pytest.approx([board.square_m * 1e3] * (len(row) - 1))


def test_the_ruler_measures_100_mm():
    dots, size_mm = page_of(printable(Board(9, 6, 0.025), ()))
    per_mm = dots.shape[1] / size_mm[0]
    ticks = dots[round((210 - 20 + 1) * per_mm)]
    edges = np.flatnonzero(np.diff(ticks.astype(int)) < 0)
    assert len(edges) == 11
    assert (edges[-1] - edges[0]) / per_mm == pytest.approx(RULER_MM, abs=0.05)


def test_the_command_prints_the_board_and_the_call_for_it(tmp_path, capsys):
    path = tmp_path / "board.pdf"
    call = ["calibrate", "--board-pdf", str(path), "--charuco", "--board", "8x5"]
    assert run([*call, "--square-mm", "30"]) == 0
    assert "--board 8x5 --square-mm 30 --charuco" in capsys.readouterr().out
    assert page_of(path.read_bytes())[1] == pytest.approx([297, 210], abs=0.05)


@pytest.mark.parametrize(
    ("more", "status", "said"),
    [
        (["--square-mm", "40"], 1, "--square-mm 25 does"),
        (["wall.jpg"], 2, "leave one of them out"),
        (["--charuco", "--board", "20x12", "--square-mm", "10"], 1, "needs 120 markers"),
    ],
)
def test_a_board_that_cannot_be_printed_is_refused(tmp_path, capsys, more, status, said):
    assert run(["calibrate", "--board-pdf", str(tmp_path / "b.pdf"), *more]) == status
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
