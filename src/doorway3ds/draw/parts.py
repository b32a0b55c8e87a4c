"""Marks on the photograph: floor, swept corridor, obstacle, openings and aimed pixels.

Everything here paints into a `View`: the photograph at any size, with the picture's own
coordinates mapped by pixel centres. Colours follow Okabe and Ito's palette, which stays apart
for colour-blind eyes; every meaning has a second sign (dashes, hatching, shape) besides colour.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from doorway3ds.draw.text import (
    CAP_HEIGHT,
    DESCENT,
    Color,
    Image,
    Weight,
    blend,
    draw_text,
    text_width,
)
from doorway3ds.draw.words import signed
from doorway3ds.types import Decision, Opening, Reason

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

_SHIFT = 4
_FAR = 1e6  # corners beyond this many pixels are pulled in, so that fixed point can hold them

Box = tuple[float, float, float, float]  # left, top, right, bottom


@dataclass
class View:
    """The photograph on its way to being marked.

    canvas: (h, w, 3) uint8 RGB, painted in place.
    size: (width, height) of the picture whose coordinates are drawn.
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
        """(n, 2) canvas points of picture points (n, 2); those that are not finite are left out."""
        array = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        array = array[np.isfinite(array).all(axis=1)]
        scale = np.array([self.width / self.size[0], self.height / self.size[1]])
        return np.clip((array + 0.5) * scale - 0.5, -_FAR, _FAR)

    def thick(self, units: float) -> int:
        return max(1, round(units * self.unit))


def fixed(points: ArrayLike) -> NDArray[np.int32]:
    """Canvas points as OpenCV's fixed-point corners."""
    return np.round(np.asarray(points, dtype=np.float64) * (1 << _SHIFT)).astype(np.int32)


def stroke(
    canvas: Image, points: ArrayLike, color: Color, thickness: int, closed: bool = False
) -> None:
    cv2.polylines(canvas, [fixed(points)], closed, color, thickness, cv2.LINE_AA, _SHIFT)


def strokes(canvas: Image, lines: Sequence[ArrayLike], color: Color, thickness: int) -> None:
    cv2.polylines(
        canvas, [fixed(line) for line in lines], False, color, thickness, cv2.LINE_AA, _SHIFT
    )


def fill(canvas: Image, points: ArrayLike, color: Color) -> None:
    cv2.fillPoly(canvas, [fixed(points)], color, cv2.LINE_AA, _SHIFT)


def disc(canvas: Image, at: tuple[float, float], radius: float, color: Color) -> None:
    x, y = fixed(at).tolist()
    cv2.circle(canvas, (x, y), round(radius * (1 << _SHIFT)), color, -1, cv2.LINE_AA, _SHIFT)


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


def _tint(view: View, mask: NDArray[np.uint8], color: Color, alpha: float) -> None:
    """Mix `color` into the canvas where `mask` (canvas-sized, 0..255) is set."""
    x, y, width, height = cv2.boundingRect(mask)
    if width == 0 or height == 0:
        return
    region = view.canvas[y : y + height, x : x + width]
    solid = np.full_like(region, color)
    mixed = cv2.addWeighted(region, 1 - alpha, solid, alpha, 0)
    cv2.copyTo(mixed, mask[y : y + height, x : x + width], region)


def paint_floor(view: View, floor: NDArray[Any]) -> None:
    """Tint what the network takes for floor; `floor` (h, w) probability over the whole picture."""
    grey = np.nan_to_num(np.clip(floor, 0, 1) * 255).astype(np.uint8)
    if min(grey.shape) > 8:
        grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), np.uint8)
    large = cv2.resize(grey, (view.width, view.height), interpolation=cv2.INTER_LINEAR)
    mask = cv2.threshold(large, 127, 255, cv2.THRESH_BINARY)[1]
    _tint(view, np.asarray(mask, np.uint8), FLOOR, 0.22)


def paint_corridor(view: View, corridor: ArrayLike, clear: bool | None) -> None:
    """The robot's footprint swept over the floor: solid if free, hatched if not, else dashed."""
    points = view.points(corridor)
    if len(points) < 3:
        return
    mask = np.zeros((view.height, view.width), np.uint8)
    cv2.fillPoly(mask, [fixed(points)], 255, cv2.LINE_8, _SHIFT)
    outline = np.concatenate([points, points[:1]])
    if clear is None:
        cased(view, list(dashes(_inside(outline, view), 9 * view.unit, 7 * view.unit)), WHITE, 1.4)
        return
    color = GREEN if clear else VERMILLION
    _tint(view, mask, color, 0.42 if clear else 0.26)
    if not clear:
        _hatch(view, mask, color)
    stroke(view.canvas, outline, WHITE, view.thick(1.6) + 2 * view.thick(0.6))
    stroke(view.canvas, outline, color, view.thick(1.6))


def _inside(points: NDArray[np.float64], view: View) -> NDArray[np.float64]:
    """Keep corners near the canvas, so that dashing a far-away corner cannot take forever."""
    margin = 50.0
    return np.clip(points, [-margin] * 2, [view.width + margin, view.height + margin])


