"""Marks on the photograph: floor, swept corridor, obstacle, openings and aimed pixels.

Everything here paints into a `View`. Every meaning has a second sign (dashes, hatching, shape)
besides its colour.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from doorway3ds.draw.canvas import (
    AMBER,
    AZURE,
    FLOOR,
    GREEN,
    INK,
    SHIFT,
    VERMILLION,
    WHITE,
    View,
    cased,
    dashed,
    disc,
    fill,
    fixed,
    stroke,
    tag,
    tint,
)
from doorway3ds.draw.text import Color
from doorway3ds.draw.words import signed
from doorway3ds.types import Decision, Opening, Reason

FAINT = 0.1  # score below which a candidate is noise to a person who looks


def paint_floor(view: View, floor: NDArray[Any]) -> None:
    """Tint what the network takes for floor; `floor` (h, w) probability over the whole image."""
    grey = np.nan_to_num(np.clip(floor, 0, 1) * 255).astype(np.uint8)
    if min(grey.shape) > 8:
        grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), np.uint8)
    large = cv2.resize(grey, (view.width, view.height), interpolation=cv2.INTER_LINEAR)
    mask = cv2.threshold(large, 127, 255, cv2.THRESH_BINARY)[1]
    tint(view, np.asarray(mask, np.uint8), FLOOR, 0.22)


def paint_corridor(view: View, corridor: ArrayLike, clear: bool | None) -> None:
    """The robot's footprint swept over the floor: solid if free, hatched if not, else dashed."""
    points = view.points(corridor)
    if len(points) < 3:
        return
    mask = np.zeros((view.height, view.width), np.uint8)
    cv2.fillPoly(mask, [fixed(points)], 255, cv2.LINE_8, SHIFT)
    outline = np.concatenate([points, points[:1]])
    if clear is None:
        # Corners near the canvas, so that dashing a far-away one cannot take forever.
        margin = 50.0
        near = np.clip(outline, [-margin] * 2, [view.width + margin, view.height + margin])
        dashed(view, near, WHITE, 1.4)
        return
    color = GREEN if clear else VERMILLION
    tint(view, mask, color, 0.42 if clear else 0.26)
    if not clear:
        _hatch(view, mask, color)
    stroke(view.canvas, outline, WHITE, view.thick(1.6) + 2 * view.thick(0.6))
    stroke(view.canvas, outline, color, view.thick(1.6))


def _hatch(view: View, mask: NDArray[np.uint8], color: Color) -> None:
    x, y, width, height = cv2.boundingRect(mask)
    lines = np.zeros((view.height, view.width), np.uint8)
    step = max(4, round(9 * view.unit))
    starts = range(x - height, x + width, step)
    slanted = [[(start, y + height), (start + height, y)] for start in starts]
    cv2.polylines(lines, [np.array(line) for line in slanted], False, 255, view.thick(1.4))
    tint(view, np.asarray(cv2.bitwise_and(lines, mask), np.uint8), color, 0.75)


