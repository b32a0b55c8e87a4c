"""A camera from pictures of a chessboard or ChArUco board, with OpenCV's calibration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError

MIN_PICTURES = 3
Corners = NDArray[np.float32]


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
                "a board has at least 3x3 corners (chessboard) or squares (ChArUco) of a positive "
                f"size, got {self.columns}x{self.rows} of {self.square_m * 1e3:g} mm"
            )
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise UserError(
                "a ChArUco marker is smaller than its square, got "
                f"{self.marker_m * 1e3:g} mm in {self.square_m * 1e3:g} mm"
            )


@dataclass(frozen=True)
class Calibration:
    """What `calibrate` found.

    rms_px: reprojection error over all corners. errors_px: the same per used picture, by name.
    without_board: names of the pictures in which no board was found.
    coverage: fraction of the picture's area inside the outline of all corners together.
    """

    camera: Camera
    rms_px: float
    errors_px: dict[str, float]
    without_board: tuple[str, ...]
    coverage: float


def find_corners(image: NDArray[np.uint8], board: Board) -> tuple[Corners, Corners] | None:
    """Board points (n, 3) in metres and their pixels (n, 2) in a picture, None without a board.

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


def _charuco_corners(grey: NDArray[Any], board: Board) -> tuple[Corners, Corners] | None:
    import cv2

    code = getattr(cv2.aruco, board.dictionary, None)
    if code is None or not board.dictionary.startswith("DICT_"):
        raise UserError(
            f"no marker dictionary '{board.dictionary}'; OpenCV has DICT_4X4_50 to DICT_7X7_1000, "
            "DICT_ARUCO_ORIGINAL and DICT_APRILTAG_36h11"
        )
    charuco = cv2.aruco.CharucoBoard(
        (board.columns, board.rows),
        board.square_m,
        float(board.marker_m or 0),
        cv2.aruco.getPredefinedDictionary(code),
    )
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco).detectBoard(grey)
    if ids is None or len(ids) < 6:
        return None
    points = np.asarray(charuco.getChessboardCorners(), np.float32)[np.ravel(ids)]
    if min(np.ptp(points[:, 0]), np.ptp(points[:, 1])) == 0:
        return None  # one line of corners does not fix the board's pose
    return points, np.asarray(corners, np.float32).reshape(-1, 2)


def calibrate(
    pictures: Iterable[tuple[str, NDArray[np.uint8]]], board: Board, name: str
) -> Calibration:
    """The camera that took the pictures (name, RGB image), all of one size.

    Raises UserError where sizes differ, fewer than three pictures show the board, or the result
    is no camera.
    """
    import cv2

    size: tuple[int, int] | None = None
    points: list[Corners] = []
    corners: list[Corners] = []
    used: list[str] = []
    without: list[str] = []
    for picture, image in pictures:
        height, width = image.shape[:2]
        if size is not None and (width, height) != size:
            raise UserError(
                f"{picture} is {width}x{height} and the pictures before it {size[0]}x{size[1]}; "
                "calibrate with pictures of one size"
            )
        size = (width, height)
        found = find_corners(image, board)
        if found is None:
            without.append(picture)
            continue
        points.append(found[0])
        corners.append(found[1])
        used.append(picture)
    if size is None or len(used) < MIN_PICTURES:
        raise UserError(
            f"the board of {board.columns}x{board.rows} was found in {len(used)} of "
            f"{len(used) + len(without)} pictures, at least {MIN_PICTURES} are needed; check "
            "--board (a chessboard counts inner corners, ChArUco counts squares) and the light"
        )
    try:
        rms, matrix, coefficients, turns, moves = cv2.calibrateCamera(
            points, corners, size, np.eye(3), np.zeros(5)
        )
        k1, k2, p1, p2, k3 = (float(v) for v in np.ravel(coefficients)[:5])
        camera = Camera(
            name=name,
            width=size[0],
            height=size[1],
            fx=float(matrix[0, 0]),
            fy=float(matrix[1, 1]),
            cx=float(matrix[0, 2]),
            cy=float(matrix[1, 2]),
            distortion=(k1, k2, p1, p2, k3),
        )
    except (cv2.error, ValueError) as error:
        raise UserError(
            "the pictures do not determine a camera; take more, with the board tilted and near "
            "every corner of the picture"
        ) from error
    errors = {}
    for picture, p, c, turn, move in zip(used, points, corners, turns, moves, strict=True):
        seen, _ = cv2.projectPoints(p, turn, move, matrix, coefficients)
        off = np.asarray(seen).reshape(-1, 2) - c
        errors[picture] = float(np.sqrt(np.mean(np.sum(off * off, axis=1))))
    hull = cv2.convexHull(np.concatenate(corners))
    coverage = float(cv2.contourArea(hull)) / (size[0] * size[1])
    return Calibration(camera, float(rms), errors, tuple(without), coverage)
