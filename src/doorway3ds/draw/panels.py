"""Panels beside the photograph: angle dial, depth map with its scale, probability bar, icon.

Each function returns a new (h, w, 3) uint8 RGB image on the paper colour. `unit` is one
design pixel: the whole page is laid out for a width of 1600 of them.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import bearing_of_pixel
from doorway3ds.draw.canvas import (
    AMBER,
    AZURE,
    BLUE,
    GREEN,
    INK,
    MUTED,
    PAPER,
    RULE,
    VERMILLION,
    WHITE,
    View,
    dashes,
    disc,
    fill,
    rounded,
    stroke,
)
from doorway3ds.draw.scene import (
    paint_aim,
    paint_best,
    paint_paper_pixels,
    threshold_row,
    trusted,
)
from doorway3ds.draw.text import CAP_HEIGHT, Anchor, Color, Image, draw_text, text_width
from doorway3ds.types import Decision, Reason

STATUS: dict[Reason, Color] = {
    Reason.TURN: BLUE,
    Reason.ALIGNED: GREEN,
    Reason.BLOCKED: VERMILLION,
    Reason.UNSURE: AMBER,
    Reason.NO_DOOR: MUTED,
    Reason.LOST: (124, 58, 120),
}
_FINE = 3  # shapes are drawn this many times larger, then averaged down
_SEEN: Color = (229, 233, 238)
_AXIS: Color = (160, 167, 176)
_OTHER: Color = (200, 206, 214)
_BEST: Color = (168, 213, 252)
_NICE_METRES = (0.5, 1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 40, 60, 80, 100)


def _fine(width: int, height: int, paint: Callable[[Image], None], ground: Color = PAPER) -> Image:
    canvas = np.full((height * _FINE, width * _FINE, 3), ground, np.uint8)
    paint(canvas)
    small = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def field_of_view(decision: Decision) -> tuple[float, float]:
    """Bearings in degrees of the image's left and right edge at mid-height."""
    camera, pose = decision.frame.camera, decision.frame.pose
    row = (camera.height - 1) / 2
    edges = bearing_of_pixel(camera, pose, [(-0.5, row), (camera.width - 0.5, row)])
    if not np.isfinite(edges).all():
        half = camera.hfov_deg / 2
        return pose.yaw_deg + half, pose.yaw_deg - half
    return float(edges[0]), float(edges[1])