def _hatch(view: View, mask: NDArray[np.uint8], color: Color) -> None:
    x, y, width, height = cv2.boundingRect(mask)
    lines = np.zeros((view.height, view.width), np.uint8)
    step = max(4, round(9 * view.unit))
    starts = range(x - height, x + width, step)
    slanted = [[(start, y + height), (start + height, y)] for start in starts]
    cv2.polylines(lines, [np.array(line) for line in slanted], False, 255, view.thick(1.4))
    _tint(view, np.asarray(cv2.bitwise_and(lines, mask), np.uint8), color, 0.75)


def paint_obstacle(view: View, obstacle: ArrayLike) -> None:
    """Mark the picture points (n, 2) that stand in the way, as one outlined patch."""
    points = view.points(obstacle)
    if len(points) == 0:
        return
    cell = max(2, round(5 * view.unit))
    grid = np.zeros((view.height // cell + 2, view.width // cell + 2), np.uint8)
    columns = np.clip(np.round(points[:, 0] / cell).astype(int), 0, grid.shape[1] - 1)
    rows = np.clip(np.round(points[:, 1] / cell).astype(int), 0, grid.shape[0] - 1)
    grid[rows, columns] = 255
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    grid = np.asarray(cv2.morphologyEx(grid, cv2.MORPH_CLOSE, kernel), np.uint8)
    large = cv2.resize(grid, (grid.shape[1] * cell, grid.shape[0] * cell))
    mask = np.asarray(
        cv2.threshold(large, 110, 255, cv2.THRESH_BINARY)[1][: view.height, : view.width], np.uint8
    )
    _tint(view, mask, VERMILLION, 0.5)
    edges, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(
        view.canvas, edges, -1, WHITE, view.thick(1.6) + 2 * view.thick(0.6), cv2.LINE_AA
    )
    cv2.drawContours(view.canvas, edges, -1, VERMILLION, view.thick(1.6), cv2.LINE_AA)


def paint_openings(view: View, decision: Decision, labels: bool = True) -> None:
    """Candidates, the best one last and strong if the door counts as open at all."""
    openings = decision.selection.openings
    for opening in reversed(openings[1:]):
        paint_candidate(view, opening)
    if openings and trusted(decision):
        paint_best(view, openings[0], threshold_row(view, decision))
    elif openings:
        paint_candidate(view, openings[0])
    if not labels:
        return
    for index, opening in enumerate(openings):
        middle = (max(view.x(opening.left_px), 0) + min(view.x(opening.right_px), view.width)) / 2
        if index == 0 and trusted(decision):
            parts = [signed(opening.bearing_deg)]
            if opening.range_m is not None:
                parts.append(f"{opening.range_m:.1f} m")
            tag(view, " · ".join(parts), (middle, 0.07 * view.height), AZURE, INK, 15)
        else:
            tag(view, f"{opening.score:.2f}", (middle, 0.22 * view.height), INK, WHITE, 13)


def trusted(decision: Decision) -> bool:
    """Whether the best opening counts as a doorway seen now, to be drawn as the aim."""
    return decision.open and decision.reason is not Reason.LOST


def threshold_row(view: View, decision: Decision) -> float:
    """Canvas row where the best opening meets the floor: the corridor's far end, or a guess."""
    lowest = 0.88 * view.height
    points = view.points(_evidence_points(decision, "corridor_px"))
    if len(points) < 3:
        return lowest
    return float(np.clip(points[:, 1].min(), 0.6 * view.height, 0.94 * view.height))


def _evidence_points(decision: Decision, key: str) -> NDArray[np.float64]:
    points = decision.selection.evidence.get(key)
    if points is None or len(points) == 0:
        return np.empty((0, 2))
    return np.asarray(points, dtype=np.float64).reshape(-1, 2)


def paint_best(
    view: View, opening: Opening, bottom: float, color: Color = AZURE, shade: bool = True
) -> None:
    """Two jambs; a side cut by the picture's edge has none: rails and arrows lead out of it."""
    left, right = view.x(opening.left_px), view.x(opening.right_px)
    top = 0.07 * view.height
    if shade:
        _shade(view, left, right, top, bottom)
    reach = min(14 * view.unit, 0.3 * (right - left))
    cut_left, cut_right = opening.cut in ("left", "both"), opening.cut in ("right", "both")
    start, stop = -1.0 if cut_left else left, float(view.width) if cut_right else right
    lines: list[ArrayLike] = []
    if not (cut_left or cut_right):
        for x, inward in ((left, reach), (right, -reach)):
            lines.append([(x + inward, top), (x, top), (x, bottom), (x + inward, bottom)])
    elif cut_left and cut_right:
        lines += [[(start, y), (stop, y)] for y in (top, bottom)]
    else:
        jamb, edge = (right, start) if cut_left else (left, stop)
        lines.append([(edge, top), (jamb, top), (jamb, bottom), (edge, bottom)])
    middle = (top + bottom) / 2
    if cut_left:
        lines += _chevrons(5 * view.unit, middle, -1, view)
    if cut_right:
        lines += _chevrons(view.width - 5 * view.unit, middle, 1, view)
    cased(view, lines, color, 2.6)


def _chevrons(x: float, y: float, direction: int, view: View) -> list[ArrayLike]:
    size = 7 * view.unit
    found: list[ArrayLike] = []
    for tip in (x, x - direction * 8 * view.unit):
        back = tip - direction * size
        found.append([(back, y - 1.5 * size), (tip, y), (back, y + 1.5 * size)])
    return found


def _shade(view: View, left: float, right: float, top: float, bottom: float) -> None:
    x0, x1 = max(round(left), 0), min(round(right), view.width)
    y0, y1 = max(round(top), 0), min(round(bottom), view.height)
    if x0 >= x1 or y0 >= y1:
        return
    region = view.canvas[y0:y1, x0:x1]
    region[:] = cv2.addWeighted(region, 0.84, np.full_like(region, AZURE), 0.16, 0)


def paint_candidate(view: View, opening: Opening) -> None:
    """A further candidate: thin dashed jambs, none on a side that the edge cuts."""
    top, bottom = 0.22 * view.height, 0.78 * view.height
    for side, column in (("left", opening.left_px), ("right", opening.right_px)):
        if opening.cut in (side, "both"):
            continue
        x = view.x(column)
        pieces = list(dashes([(x, top), (x, bottom)], 8 * view.unit, 6 * view.unit))
        cased(view, pieces, WHITE, 1.4)


def paint_aim(view: View, pixel: tuple[int, int], color: Color = AZURE) -> None:
    """A ring with a dot at the aimed (row, column)."""
    at = (view.x(pixel[1]), view.y(pixel[0]))
    for radius, ring in ((9.5, INK), (8.5, WHITE), (5.8, INK), (5.0, color)):
        disc(view.canvas, at, radius * view.unit, ring)


def paint_paper_pixels(view: View, decision: Decision, labels: bool = True) -> None:
    """The published method's Max-, Best- and Trigger-Pixel and the ways walked between them."""
    evidence = decision.selection.evidence
    marks: dict[str, tuple[float, float]] = {}
    for name in ("max", "best", "trigger"):
        pixel = evidence.get(f"{name}_pixel")
        if pixel is not None:
            row, column = pixel
            marks[name] = (
                view.x((column + 0.5) * view.size[0] / 320 - 0.5),
                view.y((row + 0.5) * view.size[1] / 240 - 0.5),
            )
    if "max" in marks and "best" in marks:
        cased(view, [[marks["max"], marks["best"]]], WHITE, 1.4)
    if "best" in marks and "trigger" in marks:
        free = decision.selection.clear
        way: list[ArrayLike] = [[marks["best"], marks["trigger"]]]
        if free is False:
            way = list(dashes(way[0], 7 * view.unit, 5 * view.unit))
        cased(view, way, VERMILLION if free is False else GREEN, 3)
    size = 7 * view.unit
    if "trigger" in marks:
        x, y = marks["trigger"]
        for grow, color in ((1.45, INK), (1.2, WHITE), (0.8, VERMILLION)):
            s, tip = size * grow, y + (grow - 1) * size
            if color == VERMILLION and decision.selection.clear is not False:
                color = GREEN
            fill(view.canvas, [(x - s, tip - 1.7 * s), (x + s, tip - 1.7 * s), (x, tip)], color)
    if "max" in marks:
        x, y = marks["max"]
        for grow, color in ((1.45, INK), (1.2, WHITE), (0.75, AMBER)):
            s = size * grow
            fill(view.canvas, [(x - s, y), (x, y - s), (x + s, y), (x, y + s)], color)
    if "best" in marks:
        x, y = marks["best"]
        for radius, color in ((9.5, INK), (8.5, WHITE), (5.8, INK), (5.0, AZURE)):
            disc(view.canvas, (x, y), radius * view.unit, color)
    for name, (x, y) in marks.items():
        s = 9.5 * view.unit
        view.taken.append((x - s, y - s, x + s, y + s))
    if labels:
        for name, at in marks.items():
            tag(view, name.capitalize(), at, INK, WHITE, 13, beside=14 * view.unit)


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
        offsets = [
            (beside + half_w, 0.0),
            (-beside - half_w, 0.0),
            (0.0, -beside - half_h),
            (0.0, beside + half_h),
            (beside + half_w, -beside - half_h),
            (-beside - half_w, -beside - half_h),
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


def paint_scene(view: View, decision: Decision, labels: bool = True) -> None:
    """All marks of one decision on the photograph, from the ground up."""
    selection = decision.selection
    if decision.perception.floor is not None:
        paint_floor(view, decision.perception.floor)
    paint_corridor(view, _evidence_points(decision, "corridor_px"), selection.clear)
    paint_obstacle(view, _evidence_points(decision, "obstacle_px"))
    paint_openings(view, decision, labels)
    if "best_pixel" in selection.evidence or "max_pixel" in selection.evidence:
        paint_paper_pixels(view, decision, labels)
    elif selection.pixel is not None and trusted(decision):
        paint_aim(view, selection.pixel)
