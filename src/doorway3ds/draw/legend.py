"""What the marks on the photograph mean: one small sample and a word for each that is drawn."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.draw.canvas import MUTED, PAPER, View
from doorway3ds.draw.scene import (
    evidence_points,
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
    aimed = trusted(decision)
    items = []
    if selection.openings and aimed:
        items.append(("best", "opening"))
    if selection.openings[1 if aimed else 0 :]:
        items.append(("candidate", "candidate, score"))
    if aimed and selection.pixel is not None and "max_pixel" not in selection.evidence:
        items.append(("aim", "aimed pixel"))
    if aimed and _in_picture(decision, evidence_points(decision, "corridor_px")):
        kind = {True: "free", False: "blocked", None: "unseen"}[selection.clear]
        words = {"free": "way, free", "blocked": "way, blocked", "unseen": "way, not seen"}[kind]
        items.append((kind, words))
    if aimed and len(evidence_points(decision, "obstacle_px")):
        items.append(("obstacle", "in the way"))
    floor = decision.perception.floor
    if floor is not None and np.nanmax(floor, initial=0) > 0.5:
        items.append(("floor", "floor"))
    return items


def _in_picture(decision: Decision, outline: NDArray[np.float64]) -> bool:
    """Whether the box round an outline in image points reaches into the image."""
    if len(outline) < 3:
        return False
    low, high = np.nanmin(outline, axis=0), np.nanmax(outline, axis=0)
    camera = decision.frame.camera
    return bool((high > -0.5).all() and (low < [camera.width - 0.5, camera.height - 0.5]).all())


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
        x += wide + 24 * unit
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
