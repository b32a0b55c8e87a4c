"""Annotated images: `annotate` composes a page, `overlay` marks the photograph itself."""

from __future__ import annotations

import math

import cv2
import numpy as np

from doorway3ds.arguments import require, require_number
from doorway3ds.draw.canvas import INK, MUTED, PAPER, RULE, WHITE, View, rounded
from doorway3ds.draw.legend import draw_legend
from doorway3ds.draw.panels import (
    STATUS,
    depth_limit,
    draw_depth,
    draw_dial,
    draw_icon,
    draw_probability,
    draw_scale,
)
from doorway3ds.draw.scene import paint_scene, without_faint
from doorway3ds.draw.text import CAP_HEIGHT, DESCENT, Image, balanced, draw_text, text_width, wrap
from doorway3ds.draw.words import Fact, facts, headline, sentence, signed
from doorway3ds.types import Decision, Reason

DESIGN_WIDTH = 1600  # the page's layout is written for this width and scaled to others
_MARGIN, _GAP, _SIDE = 48, 32, 472
_SMALLEST_WIDTH, _LARGEST_WIDTH = 400, 16_000
_TALLEST = 2400  # of all layouts, with every text at its longest
_EXTREME = (0.2, 8.0)  # aspects beyond are drawn squeezed to these


def overlay(decision: Decision, faint: bool = False) -> Image:
    """Draws a decision into its photograph, at the photograph's size, for live use.

    >>> from doorway3ds import Pipeline
    >>> overlay(Pipeline.default()("examples/doorway.jpg")).shape
    (480, 640, 3)

    Args:
        decision: with its frame.
        faint: draw candidates of low score, too.

    Returns:
        A new image (H, W, 3) uint8 RGB with all marks and the answer in words.
    """
    require("decision", decision, Decision, "a Decision")
    decision = decision if faint else without_faint(decision)
    image = np.ascontiguousarray(decision.frame.image).copy()
    height, width = image.shape[:2]
    unit = max(min(width, height) / 480, 0.25)
    view = View(image, (width, height), unit)
    view.taken.append(_answer_box(view, decision)[:4])
    paint_scene(view, decision)
    _answer(view, decision)
    return image


def _answer_box(view: View, decision: Decision) -> tuple[float, float, float, float, float]:
    """Left, top, right, bottom and text size of the overlay's answer, in the lower left corner."""
    size = max(24 * view.unit, 9.0)
    words = headline(decision)
    size *= min(1.0, 0.9 * view.width / (text_width(words, size, "semibold") + 1.2 * size))
    right = text_width(words, size, "semibold") + 1.8 * size
    bottom = view.height - 0.5 * size
    return 0.5 * size, bottom - 1.8 * size, right, bottom, size


def _answer(view: View, decision: Decision) -> None:
    left, top, right, bottom, size = _answer_box(view, decision)
    if size < 6:
        return
    rounded(view.canvas, (left, top, right, bottom), 0.4 * size, STATUS[decision.reason])
    color = INK if decision.reason is Reason.UNSURE else WHITE
    where = ((left + right) / 2, (top + bottom) / 2 + CAP_HEIGHT * size / 2)
    draw_text(view.canvas, headline(decision), where, size, color, "semibold", "center")


def annotate(decision: Decision, width: int = DESIGN_WIDTH, faint: bool = False) -> Image:
    """Draws a page about one decision.

    It holds the answer and its reason in words, the photograph with every mark, the angle
    dial, the depth map with its scale and the facts behind the answer.

    >>> from doorway3ds import Pipeline
    >>> annotate(Pipeline.default()("examples/doorway.jpg"), width=800).shape[1:]
    (800, 3)

    Args:
        decision: with its frame.
        width: of the page in pixels.
        faint: draw candidates of low score, too.

    Returns:
        (H, width, 3) uint8 RGB; H follows the photograph's aspect.

    Raises:
        UserError: for a width too small to read, or too large to draw.
    """
    require("decision", decision, Decision, "a Decision")
    require_number("width", width, _SMALLEST_WIDTH, _LARGEST_WIDTH, whole=True)
    decision = decision if faint else without_faint(decision)
    page = _Page(width)
    top = page.header(decision)
    camera = decision.frame.camera
    aspect = float(np.clip(camera.width / camera.height, *_EXTREME))
    if aspect >= 1.95:
        top = _panorama(page, decision, aspect, top)
    elif aspect >= 0.95:
        top = _landscape(page, decision, aspect, top)
    else:
        top = _portrait(page, decision, aspect, top)
    return page.cropped(top + _MARGIN)