def draw_dial(decision: Decision, width: int, height: int, unit: float) -> Image:
    """The robot from above: what the camera sees, where the openings lie, the turn to make."""
    selection = decision.selection
    seen = field_of_view(decision)
    acting = [
        angle
        for angle in (*seen, decision.turn_deg, selection.bearing_deg)
        if angle is not None and np.isfinite(angle)
    ]
    widest = max(abs(angle) for angle in acting)
    span = next(limit for limit in (50, 70, 90, 180) if widest <= limit - 4 or limit == 180)
    label = 32 * unit  # room for the figures round the arc
    across = np.sin(np.radians(min(span, 90)))
    below = 20 * unit if span <= 90 else label
    radius = min((width / 2 - 1.4 * label) / across, height - label - below)
    if span > 90:
        radius = min(width, height) / 2 - label
    radius = max(radius, 8.0)
    center = ((width - 1) / 2, height - below - (radius if span > 90 else 0))

    def at(angle: float, reach: float) -> tuple[float, float]:
        """Design point of a bearing (+ left) at `reach` times the dial's radius."""
        turn = np.radians(angle)
        return (
            float(center[0] - reach * radius * np.sin(turn)),
            float(center[1] - reach * radius * np.cos(turn)),
        )

    def arc(start: float, stop: float, reach: float) -> list[tuple[float, float]]:
        steps = max(2, int(abs(stop - start) / 1.5) + 1)
        return [at(angle, reach) for angle in np.linspace(start, stop, steps)]

    def scaled(points: list[tuple[float, float]]) -> NDArray[np.float64]:
        return (np.array(points) + 0.5) * _FINE - 0.5

    def thick(units: float) -> int:
        return max(1, round(units * unit * _FINE))

    def paint(canvas: Image) -> None:
        fill(canvas, scaled([center, *arc(seen[0], seen[1], 1)]), _SEEN)
        for opening in selection.openings[1:]:
            fill(canvas, scaled([center, *arc(opening.left_deg, opening.right_deg, 1)]), _OTHER)
        for opening in selection.openings[:1]:
            color, edge = (_BEST, BLUE) if trusted(decision) else (_OTHER, MUTED)
            wedge = arc(opening.left_deg, opening.right_deg, 1)
            fill(canvas, scaled([center, *wedge]), color)
            stroke(canvas, scaled(wedge), edge, thick(6))
            for side, angle in (("left", opening.left_deg), ("right", opening.right_deg)):
                if opening.cut not in (side, "both"):
                    stroke(canvas, scaled([center, at(angle, 1)]), edge, thick(2))
        stroke(canvas, scaled(arc(span, -span, 1)), MUTED, thick(1.5))
        for angle in range(-span, span + 1, 10):
            inner = 0.94 if angle % 30 == 0 else 0.97
            stroke(canvas, scaled([at(angle, inner), at(angle, 1)]), MUTED, thick(1.5))
        stroke(canvas, scaled([at(0, 0), at(0, 1)]), _AXIS, thick(1.5))
        _needle(canvas)
        _robot(canvas)

    def _needle(canvas: Image) -> None:
        bearing = selection.bearing_deg
        if bearing is None or not trusted(decision):
            return
        color = STATUS[decision.reason]
        if decision.turn_deg is None:
            gap = 7 * unit * _FINE
            for piece in dashes(scaled([at(bearing, 0), at(bearing, 0.97)]), gap, gap):
                stroke(canvas, piece, color, thick(4))
            return
        stroke(canvas, scaled([at(bearing, 0), at(bearing, 0.9)]), color, thick(4))
        _head(canvas, at(bearing, 0.97), bearing, 0, color)
        if decision.reason is not Reason.TURN:
            return
        # The bow says how to turn; a small turn gets a bow with a smaller head.
        reach = 0.62
        length = np.radians(abs(decision.turn_deg)) * reach * radius / unit
        if length < 12:
            return
        head = min(18.0, 0.6 * length)
        stop = decision.turn_deg * (1 - 0.8 * head / length)
        stroke(canvas, scaled(arc(0, stop, reach)), INK, thick(min(5, head / 3)))
        side = 90.0 if decision.turn_deg > 0 else -90.0
        _head(canvas, at(decision.turn_deg, reach), decision.turn_deg, side, INK, head)

    def _head(
        canvas: Image,
        tip: tuple[float, float],
        angle: float,
        side: float,
        color: Color,
        length: float = 18.0,
    ) -> None:
        """An arrow head at `tip` that points along `angle`, or `side` degrees left of it."""
        turn = np.radians(angle + side)
        along = np.array([-np.sin(turn), -np.cos(turn)])
        across = np.array([-along[1], along[0]])
        back = np.array(tip) - along * length * unit
        half = across * 0.56 * length * unit
        corners = [tip, tuple(back + half), tuple(back - half)]
        fill(canvas, scaled(corners), color)

    def _robot(canvas: Image) -> None:
        middle = scaled([center])[0]
        size = min(unit, radius / 150) * _FINE

        def body(grow: float, color: Color) -> None:
            left, top = middle[0] - (30 + grow) * size, middle[1] - (13 + grow) * size
            right, bottom = middle[0] + (30 + grow) * size, middle[1] + (15 + grow) * size
            rounded(canvas, (left, top, right, bottom), 14 * size, color)

        body(3, PAPER)
        body(0, INK)
        disc(canvas, (middle[0], middle[1] - 5 * size), 15.5 * size, PAPER)
        disc(canvas, (middle[0], middle[1] - 5 * size), 13 * size, INK)
        disc(canvas, (middle[0], middle[1] - 13 * size), 3.6 * size, WHITE)

    image = _fine(width, height, paint)
    size = 20 * unit
    every = 30 if span <= 90 else 90
    for angle in range(-(span // every) * every, span + 1, every):
        if angle == -180:
            continue
        sign = "+" if 0 < angle < 180 else "−" if angle < 0 else ""
        text = f"{sign}{abs(angle)}°"
        out = np.radians(angle)
        half = text_width(text, size) / 2
        away = 8 * unit + half * abs(np.sin(out)) + CAP_HEIGHT / 2 * size * abs(np.cos(out))
        x, y = at(angle, 1 + away / radius)
        draw_text(image, text, (x, y + CAP_HEIGHT * size / 2), size, MUTED, anchor="center")
    return image


def depth_limit(depth: NDArray[np.float32]) -> float | None:
    """Upper end of the colour scale in metres: a round number over nearly all that is known."""
    known = depth[np.isfinite(depth)]
    if known.size == 0:
        return None
    high = float(np.percentile(known, 98))
    return next((float(nice) for nice in _NICE_METRES if high <= nice), float(_NICE_METRES[-1]))


def depth_colors(depth: NDArray[np.float32], limit: float, width: int, height: int) -> Image:
    """Depth (h, w) in metres as a (height, width) image: dark is near, yellow far, striped
    grey unknown."""
    known = np.isfinite(depth)
    shrink = depth.shape[0] > height and depth.shape[1] > width
    how = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
    weight = cv2.resize(known.astype(np.float32), (width, height), interpolation=how)
    total = cv2.resize(
        np.where(known, depth, 0).astype(np.float32), (width, height), interpolation=how
    )
    metres = total / np.maximum(weight, 1e-6)
    levels = np.clip(metres / limit * 255, 0, 255).astype(np.uint8)
    colors = np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS), np.uint8)[..., ::-1].copy()
    unknown = weight < 0.5
    if unknown.any():
        colors[unknown] = stripes(width, height)[unknown]
    return colors


