"""Contact sheets: images with truth and answer drawn in, one caption line each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.draw.canvas import AMBER, GREEN, INK, PAPER, VERMILLION
from doorway3ds.draw.text import Color, draw_text, wrap
from doorway3ds.lab.datasets.samples import Sample, bearing_to_column, load_depth, load_frame
from doorway3ds.lab.evaluate.depth import resize_map
from doorway3ds.lab.evaluate.direction import DirectionRecord, Outcome

TILE_WIDTH = 300
TEXT_SIZE = 13.0
CAPTION_LINES = 2
GAP = 8

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Tile:
    """One image of a sheet: (H, W, 3) uint8 RGB and what to write under it."""

    image: Image
    caption: str


def contact_sheet(tiles: Sequence[Tile], columns: int = 4) -> Image:
    """Tiles in rows, each scaled to one width; (H, W, 3) uint8 RGB."""
    if not tiles:
        raise ValueError("a contact sheet needs at least one tile")
    framed = [_framed(tile) for tile in tiles]
    rows = [framed[start : start + columns] for start in range(0, len(framed), columns)]
    columns = min(columns, len(framed))
    heights = [max(tile.shape[0] for tile in row) for row in rows]
    sheet = np.empty(
        (sum(heights) + GAP * (len(rows) + 1), columns * (TILE_WIDTH + GAP) + GAP, 3), np.uint8
    )
    sheet[:] = PAPER
    y = GAP
    for row, height in zip(rows, heights, strict=True):
        for index, tile in enumerate(row):
            x = GAP + index * (TILE_WIDTH + GAP)
            sheet[y : y + tile.shape[0], x : x + TILE_WIDTH] = tile
        y += height + GAP
    return sheet


def direction_tile(sample: Sample, record: DirectionRecord, outcome: Outcome) -> Tile:
    """Marked openings in green, the answer's bearing as an amber or, if wrong, red line."""
    frame = load_frame(sample)
    image, scale = _scaled(frame.image)
    height = image.shape[0]
    for opening in sample.openings:
        left, right = ((x + 0.5) * scale - 0.5 for x in (opening.left_px, opening.right_px))
        band = image[:, max(round(left), 0) : max(round(right) + 1, 1)]
        band[:] = (0.85 * band + 0.15 * np.array(GREEN)).astype(np.uint8)
        for x in (left, right):
            _line(image, x, GREEN, 0, height)
    said = f"{sample.name}: {record.reason}"
    if record.listed:
        bearing = record.listed[0][0]
        column = (bearing_to_column(frame, bearing) + 0.5) * scale - 0.5
        _line(image, column, AMBER if outcome.within == 1 else VERMILLION, 0, height)
        said += f" {bearing:+.1f}°"
    if not math.isnan(outcome.error_deg):
        said += f", off by {abs(outcome.error_deg):.1f}°"
    if not math.isnan(record.p_open):
        said += f", p {record.p_open:.2f}"
    ways = {True: "clear", False: "blocked", None: "unknown"}
    if record.truth.openings:
        way = None if math.isnan(outcome.way_clear) else outcome.way_clear == 1
        said += f"; way {ways[way]}, said {ways[record.clear]}"
    else:
        said += "; no doorway"
    return Tile(image, said)


def depth_tile(sample: Sample, predicted_m: NDArray[np.float32], caption: str) -> Tile:
    """Image, true depth, predicted depth and relative error side by side."""
    truth = load_depth(sample)
    if truth is None:
        raise ValueError(f"{sample.name} has no true depth to draw")
    return depth_panels(load_frame(sample).image, truth, predicted_m, caption)


def depth_panels(
    image: Image, truth: NDArray[np.float32], predicted_m: NDArray[np.float32], caption: str
) -> Tile:
    """The same of an image (H, W, 3) and maps in metres at sizes of their own, nan unknown."""
    predicted = resize_map(predicted_m, *truth.shape)
    limit = float(np.nanquantile(truth, 0.98))
    with np.errstate(invalid="ignore"):
        error = np.abs(predicted - truth) / truth / 0.5  # white from 50 % on
    maps = [truth / limit, predicted / limit]
    panels = [image, *[_painted(m, cv2.COLORMAP_TURBO) for m in maps]]
    panels.append(_painted(error, cv2.COLORMAP_HOT))
    small = [_scaled(panel)[0] for panel in panels]
    height = min(panel.shape[0] for panel in small)
    rows = [np.hstack([p[:height] for p in small[i : i + 2]]) for i in (0, 2)]
    return Tile(np.vstack(rows), caption)


def picture_tile(sample: Sample | Image, caption: str) -> Tile:
    """The image alone, read or at hand."""
    image = load_frame(sample).image if isinstance(sample, Sample) else sample
    return Tile(image, caption)


def _framed(tile: Tile) -> Image:
    image, _ = _scaled(tile.image)
    line = round(TEXT_SIZE * 1.35)
    framed = np.empty((image.shape[0] + CAPTION_LINES * line + 6, TILE_WIDTH, 3), np.uint8)
    framed[:] = PAPER
    framed[: image.shape[0]] = image
    lines = wrap(tile.caption, TEXT_SIZE, TILE_WIDTH, max_lines=CAPTION_LINES)
    for number, text in enumerate(lines, 1):
        draw_text(framed, text, (0, image.shape[0] + number * line), TEXT_SIZE, INK)
    return framed


def _scaled(image: Image) -> tuple[Image, float]:
    """The image at a tile's width, a copy, and the scale."""
    scale = TILE_WIDTH / image.shape[1]
    if scale == 1:
        return image.copy(), 1.0
    size = (TILE_WIDTH, max(1, round(image.shape[0] * scale)))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.array(cv2.resize(image, size, interpolation=method), np.uint8), scale


def _line(image: Image, column: float, color: Color, top: int, bottom: int) -> None:
    x = min(max(round(column), 0), image.shape[1] - 1)
    cv2.line(image, (x, top), (x, bottom), INK, 4, cv2.LINE_AA)
    cv2.line(image, (x, top), (x, bottom), color, 2, cv2.LINE_AA)


def _painted(values: NDArray[Any], colormap: int) -> Image:
    """Values 0..1 in colours, unknown in black."""
    unknown = ~np.isfinite(values)
    grey = (np.clip(np.nan_to_num(values), 0, 1) * 255).astype(np.uint8)
    painted = cv2.applyColorMap(grey, colormap)[:, :, ::-1].copy()
    painted[unknown] = 0
    return np.asarray(painted, np.uint8)