def _landscape(page: _Page, decision: Decision, aspect: float, top: float) -> float:
    """Photograph left, dial over depth right, facts below."""
    wide = DESIGN_WIDTH - 2 * _MARGIN - _GAP - _SIDE
    tall = wide / aspect
    page.photograph(decision, (_MARGIN, top), (wide, tall))
    legend = page.legend(decision, (_MARGIN, top + tall + 16), wide)
    x = _MARGIN + wide + _GAP
    dial = max(tall - _SIDE / aspect - 40 - 62 - _GAP - 48 + 40, 264)
    page.dial(decision, (x, top), (_SIDE, dial))
    bottom = page.depth(decision, (x, top + 48 + dial + _GAP), (_SIDE, _SIDE / aspect))
    return page.facts(facts(decision), max(legend, bottom) + _GAP)


def _panorama(page: _Page, decision: Decision, aspect: float, top: float) -> float:
    """Photograph over the whole width, dial and depth side by side under it."""
    wide = DESIGN_WIDTH - 2 * _MARGIN
    tall = wide / aspect
    page.photograph(decision, (_MARGIN, top), (wide, tall))
    top = page.legend(decision, (_MARGIN, top + tall + 16), wide) + _GAP
    depth_wide = wide - _SIDE - _GAP
    depth_tall = depth_wide / aspect
    dial_tall = max(depth_tall + 60, 260)
    page.dial(decision, (_MARGIN, top), (_SIDE, dial_tall))
    page.depth(decision, (_MARGIN + _SIDE + _GAP, top), (depth_wide, depth_tall))
    return page.facts(facts(decision), top + 48 + dial_tall + _GAP)


def _portrait(page: _Page, decision: Decision, aspect: float, top: float) -> float:
    """Photograph, depth, and a column of dial and first facts side by side; the rest below."""
    inner = DESIGN_WIDTH - 2 * _MARGIN - 2 * _GAP
    share = 0.7  # of the photograph's size, for the depth map
    tall = min((inner - 400) / (1 + share) / aspect, 1080)
    wide = tall * aspect
    page.photograph(decision, (_MARGIN, top), (wide, tall))
    x = _MARGIN + wide + _GAP
    depth_bottom = page.depth(decision, (x, top), (wide * share, tall * share))
    middle = max(wide * share, 220)
    legend = page.legend(decision, (x, depth_bottom + 16), middle)
    x += middle + _GAP
    column = DESIGN_WIDTH - _MARGIN - x
    dial = min(0.7 * column, 330)
    page.dial(decision, (x, top), (column, dial))
    found = facts(decision)
    bottom = page.facts(found[:4], top + 48 + dial + _GAP, x, 1 if column < 560 else 2)
    return page.facts(found[4:], max(top + tall, legend, bottom) + _GAP)


