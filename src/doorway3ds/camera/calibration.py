"""A camera from images of a chessboard or ChArUco board, with OpenCV's calibration."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.board import Board, BoardView, find_corners
from doorway3ds.camera.lens import MODELS
from doorway3ds.camera.model import Camera, pixel_to_ray, ray_to_pixel
from doorway3ds.errors import UserError

MIN_PICTURES = 3
GOOD_RMS_PX = 0.5  # per 640 columns; above it something moved, blurred or was not flat
GOOD_COVERAGE = 0.5
_FOLDS = 4
_BY_SIMPLICITY = ("plumb_bob", "equidistant", "rational_polynomial")
_AS_GOOD, _SAME_PX = 1.1, 0.02  # of the best model's held-out error, or this far from it


@dataclass(frozen=True)
class Calibration:
    """What `calibrate` found.

    rms_px: reprojection error over all corners. errors_px: the same per used image, by name.
    without_board: names of the images in which no board was found.
    coverage: fraction of the image's area inside the outline of all corners together.
    held_out_px: by distortion model, the error in views that it was not fitted to; empty if the
        model was given.
    """

    camera: Camera
    rms_px: float
    errors_px: dict[str, float]
    without_board: tuple[str, ...]
    coverage: float
    held_out_px: dict[str, float]

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why not to rely on it, a line each."""
        doubts = []
        if self.rms_px > GOOD_RMS_PX * max(1.0, self.camera.width / 640):
            doubts.append(
                "the error is large; leave out the worst images and keep the board flat and still"
            )
        if self.coverage < GOOD_COVERAGE:
            doubts.append(
                f"the board covers {self.coverage:.0%} of the image over all images; "
                "show it near the corners too, where lenses distort most"
            )
        return tuple(doubts)


def calibrate(
    pictures: Iterable[tuple[str, NDArray[np.uint8]]],
    board: Board,
    name: str,
    model: str | None = None,
) -> Calibration:
    """The camera that took the images (name, RGB image as the sensor delivered it), of one size.

    model: one of `camera.lens.MODELS`; None: the simplest that predicts views that it was not
        fitted to about as well as the best, and that can be undone over the whole image.

    Raises UserError if sizes differ, fewer than three images show the board, or the result is no
    camera.
    """
    size: tuple[int, int] | None = None
    views: list[BoardView] = []
    without: list[str] = []
    for picture, image in pictures:
        height, width = image.shape[:2]
        if size is not None and (width, height) != size:
            raise UserError(
                f"{picture} is {width}x{height} and the images before it {size[0]}x{size[1]}; "
                "calibrate with images of one size"
            )
        size = (width, height)
        found = find_corners(image, board)
        if found is None:
            without.append(picture)
        else:
            views.append(BoardView(picture, *found))
    if size is None or len(views) < MIN_PICTURES:
        raise UserError(
            f"the board of {board.columns}x{board.rows} was found in {len(views)} of "
            f"{len(views) + len(without)} images, at least {MIN_PICTURES} are needed; check "
            "--board (a chessboard counts inner corners, ChArUco counts squares) and the light"
        )
    return calibrate_views(views, size, name, model, tuple(without))


def calibrate_views(
    views: Sequence[BoardView],
    size: tuple[int, int],
    name: str,
    model: str | None = None,
    without: tuple[str, ...] = (),
    go_on: Callable[[], object] = lambda: None,
) -> Calibration:
    """`calibrate` for boards already found in images of `size` (width, height), and `without`.

    go_on: called before each of the fits, some seconds in all; what it raises ends the calibration.
    """
    import cv2

    fits: dict[str, Camera] = {}
    for candidate in (model,) if model else _BY_SIMPLICITY:
        go_on()
        camera = _fit(views, size, candidate, name)
        if camera is not None:
            fits[candidate] = camera
    if not fits:
        raise UserError(
            "the images do not determine a camera; take more, with the board tilted and near "
            "every corner of the image"
        )
    scores = {} if model else {kind: _held_out_error(views, size, kind, go_on) for kind in fits}
    camera = fits[_choose(fits, scores)]
    errors = {view.name: _error(camera, view) for view in views}
    corners = [view.corners for view in views]
    counts = [len(c) for c in corners]
    rms = math.sqrt(np.average(np.square(list(errors.values())), weights=counts))
    hull = cv2.convexHull(np.concatenate(corners))
    coverage = float(cv2.contourArea(hull)) / (size[0] * size[1])
    return Calibration(camera, rms, errors, without, coverage, scores)