def paint_obstacle(view: View, obstacle: ArrayLike) -> None:
    """Mark the image points (n, 2) that stand in the way, as one outlined patch."""
    points = view.points(obstacle)
    if len(points) == 0:
        return
    cell = max(2, round(5 * view.unit))
    grid = patch(points, cell, (view.height // cell + 2, view.width // cell + 2))
    large = cv2.resize(grid, (grid.shape[1] * cell, grid.shape[0] * cell))
    mask = np.asarray(
        cv2.threshold(large, 110, 255, cv2.THRESH_BINARY)[1][: view.height, : view.width], np.uint8
    )
    tint(view, mask, VERMILLION, 0.5)
    edges, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(
        view.canvas, edges, -1, WHITE, view.thick(1.6) + 2 * view.thick(0.6), cv2.LINE_AA
    )
    cv2.drawContours(view.canvas, edges, -1, VERMILLION, view.thick(1.6), cv2.LINE_AA)


def patch(points: NDArray[np.float64], cell: float, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Points (n, 2) on a grid of cells, 255 where they stand and between those close together."""
    grid = np.zeros(shape, np.uint8)
    columns, rows = np.clip(
        np.round(points.T / cell).astype(int), 0, [[shape[1] - 1], [shape[0] - 1]]
    )
    grid[rows, columns] = 255
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    return np.asarray(cv2.morphologyEx(grid, cv2.MORPH_CLOSE, kernel), np.uint8)


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


def without_faint(decision: Decision) -> Decision:
    """`decision` without the candidates that score below FAINT, but for the one aimed at."""
    kept = tuple(
        opening
        for index, opening in enumerate(decision.selection.openings)
        if opening.score >= FAINT or (index == 0 and trusted(decision))
    )
    return replace(decision, selection=replace(decision.selection, openings=kept))


def trusted(decision: Decision) -> bool:
    """Whether the best opening counts as a doorway seen now, to be drawn as the aim."""
    return decision.open and decision.reason is not Reason.LOST


def threshold_row(view: View, decision: Decision) -> float:
    """Canvas row where the best opening meets the floor: the corridor's far end, or a guess."""
    lowest = 0.88 * view.height
    points = view.points(evidence_points(decision, "corridor_px"))
    if len(points) < 3:
        return lowest
    return float(np.clip(points[:, 1].min(), 0.6 * view.height, 0.94 * view.height))


def evidence_points(decision: Decision, key: str) -> NDArray[np.float64]:
    points = decision.selection.evidence.get(key)
    if points is None or len(points) == 0:
        return np.empty((0, 2))
    return np.asarray(points, dtype=np.float64).reshape(-1, 2)


def paint_best(
    view: View, opening: Opening, bottom: float, color: Color = AZURE, shade: bool = True
) -> None:
    """Two jambs; a side cut by the image's edge has none: rails and arrows lead out of it."""
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
    """A further candidate: thin dashed jambs under a lintel, none on a side that the edge cuts."""
    top, bottom = 0.22 * view.height, 0.78 * view.height
    left, right = view.x(opening.left_px), view.x(opening.right_px)
    outline = [(left, top), (right, top)]
    if opening.cut not in ("left", "both"):
        outline.insert(0, (left, bottom))
    if opening.cut not in ("right", "both"):
        outline.append((right, bottom))
    dashed(view, outline, WHITE, 1.4)


def paint_aim(view: View, pixel: tuple[int, int], color: Color = AZURE) -> None:
    """A ring with a dot at the aimed (row, column)."""
    _ring(view, (view.x(pixel[1]), view.y(pixel[0])), color)


def _ring(view: View, at: tuple[float, float], color: Color) -> None:
    for radius, ring in ((9.5, INK), (8.5, WHITE), (5.8, INK), (5.0, color)):
        disc(view.canvas, at, radius * view.unit, ring)


def paper_points(decision: Decision) -> dict[str, tuple[float, float]]:
    """The published method's three pixels, which lie on a 240x320 map, as points of the image."""
    camera, evidence = decision.frame.camera, decision.selection.evidence
    pixels = {name: evidence.get(f"{name}_pixel") for name in ("max", "best", "trigger")}
    return {
        name: ((p[1] + 0.5) * camera.width / 320 - 0.5, (p[0] + 0.5) * camera.height / 240 - 0.5)
        for name, p in pixels.items()
        if p is not None
    }


def paint_paper_pixels(view: View, decision: Decision, labels: bool = True) -> None:
    """The published method's Max-, Best- and Trigger-Pixel and the ways walked between them."""
    marks = {name: (view.x(x), view.y(y)) for name, (x, y) in paper_points(decision).items()}
    if "max" in marks and "best" in marks:
        cased(view, [[marks["max"], marks["best"]]], WHITE, 1.4)
    if "best" in marks and "trigger" in marks:
        way = [marks["best"], marks["trigger"]]
        if decision.selection.clear is False:
            dashed(view, way, VERMILLION, 3)
        else:
            cased(view, [way], GREEN, 3)
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
        _ring(view, marks["best"], AZURE)
    for x, y in marks.values():
        s = 9.5 * view.unit
        view.taken.append((x - s, y - s, x + s, y + s))
    if labels:
        # Outside of the way between Max and Best, so that its line stays in sight.
        leftward = marks.get("max", (0.0, 0.0))[0] < marks.get("best", (0.0, 0.0))[0]
        for name, at in marks.items():
            beside = (-14 if leftward == (name == "max") else 14) * view.unit
            if name == "trigger":
                beside = 14 * view.unit
            tag(view, name.capitalize(), at, INK, WHITE, 13, beside)


def paint_scene(view: View, decision: Decision, labels: bool = True) -> None:
    """All marks of one decision on the photograph, from the ground up."""
    selection = decision.selection
    if decision.perception.floor is not None:
        paint_floor(view, decision.perception.floor)
    if trusted(decision):
        paint_corridor(view, evidence_points(decision, "corridor_px"), selection.clear)
        paint_obstacle(view, evidence_points(decision, "obstacle_px"))
    paint_openings(view, decision, labels)
    if not trusted(decision):
        return
    if "max_pixel" in selection.evidence:
        paint_paper_pixels(view, decision, labels)
    elif selection.pixel is not None:
        paint_aim(view, selection.pixel)