def stripes(width: int, height: int) -> Image:
    rows, columns = np.mgrid[:height, :width]
    light = ((rows + columns) // 8 % 2 == 0)[..., None]
    return np.where(light, np.uint8(232), np.uint8(218)).repeat(3, axis=2)


def draw_depth(decision: Decision, width: int, height: int, unit: float) -> Image:
    """The depth map with the opening and the aimed pixel; stripes where nothing is known."""
    depth = decision.perception.depth_m
    limit = None if depth is None else depth_limit(depth)
    if depth is None or limit is None:
        image = stripes(width, height)
        size = 22 * unit
        words = "no depth from this network" if depth is None else "depth unknown everywhere"
        draw_text(image, words, (width / 2, height / 2 + size / 3), size, MUTED, anchor="center")
        return image
    image = depth_colors(depth, limit, width, height)
    camera = decision.frame.camera
    view = View(image, (camera.width, camera.height), unit)
    selection = decision.selection
    if not trusted(decision):
        return image
    if selection.openings:
        paint_best(view, selection.openings[0], threshold_row(view, decision), WHITE, shade=False)
    if "max_pixel" in selection.evidence:
        paint_paper_pixels(view, decision, labels=False)
    elif selection.pixel is not None:
        paint_aim(view, selection.pixel, AZURE)
    return image


def draw_scale(limit: float, width: int, unit: float) -> Image:
    """The colour scale in metres under a depth map."""
    bar = round(16 * unit)
    height = round(52 * unit)
    image = np.full((height, width, 3), PAPER, np.uint8)
    ramp = np.linspace(0, 255, width).round().astype(np.uint8)[None]
    colors = np.asarray(cv2.applyColorMap(ramp, cv2.COLORMAP_VIRIDIS), np.uint8)[..., ::-1]
    image[:bar] = colors
    most = min(6.0, width / (56 * unit))  # spaces between figures
    step = next((s for s in (0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50) if limit / s <= most), limit)
    size = 20 * unit
    for value in np.arange(0, limit * 1.001, step):
        x = value / limit * (width - 1)
        stroke(image, [(x, bar), (x, bar + 6 * unit)], MUTED, max(1, round(1.5 * unit)))
        last = value + step > limit * 1.001
        anchor: Anchor = "left" if value == 0 else "right" if value > limit - step / 4 else "center"
        text = f"{value:g} m" if last else f"{value:g}"
        where = (x, bar + 10 * unit + CAP_HEIGHT * size + 2 * unit)
        draw_text(image, text, where, size, MUTED, anchor=anchor)
    return image


def draw_probability(decision: Decision, width: int, height: int, unit: float) -> Image:
    """p_open as a figure and a bar, with the working point at one half."""
    image = np.full((height, width, 3), PAPER, np.uint8)
    color = BLUE if decision.open else MUTED
    base = 38 * unit
    draw_text(image, "Open doorway", (0, base), 22 * unit, MUTED)
    figure = f"{decision.p_open:.2f}" if np.isfinite(decision.p_open) else "unknown"
    draw_text(image, figure, (width - 1, base), 44 * unit, color, "semibold", "right")
    top, bottom = 56 * unit, 74 * unit
    share = float(np.clip(np.nan_to_num(decision.p_open), 0, 1))

    def paint(canvas: Image) -> None:
        big = float(_FINE)
        radius = (bottom - top) / 2 * big
        end = width * big - 1
        rounded(canvas, (0, top * big, end, bottom * big), radius, RULE)
        reach = max(share * end, 2 * radius)
        if share > 0:
            rounded(canvas, (0, top * big, reach, bottom * big), radius, color)
        half = end / 2
        line = max(1, round(2.5 * unit * big))
        stroke(canvas, [(half, top * big), (half, (bottom + 9 * unit) * big)], WHITE, 3 * line)
        stroke(canvas, [(half, top * big), (half, (bottom + 9 * unit) * big)], INK, line)

    bar = _fine(width, height, paint)
    from_row = int(top) - 1
    image[from_row:] = bar[from_row:]
    size = 18 * unit
    where = (width / 2 + 10 * unit, bottom + 6 * unit + CAP_HEIGHT * size)
    draw_text(image, "0.5", where, size, MUTED)
    return image


def draw_icon(decision: Decision, size: int) -> Image:
    """The answer as a sign that reads without colour: arrow, tick, bar, question, cross."""
    reason = decision.reason

    def paint(canvas: Image) -> None:
        side = canvas.shape[0]
        rounded(canvas, (0, 0, side - 1, side - 1), 0.2 * side, STATUS[reason])
        ink = INK if reason is Reason.UNSURE else WHITE
        line = max(1, round(0.1 * side))

        def path(*points: tuple[float, float]) -> None:
            corners = np.array(points) * side - 0.5
            stroke(canvas, corners, ink, line)
            for x, y in corners:
                disc(canvas, (float(x), float(y)), line / 2, ink)

        if reason is Reason.TURN:
            shaft = ((0.74, 0.76), (0.74, 0.40), (0.26, 0.40))
            head = ((0.43, 0.22), (0.25, 0.40), (0.43, 0.58))
            left = (decision.turn_deg or 0) > 0
            for part in (shaft, head):
                path(*((x if left else 1 - x, y) for x, y in part))
        elif reason is Reason.ALIGNED:
            path((0.5, 0.78), (0.5, 0.24))
            path((0.3, 0.43), (0.5, 0.23), (0.7, 0.43))
        elif reason is Reason.BLOCKED:
            path((0.24, 0.5), (0.76, 0.5))
        elif reason is Reason.NO_DOOR:
            path((0.3, 0.3), (0.7, 0.7))
            path((0.7, 0.3), (0.3, 0.7))
        elif reason is Reason.LOST:
            path((0.5, 0.24), (0.5, 0.56))
            path((0.5, 0.77), (0.5, 0.77))

    image = _fine(size, size, paint)
    if reason is Reason.UNSURE:
        em = 0.74 * size
        where = (size / 2, size / 2 + CAP_HEIGHT * em / 2)
        draw_text(image, "?", where, em, INK, "semibold", "center")
    return image
