"""Palette and primitives: a view of the photograph, cased lines, dashes, round boxes, labels.

Colours follow Okabe and Ito's palette, which stays apart for colour-blind eyes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from doorway3ds.draw.text import (
    CAP_HEIGHT,
    DESCENT,
    Color,
    Image,
    Weight,
    draw_text,
    text_width,
)

INK: Color = (27, 32, 41)
MUTED: Color = (88, 96, 108)
RULE: Color = (217, 220, 225)
PAPER: Color = (247, 247, 245)
WHITE: Color = (255, 255, 255)
BLUE: Color = (0, 114, 178)
AZURE: Color = (24, 152, 255)  # the best opening, on photographs
GREEN: Color = (0, 158, 115)
VERMILLION: Color = (213, 94, 0)
AMBER: Color = (230, 159, 0)
FLOOR: Color = (86, 205, 233)

SHIFT = 4
_FAR = 1e6  # corners beyond this many pixels are pulled in, so that fixed point can hold them

Box = tuple[float, float, float, float]  # left, top, right, bottom


@dataclass
class View:
    """The photograph on its way to being marked.

    canvas: (h, w, 3) uint8 RGB, painted in place.
    size: (width, height) of the image whose coordinates are drawn.
    unit: thickness of a thin line in canvas pixels; all else is a multiple of it.
    taken: where labels already stand.
    """

    canvas: Image
    size: tuple[int, int]
    unit: float
    taken: list[Box] = field(default_factory=list)

    @property
    def width(self) -> int:
        return int(self.canvas.shape[1])

    @property
    def height(self) -> int:
        return int(self.canvas.shape[0])

    def x(self, column: float) -> float:
        return (column + 0.5) * self.width / self.size[0] - 0.5

    def y(self, row: float) -> float:
        return (row + 0.5) * self.height / self.size[1] - 0.5

    def points(self, xy: ArrayLike) -> NDArray[np.float64]:
        """(n, 2) canvas points of image points (n, 2); those that are not finite are left out."""
        array: NDArray[np.float64] = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        array = array[np.isfinite(array).all(axis=1)]
        scale = np.array([self.width / self.size[0], self.height / self.size[1]])
        return np.asarray(np.clip((array + 0.5) * scale - 0.5, -_FAR, _FAR), np.float64)

    def thick(self, units: float) -> int:
        return max(1, round(units * self.unit))


def fixed(points: ArrayLike) -> NDArray[np.int32]:
    """Canvas points as OpenCV's fixed-point corners."""
    return np.round(np.asarray(points, dtype=np.float64) * (1 << SHIFT)).astype(np.int32)


def stroke(canvas: Image, points: ArrayLike, color: Color, thickness: int) -> None:
    strokes(canvas, [points], color, thickness)


def strokes(canvas: Image, lines: Sequence[ArrayLike], color: Color, thickness: int) -> None:
    """Open lines of (n, 2) canvas points each."""
    corners = [fixed(line) for line in lines]
    cv2.polylines(canvas, corners, False, color, thickness, cv2.LINE_AA, SHIFT)


def fill(canvas: Image, points: ArrayLike, color: Color) -> None:
    cv2.fillPoly(canvas, [fixed(points)], color, cv2.LINE_AA, SHIFT)


def disc(canvas: Image, at: tuple[float, float], radius: float, color: Color) -> None:
    x, y = fixed(at).tolist()
    cv2.circle(canvas, (x, y), round(radius * (1 << SHIFT)), color, -1, cv2.LINE_AA, SHIFT)


def dashes(points: ArrayLike, on: float, off: float) -> Iterable[NDArray[np.float64]]:
    """Cut a polyline into pieces `on` long with gaps of `off`."""
    corners = np.asarray(points, dtype=np.float64)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    for start in np.arange(0, lengths[-1], on + off):
        stop = min(start + on, lengths[-1])
        inner = lengths[(lengths > start) & (lengths < stop)]
        at = np.concatenate([[start], inner, [stop]])
        yield np.stack([np.interp(at, lengths, corners[:, axis]) for axis in (0, 1)], axis=1)