def _fit(views: Sequence[BoardView], size: tuple[int, int], model: str, name: str) -> Camera | None:
    """The camera of these views by OpenCV; None if they do not determine one."""
    import cv2

    points = [view.points for view in views]
    corners = [view.corners for view in views]
    try:
        if model == "equidistant":
            _, matrix, found, _, _ = cv2.fisheye.calibrate(
                [p.reshape(1, -1, 3).astype(np.float64) for p in points],
                [c.reshape(1, -1, 2).astype(np.float64) for c in corners],
                size,
                np.eye(3),
                np.zeros(4),
                flags=cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW,
                criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9),
            )
        else:
            flags = cv2.CALIB_RATIONAL_MODEL if model == "rational_polynomial" else 0
            _, matrix, found, _, _ = cv2.calibrateCamera(
                points, corners, size, np.eye(3), np.zeros(5), flags=flags
            )
        return Camera(
            name=name,
            width=size[0],
            height=size[1],
            fx=float(matrix[0, 0]),
            fy=float(matrix[1, 1]),
            cx=float(matrix[0, 2]),
            cy=float(matrix[1, 2]),
            distortion=tuple(float(v) for v in np.ravel(found)[: MODELS[model]]),
            distortion_model=model,
        )
    except (cv2.error, ValueError):
        return None


def _error(camera: Camera, view: BoardView) -> float:
    """RMS distance in pixels between a view's corners and where the camera expects them."""
    import cv2

    rays = pixel_to_ray(camera, view.corners)
    found, turn, move = cv2.solvePnP(view.points, rays[:, None, :2], np.eye(3), np.zeros(4))
    if not found:
        return math.inf
    seen = view.points @ cv2.Rodrigues(turn)[0].T + move.ravel()
    off = ray_to_pixel(camera, seen) - view.corners
    return float(np.sqrt(np.mean(np.sum(off * off, axis=1))))


def _held_out_error(
    views: Sequence[BoardView], size: tuple[int, int], model: str, go_on: Callable[[], object]
) -> float:
    """RMS over all views of the error in each by a camera fitted to others; inf if there is none.

    With fewer views than leave three to fit to, the error of the fit itself.
    """
    folds = min(_FOLDS, len(views))
    if len(views) - math.ceil(len(views) / folds) < MIN_PICTURES:
        camera = _fit(views, size, model, model)
        return math.inf if camera is None else _rms([_error(camera, view) for view in views])
    errors: list[float] = []
    for fold in range(folds):
        go_on()
        camera = _fit([v for i, v in enumerate(views) if i % folds != fold], size, model, model)
        held_out = views[fold::folds]
        errors += [math.inf if camera is None else _error(camera, view) for view in held_out]
    return _rms(errors)


def _rms(errors: Sequence[float]) -> float:
    return math.sqrt(sum(e * e for e in errors) / len(errors))


def _choose(fits: Mapping[str, Camera], scores: Mapping[str, float]) -> str:
    """The model to keep: one that can be undone everywhere if any can, simple before exact."""
    whole = [model for model in fits if fits[model].untrusted == 0]
    able = whole or [min(fits, key=lambda model: fits[model].untrusted)]
    best = min(scores.get(model, 0.0) for model in able)
    return next(m for m in able if scores.get(m, 0.0) <= max(_AS_GOOD * best, best + _SAME_PX))