class _Page:
    """A tall sheet of paper; positions and sizes are design pixels, painted at its scale."""

    def __init__(self, width: int) -> None:
        self.scale = width / DESIGN_WIDTH
        self.image = np.full((round(_TALLEST * self.scale), width, 3), PAPER, np.uint8)

    def cropped(self, bottom: float) -> Image:
        return self.image[: math.ceil(bottom * self.scale)].copy()

    def px(self, length: float) -> int:
        return max(1, round(length * self.scale))

    def paste(self, picture: Image, at: tuple[float, float]) -> None:
        x, y = (round(value * self.scale) for value in at)
        height = min(picture.shape[0], self.image.shape[0] - y)
        width = min(picture.shape[1], self.image.shape[1] - x)
        self.image[y : y + height, x : x + width] = picture[:height, :width]

    def text(
        self,
        words: str,
        at: tuple[float, float],
        size: float,
        color: tuple[int, int, int] = INK,
        bold: bool = False,
        right: bool = False,
    ) -> None:
        draw_text(
            self.image,
            words,
            (at[0] * self.scale, at[1] * self.scale),
            size * self.scale,
            color,
            "semibold" if bold else "regular",
            "right" if right else "left",
        )

    def header(self, decision: Decision) -> float:
        """Icon, headline, sentence and probability; returns where the body begins."""
        top = 44.0
        icon = 104
        self.paste(draw_icon(decision, self.px(icon)), (_MARGIN, top))
        x = _MARGIN + icon + 28
        right = DESIGN_WIDTH - _MARGIN - _SIDE
        self.text(headline(decision), (x, top + 48), 60, INK, bold=True)
        lines = balanced(sentence(decision), 27, right - _GAP - x, max_lines=3)
        for index, line in enumerate(lines):
            self.text(line, (x, top + 96 + 36 * index), 27, MUTED)
        bar = draw_probability(decision, self.px(_SIDE), self.px(104), self.scale)
        self.paste(bar, (right, top))
        return top + max(icon, 96 + 36 * (len(lines) - 1) + 10) + 36

    def photograph(
        self, decision: Decision, at: tuple[float, float], size: tuple[float, float]
    ) -> None:
        camera = decision.frame.camera
        width, height = self.px(size[0]), self.px(size[1])
        shrink = width < camera.width and height < camera.height
        how = cv2.INTER_AREA if shrink else cv2.INTER_CUBIC
        resized = cv2.resize(decision.frame.image, (width, height), interpolation=how)
        picture = np.ascontiguousarray(resized, np.uint8)
        unit = self.scale * min(2.0, max(0.9, min(size) / 400))
        paint_scene(View(picture, (camera.width, camera.height), unit), decision)
        cv2.rectangle(picture, (0, 0), (width - 1, height - 1), RULE, 1)
        self.paste(picture, at)

    def legend(self, decision: Decision, at: tuple[float, float], width: float) -> float:
        picture = draw_legend(decision, self.px(width), self.scale)
        if picture is None:
            return at[1]
        self.paste(picture, at)
        return at[1] + float(picture.shape[0]) / self.scale

    def title(self, words: str, value: str, at: tuple[float, float], width: float) -> None:
        self.text(words, (at[0], at[1] + 22), 22, MUTED)
        self.text(value, (at[0] + width, at[1] + 22), 22, INK, bold=True, right=True)

    def dial(self, decision: Decision, at: tuple[float, float], size: tuple[float, float]) -> None:
        turn = decision.turn_deg
        if turn is None:
            value = "no turn"
        elif decision.reason is Reason.ALIGNED:
            value = "no turn needed"
        else:
            value = signed(turn)
        self.title("Direction from above", value, at, size[0])
        picture = draw_dial(decision, self.px(size[0]), self.px(size[1]), self.scale)
        self.paste(picture, (at[0], at[1] + 48))

    def depth(
        self, decision: Decision, at: tuple[float, float], size: tuple[float, float]
    ) -> float:
        """Depth map and scale; returns where they end."""
        depth = decision.perception.depth_m
        limit = None if depth is None else depth_limit(depth)
        self.title("Depth in metres" if limit is not None else "Depth", "", at, size[0])
        picture = draw_depth(decision, self.px(size[0]), self.px(size[1]), self.scale)
        self.paste(picture, (at[0], at[1] + 40))
        bottom = at[1] + 40 + size[1]
        if limit is not None:
            scale = draw_scale(limit, self.px(size[0]), self.scale)
            self.paste(scale, (at[0], bottom + 10))
            bottom += 10 + 52
        return bottom

    def facts(
        self, found: list[Fact], top: float, left: float = _MARGIN, columns: int = 4
    ) -> float:
        """Name over value in columns, under a rule to the margin; returns where they end."""
        right = DESIGN_WIDTH - _MARGIN
        y = round(top * self.scale)
        x0, x1 = round(left * self.scale), round(right * self.scale)
        self.image[y : y + self.px(2), x0:x1] = RULE
        width = (right - left - _GAP * (columns - 1)) / columns
        top += 20
        for first in range(0, len(found), columns):
            row = found[first : first + columns]
            ends = [
                self.fact(fact, (left + index * (width + _GAP), top), width)
                for index, fact in enumerate(row)
            ]
            top = max(ends) + 22
        return top - 22

    def fact(self, fact: Fact, at: tuple[float, float], width: float) -> float:
        x, y = at
        self.text(fact.label, (x, y + 20), 20, MUTED)
        y += 20
        for line in wrap(fact.value, 26, width, "semibold", 2):
            y += 34
            self.text(line, (x, y), 26, INK, bold=True)
        for line in wrap(fact.note, 20, width, max_lines=2) if fact.note else []:
            y += 28
            self.text(line, (x, y), 20, MUTED)
        return y + DESCENT * 22
