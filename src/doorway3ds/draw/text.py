"""Anti-aliased text from packaged glyph outlines, with nothing but NumPy and OpenCV.

OpenCV's own fonts differ between its versions and lack the degree sign; outlines give the
same crisp letters at every size on every version. The outlines are those of Inter (SIL Open
Font License, fonts/OFL.txt), written by tools/make_glyphs.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Color = tuple[int, int, int]
Weight = Literal["regular", "semibold"]
Anchor = Literal["left", "center", "right"]

UNITS_PER_EM = 2048
CAP_HEIGHT = 1490 / UNITS_PER_EM  # of the size, from the baseline up
DESCENT = 0.24  # of the size, from the baseline down
_ASCENT = 0.98  # holds accents on capitals
_FINE = 4  # glyphs are filled this many times larger, then averaged down
_SHIFT = 4  # fractional bits of the polygon corners


@dataclass(frozen=True)
class _Face:
    advance: dict[str, float]  # em
    outlines: dict[str, tuple[NDArray[np.float32], ...]]  # em, y down, closed polylines
    kerning: dict[str, float]  # em, by pair of characters


@lru_cache(maxsize=2)
def _face(weight: Weight) -> _Face:
    with (
        files("doorway3ds.draw").joinpath("fonts/inter.npz").open("rb") as file,
        np.load(file, allow_pickle=False) as stored,
    ):
        part = {
            key: stored[f"{weight}_{key}"]
            for key in ("code", "advance", "contours", "lengths", "points", "kerning")
        }
    points = part["points"].astype(np.float32) / UNITS_PER_EM
    points[:, 1] *= -1
    polylines = np.split(points, np.cumsum(part["lengths"])[:-1])
    advance: dict[str, float] = {}
    outlines: dict[str, tuple[NDArray[np.float32], ...]] = {}
    first = 0
    for code, units, count in zip(part["code"], part["advance"], part["contours"], strict=True):
        character = chr(int(code))
        advance[character] = float(units) / UNITS_PER_EM
        outlines[character] = tuple(polylines[first : first + int(count)])
        first += int(count)
    kerning = {
        chr(int(a)) + chr(int(b)): float(units) / UNITS_PER_EM for a, b, units in part["kerning"]
    }
    return _Face(advance, outlines, kerning)


def _places(text: str, weight: Weight) -> tuple[list[tuple[str, float]], float]:
    """Each character with its pen position, and the whole advance; both in em."""
    face = _face(weight)
    x = 0.0
    before = ""
    placed = []
    for raw in text.replace("\u00a0", " "):
        character = raw if raw in face.advance else "?"
        x += face.kerning.get(before + character, 0.0)
        placed.append((character, x))
        x += face.advance[character]
        before = character
    return placed, x


def text_width(text: str, size: float, weight: Weight = "regular") -> float:
    """Advance of one line in pixels."""
    return _places(text, weight)[1] * size


@lru_cache(maxsize=256)
def _coverage(text: str, size: float, weight: Weight) -> NDArray[np.uint8]:
    """(h, w) coverage 0..255; the pen starts one pixel in, the baseline is at row ceil(ascent)."""
    placed, advance = _places(text, weight)
    face = _face(weight)
    width = int(np.ceil(advance * size)) + 3
    height = int(np.ceil(_ASCENT * size)) + int(np.ceil(DESCENT * size)) + 1
    fine = np.zeros((height * _FINE, width * _FINE), np.uint8)
    baseline = np.ceil(_ASCENT * size)
    for character, x in placed:
        # fillPoly paints its outline too, half a fine pixel outwards; corners are given by
        # pixel centres, hence the half to take off.
        corners = [
            ((outline * size + (1 + x * size, baseline)) * _FINE - 0.5)
            for outline in face.outlines[character]
        ]
        if corners:
            polygons = [np.round(points * (1 << _SHIFT)).astype(np.int32) for points in corners]
            cv2.fillPoly(fine, polygons, 255, cv2.LINE_8, _SHIFT)
    small = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)
    small.setflags(write=False)
    return np.asarray(small, np.uint8)


def blend(canvas: Image, coverage: NDArray[Any], origin: tuple[int, int], color: Color) -> None:
    """Paint `color` through `coverage` ((h, w) uint8) with its corner at `origin` (x, y).

    What falls outside the canvas is left out.
    """
    x, y = origin
    height, width = coverage.shape
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, canvas.shape[1]), min(y + height, canvas.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    alpha = coverage[y0 - y : y1 - y, x0 - x : x1 - x, None].astype(np.float32) / 255
    region = canvas[y0:y1, x0:x1]
    region[:] = np.round(region + (np.array(color, np.float32) - region) * alpha).astype(np.uint8)


def draw_text(
    canvas: Image,
    text: str,
    at: tuple[float, float],
    size: float,
    color: Color,
    weight: Weight = "regular",
    anchor: Anchor = "left",
) -> None:
    """Write one line into `canvas`; `at` is the (x, y) of its baseline, `size` the em in pixels."""
    if not text:
        return
    size = round(size * 4) / 4
    shift = {"left": 0.0, "center": 0.5, "right": 1.0}[anchor] * text_width(text, size, weight)
    left = round(at[0] - shift) - 1
    top = round(at[1]) - int(np.ceil(_ASCENT * size))
    blend(canvas, _coverage(text, size, weight), (left, top), color)


def wrap(
    text: str, size: float, width: float, weight: Weight = "regular", max_lines: int = 3
) -> list[str]:
    """Break `text` at spaces into lines of at most `width` pixels; what is left over is cut (…).

    A no-break space keeps a number and its unit together.
    """
    lines: list[str] = []
    current = ""
    for word in _words(text, size, width, weight):
        longer = f"{current} {word}" if current else word
        if current and text_width(longer, size, weight) > width:
            lines.append(current)
            current = word
        else:
            current = longer
    lines.append(current)
    kept = lines[:max_lines]
    if len(lines) > max_lines:
        kept[-1] += "…"
    return [_fitted(line, size, width, weight) for line in kept]


def _words(text: str, size: float, width: float, weight: Weight) -> list[str]:
    """The words of a text; one wider than a line is cut in pieces, best after a - _ / or +."""
    words = []
    for word in text.split(" "):
        rest = word
        while len(rest) > 1 and text_width(rest, size, weight) > width:
            fits = next(
                (n for n in range(len(rest), 0, -1) if text_width(rest[:n], size, weight) <= width),
                1,
            )
            sign = max(rest.rfind(mark, 0, fits) for mark in "-_/+") + 1
            cut = sign if sign > fits // 3 else fits
            words.append(rest[:cut])
            rest = rest[cut:]
        words.append(rest)
    return words


def balanced(
    text: str, size: float, width: float, weight: Weight = "regular", max_lines: int = 3
) -> list[str]:
    """Like `wrap`, with lines of about one length rather than a last one of two words."""
    lines = wrap(text, size, width, weight, max_lines)
    for share in np.arange(0.5, 1.0, 0.05):
        narrow = wrap(text, size, float(share) * width, weight, max_lines + 1)
        if len(narrow) == len(lines):
            return narrow if not narrow[-1].endswith("…") else lines
    return lines


def _fitted(line: str, size: float, width: float, weight: Weight) -> str:
    """The line, shortened with an ellipsis where it is wider than `width` pixels."""
    if text_width(line, size, weight) <= width:
        return line
    kept = line.rstrip("…")
    while kept and text_width(kept + "…", size, weight) > width:
        kept = kept[:-1].rstrip()
    return kept + "…"
