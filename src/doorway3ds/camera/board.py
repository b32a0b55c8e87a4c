"""Flat boards of squares: to print at an exact size, and to find in images."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

Corners = NDArray[np.float32]

A4_MM = (297, 210)
RULER_MM = 100
_EDGE_MM = 9.0  # printers leave the paper's edge white, and a board needs white around it
_FOOT_MM = 26.0  # white, the ruler, two lines of text, white
_RULER_UP_MM = 20.0  # from the page's lower edge
_DOTS_PER_MM = 20


@dataclass(frozen=True)
class Board:
    """A flat board of squares.

    columns, rows: inner corners of a chessboard (OpenCV's count); squares of a ChArUco board.
    marker_m: side of a ChArUco board's markers, None for a chessboard.
    dictionary: OpenCV's name of the markers' dictionary.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float | None = None
    dictionary: str = "DICT_4X4_50"

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or self.square_m <= 0:
            raise UserError(
                "a board needs at least 3x3 corners (chessboard) or squares (ChArUco) of a size "
                f"above 0, got {self.columns}x{self.rows} of {self.square_m * 1e3:g} mm"
            )
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise UserError(
                "a ChArUco marker must be smaller than its square, got "
                f"{self.marker_m * 1e3:g} mm in {self.square_m * 1e3:g} mm"
            )


@dataclass(frozen=True)
class BoardView:
    """One image's board points (n, 3) in metres and their pixels (n, 2)."""

    name: str
    points: Corners
    corners: Corners


def find_corners(image: NDArray[np.uint8], board: Board) -> tuple[Corners, Corners] | None:
    """Board points (n, 3) in metres and their pixels (n, 2) in an image, None without a board.

    image: (H, W, 3) uint8 RGB.
    """
    import cv2

    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if board.marker_m is not None:
        return _charuco_corners(grey, board)
    size = (board.columns, board.rows)
    found, corners = cv2.findChessboardCornersSB(
        grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    )
    if not found:
        return None
    points = np.zeros((board.rows * board.columns, 3), np.float32)
    points[:, :2] = np.mgrid[0 : board.columns, 0 : board.rows].T.reshape(-1, 2) * board.square_m
    return points, np.asarray(corners, np.float32).reshape(-1, 2)


def charuco_of(board: Board) -> Any:
    """OpenCV's board; UserError if it has no such dictionary, or too few markers in it."""
    import cv2

    code = getattr(cv2.aruco, board.dictionary, None)
    if code is None or not board.dictionary.startswith("DICT_"):
        raise UserError(
            f"no marker dictionary '{board.dictionary}'; OpenCV has DICT_4X4_50 to DICT_7X7_1000, "
            "DICT_ARUCO_ORIGINAL and DICT_APRILTAG_36h11"
        )
    markers = cv2.aruco.getPredefinedDictionary(code)
    has, needs = len(markers.bytesList), board.columns * board.rows // 2
    if needs > has:
        raise UserError(
            f"a board of {board.columns}x{board.rows} squares needs {needs} markers and "
            f"{board.dictionary} has {has}; take a larger dictionary or a smaller board"
        )
    return cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_m, float(board.marker_m or 0), markers
    )


def _charuco_corners(grey: NDArray[Any], board: Board) -> tuple[Corners, Corners] | None:
    import cv2

    charuco = charuco_of(board)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco).detectBoard(grey)
    if ids is None or len(ids) < 6:
        return None
    points = np.asarray(charuco.getChessboardCorners(), np.float32)[np.ravel(ids)]
    if min(np.ptp(points[:, 0]), np.ptp(points[:, 1])) == 0:
        return None  # one line of corners does not fix the board's pose
    return points, np.asarray(corners, np.float32).reshape(-1, 2)


def print_lines(options: str) -> tuple[str, str]:
    """What stands below a printed board. options: of the command line for this board."""
    check = f"Print at 100 %: this line must measure {RULER_MM} mm. Then glue it to something flat."
    return check, f"3ds calibrate webcam://0 {options}"


def printable(board: Board, lines: tuple[str, ...]) -> bytes:
    """A PDF of one A4 page, to be printed at 100 %: the board, a ruler of 100 mm, lines of text.

    A square's side is a whole number of the page's dots, so that the board is exact; the ruler is
    so to half a dot, 0.025 mm.

    Raises UserError if the board does not fit.
    """
    from PIL import Image, ImageDraw

    squares = (board.columns, board.rows)
    if board.marker_m is None:
        squares = (board.columns + 1, board.rows + 1)
    page = A4_MM if squares[0] >= squares[1] else A4_MM[::-1]
    room = (page[0] - 2 * _EDGE_MM, page[1] - _EDGE_MM - _FOOT_MM)
    square_mm = board.square_m * 1e3
    if any(n * square_mm > mm + 1e-6 for n, mm in zip(squares, room, strict=True)):
        fits = int(min(mm / n for n, mm in zip(squares, room, strict=True)) * 2) / 2
        raise UserError(
            f"{squares[0]}x{squares[1]} squares of {square_mm:g} mm do not fit on A4, which has "
            f"room for {room[0]:g}x{room[1]:g} mm of them; --square-mm {fits:g} does"
        )
    side = max(1, round(square_mm * _DOTS_PER_MM))
    per_mm = side / square_mm
    drawn = _drawn(board, side)
    sheet = Image.new("1", (round(page[0] * per_mm), round(page[1] * per_mm)), 1)
    top = round(_EDGE_MM * per_mm)
    sheet.paste(Image.fromarray(drawn), ((sheet.width - drawn.shape[1]) // 2, top))
    _foot(ImageDraw.Draw(sheet), lines, page, per_mm)
    out = io.BytesIO()
    # Of one bit per dot Pillow keeps every dot as it is.
    sheet.save(out, "PDF", resolution=25.4 * per_mm, title="doorway3ds calibration board")
    return out.getvalue()


def _drawn(board: Board, side: int) -> NDArray[np.uint8]:
    """The board's squares, `side` dots each, 0 black and 255 white."""
    if board.marker_m is not None:
        size = (board.columns * side, board.rows * side)
        return np.asarray(charuco_of(board).generateImage(size), np.uint8)
    y, x = np.mgrid[: board.rows + 1, : board.columns + 1]
    return np.kron((x + y) % 2 * 255, np.ones((side, side))).astype(np.uint8)


def _foot(draw: ImageDraw, lines: tuple[str, ...], page: tuple[int, int], per_mm: float) -> None:
    """The ruler, from its first tick's left edge to its last one's, and the text below it."""
    from PIL import ImageFont

    left, level = (page[0] - RULER_MM) / 2, page[1] - _RULER_UP_MM
    thick = round(0.2 * per_mm)

    def bar(x_mm: float, y_mm: float, right_mm: float, bottom_mm: float) -> None:
        x, y, right, bottom = (round(v * per_mm) for v in (x_mm, y_mm, right_mm, bottom_mm))
        draw.rectangle((x, y, right + thick - 1, bottom + thick - 1), fill=0)

    bar(left, level, left + RULER_MM, level)
    for mm in range(0, RULER_MM + 1, 10):
        tall = 4.0 if mm % 50 == 0 else 2.0
        bar(left + mm, level, left + mm, level + tall)
    font = ImageFont.load_default(3.2 * per_mm)
    for number, line in enumerate(lines):
        at = (page[0] / 2 * per_mm, (level + 5.5 + 4.5 * number) * per_mm)
        draw.text(at, line, fill=0, font=font, anchor="mt")
