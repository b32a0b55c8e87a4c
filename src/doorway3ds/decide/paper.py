"""Pixel-Selection and Pixel2Angle as published, to the digit.

Othman & Rad, "A Doorway Detection and Direction (3Ds) System for Social Robots via a Monocular
Camera", Sensors 2020, 20(9), 2477. Where its text and its tables disagree, the tables win: the
search starts at row 120, the scan down runs in the Best-Pixel's column and ends at row 238, and
the angle is not rounded to 0.19 deg a pixel. Its weaknesses are kept.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from doorway3ds.errors import UserError
from doorway3ds.types import Frame, Opening, Perception, Selection

ROWS, COLUMNS = 240, 320
UNIT_M = 10.0
"""Depth 1.0 on the paper's map, in metres."""

FIRST_ROW = 120  # of the search for the Max-Pixel
LAST_ROW = 238  # of the scan for the Trigger-Pixel
FREE_BELOW_ROW = 200
SAME_DEPTH = 0.01  # neighbours along the row differ by less
SAME_FLOOR = 0.045  # neighbours down the column differ by less


@dataclass(frozen=True)
class PixelSelection:
    """Pixels as (row, column) on the 240x320 map, depths in units of 10 m.

    free: the scan down from the Max-Pixel's row ends below row 200.
    """

    max_pixel: tuple[int, int]
    best_pixel: tuple[int, int]
    trigger_pixel: tuple[int, int]
    free: bool
    max_depth: float
    best_depth: float


def _walk(line: NDArray[np.float64], start: int, tolerance: float) -> int:
    """Steps from `start` to the end of `line` whose neighbours differ by less than `tolerance`."""
    far = np.flatnonzero(~(np.abs(np.diff(line[start:])) < tolerance))
    return int(far[0]) if far.size else line.size - 1 - start


def _run(line: NDArray[np.float64], column: int) -> tuple[int, int]:
    """First and last column around `column` whose neighbours lie equally deep."""
    right = column + _walk(line, column, SAME_DEPTH)
    return column - _walk(line[::-1], COLUMNS - 1 - column, SAME_DEPTH), right


def select_pixels(depth: ArrayLike) -> PixelSelection:
    """Max-, Best- and Trigger-Pixel of a (240, 320) map in units of 10 m; nan is never deep.

    Raises ValueError for another shape or where no depth is known in the lower half.
    """
    depth = np.asarray(depth, dtype=np.float64)
    if depth.shape != (ROWS, COLUMNS):
        raise ValueError(
            f"the paper's map is {ROWS}x{COLUMNS}, got shape {depth.shape}; see resample()"
        )
    lower = np.where(np.isfinite(depth[FIRST_ROW:]), depth[FIRST_ROW:], -np.inf)
    row, column = (int(i) for i in np.unravel_index(np.argmax(lower), lower.shape))
    row += FIRST_ROW
    if not np.isfinite(depth[row, column]):
        raise ValueError(f"no depth is known from row {FIRST_ROW} on; the paper's map needs some")
    left, right = _run(depth[row], column)
    best = (left + right) // 2
    trigger = row
    if row < LAST_ROW:
        trigger += _walk(depth[: LAST_ROW + 1, best], row, SAME_FLOOR)
    return PixelSelection(
        max_pixel=(row, column),
        best_pixel=(row, best),
        trigger_pixel=(trigger, best),
        free=trigger > FREE_BELOW_ROW,
        max_depth=float(depth[row, column]),
        best_depth=float(depth[row, best]),
    )


def pixel_to_angle(pixel: float, size: int = COLUMNS, fov_deg: float = 60.9) -> float:
    """The published linear angle of a column in degrees, + left; rows with size=240, fov 47.6."""
    return (size / 2 - pixel) * fov_deg / size


def _axis(size: int, source: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    position = np.clip((np.arange(size) + 0.5) * source / size - 0.5, 0, source - 1)
    low = np.floor(position).astype(np.intp)
    return low, np.minimum(low + 1, source - 1), position - low


def resample(depth_m: ArrayLike) -> NDArray[np.float64]:
    """(h, w) metres as the paper's (240, 320) map: bilinear by pixel centres, clipped to 0.1..10 m.

    Unknown depth (nan) counts as nothing beside known neighbours and stays nan without any.
    """
    depth = np.asarray(depth_m, dtype=np.float64)
    if depth.shape != (ROWS, COLUMNS):
        known = np.isfinite(depth)
        top, bottom, v = _axis(ROWS, depth.shape[0])
        left, right, u = _axis(COLUMNS, depth.shape[1])

        def blend(values: NDArray[np.float64]) -> NDArray[np.float64]:
            rows = values[top] * (1 - v)[:, None] + values[bottom] * v[:, None]
            return np.asarray(rows[:, left] * (1 - u) + rows[:, right] * u)

        weight = blend(known.astype(np.float64))
        total = blend(np.where(known, depth, 0.0))
        depth = np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), np.nan)
    return np.clip(depth, 0.1, UNIT_M) / UNIT_M


def select_paper(perception: Perception, frame: Frame) -> Selection:
    """The paper's selection: the Best-Pixel's linear angle and the state of the path below it.

    What it lists as an opening is the run of equal depth whose middle is the Best-Pixel. The
    range is sqrt(X^2 + Z^2) with X = Z tan(theta), a pinhole formula on a linear angle, as
    published. Raises UserError if the perception has no depth.
    """
    if perception.depth_m is None:
        raise UserError(
            f"the paper method needs depth and network '{perception.network}' returns none; "
            "name a depth network after a +, as in cnn-srin+densedepth"
        )
    depth = resample(perception.depth_m)
    try:
        found = select_pixels(depth)
    except ValueError:
        return Selection(None, None, None, None, unsure="no depth is known in the lower half")
    row, column = found.best_pixel
    camera = frame.camera
    bearing = pixel_to_angle(column, COLUMNS, camera.hfov_deg)
    range_m = found.best_depth * UNIT_M / math.cos(math.radians(bearing))
    left, right = _run(depth[row], found.max_pixel[1])
    edges = (left - 0.5, right + 0.5)
    left_px, right_px = ((edge + 0.5) * camera.width / COLUMNS - 0.5 for edge in edges)
    left_deg, right_deg = (pixel_to_angle(edge, COLUMNS, camera.hfov_deg) for edge in edges)
    cut = {(1, 0): "left", (0, 1): "right", (1, 1): "both"}.get(
        (int(left == 0), int(right == COLUMNS - 1))
    )
    run = Opening(left_px, right_px, left_deg, right_deg, bearing, range_m, perception.p_open, cut)
    pixel = (
        round((row + 0.5) * camera.height / ROWS - 0.5),
        round((column + 0.5) * camera.width / COLUMNS - 0.5),
    )
    return Selection(
        bearing_deg=bearing,
        range_m=range_m,
        pixel=pixel,
        clear=found.free,
        openings=(run,),
        evidence=asdict(found),
    )
