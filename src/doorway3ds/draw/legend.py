"""What the marks on the photograph mean: one small sample and a word for each that is drawn."""

from __future__ import annotations

import cv2
import numpy as np

from doorway3ds.draw.parts import (
    MUTED,
    PAPER,
    View,
    paint_aim,
    paint_best,
    paint_candidate,
    paint_corridor,
    paint_floor,
    paint_obstacle,
    trusted,
)
from doorway3ds.draw.text import CAP_HEIGHT, Image, draw_text, text_width
from doorway3ds.types import Decision, Opening

_GROUND = (150, 150, 146)
_SAMPLE, _ROW, _TEXT = 34, 40, 20


def legend_items(decision: Decision) -> list[tuple[str, str]]:
    """(kind, words) of the marks that `paint_scene` makes for this decision."""
    selection = decision.selection
    items = []
    if selection.openings and trusted(decision):
        items.append(("best", "opening"))
    if selection.openings[1 if trusted(decision) else 0 :]:
        items.append(("candidate", "other candidate, score"))
    if selection.pixel is not None and trusted(decision) and "max_pixel" not in selection.evidence:
        items.append(("aim", "aimed pixel"))
    if len(_points(selection.evidence.get("corridor_px"))) >= 3:
        kind = {True: "free", False: "blocked", None: "unseen"}[selection.clear]
        words = {"free": "way, free", "blocked": "way, blocked", "unseen": "way, not seen"}[kind]
        items.append((kind, words))
    if len(_points(selection.evidence.get("obstacle_px"))):
        items.append(("obstacle", "in the way"))
    if decision.perception.floor is not None:
        items.append(("floor", "floor"))
    return items


def draw_legend(decision: Decision, width: int, unit: float) -> Image | None:
    """The samples with their words in rows of at most `width` pixels; None if nothing is drawn."""
    items = legend_items(decision)
    if not items:
        return None
    size = _TEXT * unit
    placed: list[tuple[str, str, float, int]] = []
    x, row = 0.0, 0
    for kind, words in items:
        wide = (_SAMPLE + 10) * unit + text_width(words, size)
        if x > 0 and x + wide > width:
            x, row = 0.0, row + 1
        placed.append((kind, words, x, row))
        x += wide + 26 * unit
    image = np.full((round((row + 1) * _ROW * unit), width, 3), PAPER, np.uint8)
    for kind, words, x, row in placed:
        top = round(row * _ROW * unit)
        sample = _sample(kind, max(4, round(_SAMPLE * unit)), max(4, round(26 * unit)))
        room = image[top : top + sample.shape[0], round(x) : round(x) + sample.shape[1]]
        room[:] = sample[: room.shape[0], : room.shape[1]]
        where = (x + (_SAMPLE + 10) * unit, top + 13 * unit + CAP_HEIGHT * size / 2)
        draw_text(image, words, where, size, MUTED)
    return image


def _sample(kind: str, width: int, height: int) -> Image:
    """One mark on a piece of grey, drawn three times larger and averaged down."""
    canvas = np.full((3 * height, 3 * width, 3), _GROUND, np.uint8)
    view = View(canvas, (34, 26), 3 * width / 34 * (0.5 if kind == "obstacle" else 0.8))
    opening = Opening(9, 24, 0, 0, 0, None, 0, None)
    way = [(3, 26), (12, 4), (21, 4), (30, 26)]
    if kind == "best":
        paint_best(view, opening, 0.93 * view.height)
    elif kind == "candidate":
        paint_candidate(view, opening)
    elif kind == "aim":
        paint_aim(view, (12, 17))
    elif kind == "floor":
        paint_floor(view, np.ones((2, 2), np.float32))
    elif kind == "obstacle":
        block = np.stack(np.meshgrid(np.arange(9, 25, 0.5), np.arange(7, 19, 0.5)), axis=-1)
        paint_obstacle(view, block.reshape(-1, 2))
    else:
        paint_corridor(view, way, {"free": True, "blocked": False}.get(kind))
    return np.asarray(cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _points(points: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.empty((0, 2)) if points is None else np.asarray(points, np.float64).reshape(-1, 2)