def cased(view: View, lines: Sequence[ArrayLike], color: Color, units: float) -> None:
    """Open lines that stand out on dark and on bright ground: a dark edge around the colour."""
    strokes(view.canvas, lines, INK, view.thick(units) + 2 * view.thick(0.6))
    strokes(view.canvas, lines, color, view.thick(units))


def dashed(view: View, line: ArrayLike, color: Color, units: float) -> None:
    """A cased line in dashes; the gaps allow for the round ends, which thickness sets."""
    thickness = view.thick(units) + 2 * view.thick(0.6)
    cased(view, list(dashes(line, 7 * view.unit, 6 * view.unit + thickness)), color, units)


def tint(view: View, mask: NDArray[np.uint8], color: Color, alpha: float) -> None:
    """Mix `color` into the canvas where `mask` (canvas-sized, 0..255) is set."""
    x, y, width, height = cv2.boundingRect(mask)
    if width == 0 or height == 0:
        return
    region = view.canvas[y : y + height, x : x + width]
    solid = np.full_like(region, color)
    mixed = cv2.addWeighted(region, 1 - alpha, solid, alpha, 0)
    cv2.copyTo(mixed, mask[y : y + height, x : x + width], region)


def tag(
    view: View,
    text: str,
    at: tuple[float, float],
    fill_color: Color,
    text_color: Color,
    units: float,
    beside: float = 0.0,
) -> None:
    """A small label at, or `beside` pixels from, a canvas point, where nothing is covered yet.

    beside: right of the point first, or left of it where negative; 0 is on it.
    Left out where the canvas is too small to hold it.
    """
    size = units * view.unit
    weight: Weight = "semibold"
    pad = 0.45 * size
    width = text_width(text, size, weight) + 2 * pad
    height = (CAP_HEIGHT + DESCENT) * size + 1.2 * pad
    if width > view.width or height > 0.2 * view.height or size < 7:
        return
    x, y = at
    half_w, half_h = width / 2, height / 2
    rim = 4 * view.unit
    if beside:
        aside, over = beside + np.copysign(half_w, beside), abs(beside) + half_h
        offsets = [
            (aside, 0.0),
            (-aside, 0.0),
            (0.0, -over),
            (0.0, over),
            (aside, -over),
            (-aside, -over),
        ]
    else:
        offsets = [(0.0, step * (height + 2 * view.unit)) for step in (0, 1, 2, 3, 4)]
    boxes = []
    for dx, dy in offsets:
        cx = min(max(x + dx, half_w + rim), view.width - half_w - rim)
        cy = min(max(y + dy, half_h + rim), view.height - half_h - rim)
        boxes.append((cx - half_w, cy - half_h, cx + half_w, cy + half_h))
    box = min(boxes, key=lambda b: sum(_overlap(b, other) for other in view.taken))
    view.taken.append(box)
    rounded(view.canvas, box, 0.3 * height, fill_color)
    baseline = (box[1] + box[3]) / 2 + CAP_HEIGHT * size / 2
    draw_text(
        view.canvas, text, ((box[0] + box[2]) / 2, baseline), size, text_color, weight, "center"
    )


def _overlap(a: Box, b: Box) -> float:
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return max(width, 0.0) * max(height, 0.0)


def rounded(canvas: Image, box: Box, radius: float, color: Color) -> None:
    """A filled rectangle with round corners."""
    left, top, right, bottom = box
    radius = min(radius, (right - left) / 2, (bottom - top) / 2)
    angles = np.linspace(0, np.pi / 2, 9)
    corners = []
    for cx, cy, turn in (
        (right - radius, bottom - radius, 0),
        (left + radius, bottom - radius, 1),
        (left + radius, top + radius, 2),
        (right - radius, top + radius, 3),
    ):
        a = angles + turn * np.pi / 2
        corners.append(np.stack([cx + radius * np.cos(a), cy + radius * np.sin(a)], axis=1))
    fill(canvas, np.concatenate(corners), color)
