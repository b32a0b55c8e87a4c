"""Augmentation that respects geometry: a virtual camera looks into the stored image.

Turning a camera about its centre and changing its focal length are exact for an image: pixels
move by one homography and depth is re-projected on the new optical axis. What a moved camera
would see is not invented.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.train.doornet.data.holes import horizon
from doorway3ds.lab.train.doornet.data.samples import UNKNOWN, Sample
from doorway3ds.lab.train.doornet.model import CANONICAL_F_PX

Array = NDArray[Any]

_HELD_M, _TOP_M = 1.35, 2.2  # height of a camera in the hand; of what lies over the horizon
_WHOLE = 0.7  # share of an image's width that holds an unmarked opening well enough


@dataclass(frozen=True)
class AugmentConfig:
    """Ranges of the virtual camera and of the image's look."""

    whole: float = 0.35  # share of images whose whole field of view is kept
    min_zoom: float = 0.55  # smallest share of the field of view that is cut out
    roll_deg: float = 2.5
    mirror: float = 0.5
    colour: float = 0.8  # share of images whose colours, blur and noise change
    occluder: float = 0.15  # share of images with a box pasted over a part
    low: float = 0.0  # share of landscape photographs that a robot's low camera sees


@dataclass(frozen=True)
class Target:
    """What the losses need for one image; weights are 0 where a label is missing.

    image: (h, w, 3) uint8. columns are strips of 4 input pixels, N = w / 4.
    """

    image: Array
    p_open: float
    p_open_weight: float
    score: Array  # (N,) share of the strip inside an opening
    score_weight: Array  # (N,)
    left: Array  # (N,) distance to the left edge as a fraction of the width
    right: Array  # (N,)
    edge_weight: Array  # (N,)
    clear: Array  # (N,) 1 where the way to the opening in this strip is free
    clear_weight: Array  # (N,)
    depth: Array  # (h/2, w/2) canonical metres, 0 unknown
    depth_weight: float
    segments: Array  # (h/4, w/4) uint8, 255 unknown
    segment_weight: float
    floor: Array  # (h/4, w/4) 1, 0 or 255 unknown


def _rotation(yaw: float, pitch: float, roll: float) -> Array:
    """Old camera to new camera, angles in radians."""
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (np.cos, np.sin))
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_z = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_x @ about_y)


def _matrix(camera: tuple[float, float, float, float]) -> Array:
    fx, fy, cx, cy = camera
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def view(
    sample: Sample,
    size: tuple[int, int],
    rng: np.random.Generator | None,
    config: AugmentConfig = AugmentConfig(),
) -> Target:
    """One training image of `size` (h, w); rng None gives the plain centre view."""
    height, width = size
    if rng is not None and config.low and rng.random() < config.low:
        sample = lowered(sample, rng.uniform(0.3, 0.7))
    rows, columns = sample.image.shape[:2]
    source = _matrix(sample.camera)
    # the largest window of the wanted aspect inside the image
    reach = min(columns / width, rows / height)
    zoom, yaw, pitch, roll, mirror = 1.0, 0.0, 0.0, 0.0, False
    # a window of another aspect leaves room to slide
    slack_x = (columns - reach * width) / 2
    slack_y = (rows - reach * height) / 2
    if rng is not None:
        mirror = rng.random() < config.mirror
        # nobody knows where an unmarked opening is: it must not be cut off
        if rng.random() > config.whole and not _unmarked(sample):
            zoom = rng.uniform(config.min_zoom, 1.0)
            roll = np.radians(np.clip(rng.normal(0, config.roll_deg / 2), -5, 5))
        slack_x += (1 - zoom) * reach * width / 2
        slack_y += (1 - zoom) * reach * height / 2
        yaw = np.arctan(rng.uniform(-slack_x, slack_x) / sample.camera[0])
        pitch = np.arctan(rng.uniform(-slack_y, slack_y) / sample.camera[1])
    focal = sample.camera[0] / (reach * zoom)
    # the stored principal point may lie off the middle: the window must not leave the image
    off_x = (sample.camera[2] - (columns - 1) / 2) / (reach * zoom)
    off_y = (sample.camera[3] - (rows - 1) / 2) / (reach * zoom)
    focal_y = focal * sample.camera[1] / sample.camera[0]
    target = _matrix((focal, focal_y, (width - 1) / 2 + off_x, (height - 1) / 2 + off_y))
    turn = _rotation(yaw, pitch, roll)
    forward = target @ turn @ np.linalg.inv(source)
    if mirror:
        flip = np.array([[-1, 0, width - 1], [0, 1, 0], [0, 0, 1.0]])
        forward = flip @ forward

    def warp(image: Array, scale: int, flags: int, border: int, value: float = 0) -> Array:
        shrink = np.array(
            [[1 / scale, 0, 0.5 / scale - 0.5], [0, 1 / scale, 0.5 / scale - 0.5], [0, 0, 1]]
        )
        return cv2.warpPerspective(
            image,
            shrink @ forward,
            (width // scale, height // scale),
            flags=flags,
            borderMode=border,
            borderValue=value,
        )

    image = warp(sample.image, 1, cv2.INTER_LINEAR, cv2.BORDER_REFLECT_101)
    spans = [_moved(span.left, span.right, forward, rows, height) for span in sample.spans]
    if rng is not None and rng.random() < config.colour:
        image = _look(image, rng)
    labels = _columns(sample, spans, width)
    if _unmarked(sample) and reach * width < _WHOLE * columns:
        labels["p_open_weight"] = 0.0  # what was cut off may be the opening

    depth = np.zeros((height // 2, width // 2), np.float32)
    if sample.depth_m is not None:
        y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
        toward = turn[2] @ np.linalg.inv(source)
        projected = sample.depth_m * (toward[0] * x + toward[1] * y + toward[2])
        projected = np.nan_to_num(projected * (CANONICAL_F_PX / focal)).astype(np.float32)
        depth = warp(projected, 2, cv2.INTER_NEAREST, cv2.BORDER_CONSTANT)
    blank = np.full((height // 4, width // 4), UNKNOWN, np.uint8)
    segments, floor = blank, blank
    if sample.segments is not None:
        segments = warp(sample.segments, 4, cv2.INTER_NEAREST, cv2.BORDER_CONSTANT, UNKNOWN)
        floor = np.where(segments == UNKNOWN, UNKNOWN, segments == 2).astype(np.uint8)
    if "floor" in sample.extra:
        mask = sample.extra["floor"].astype(np.uint8)
        floor = warp(mask, 4, cv2.INTER_NEAREST, cv2.BORDER_CONSTANT, UNKNOWN)
    if rng is not None and rng.random() < config.occluder:
        _occlude(image, depth, segments, floor, rng)
    return Target(
        image=image,
        depth=depth,
        depth_weight=sample.depth_weight,
        segments=segments,
        segment_weight=sample.segment_weight,
        floor=floor,
        **labels,
    )


def lowered(sample: Sample, share: float) -> Sample:
    """A photograph as a camera at `share` of its height would take it, or nearly so.

    Rows move and columns stay. What is on the floor and what is about 2.2 m high comes to lie where
    it would; what is upright between is squeezed below the horizon and stretched above. Portraits
    and rendered images, which have low views of their own, stay as they are.
    """
    rows, columns = sample.image.shape[:2]
    known = sample.depth_m is not None and sample.segments is not None
    if columns < rows or "floor" in sample.extra or not known:
        return sample
    level = horizon(sample)
    if not 0.2 * rows < level < 0.8 * rows:
        return sample
    stretch = (_TOP_M - _HELD_M * share) / (_TOP_M - _HELD_M)
    above, below = level * stretch, (rows - 1 - level) * share
    y = np.arange(int(above + below) + 1, dtype=np.float32) - np.float32(above)
    y = np.float32(level) + np.where(y < 0, y / stretch, y / share).astype(np.float32)
    x, y = np.meshgrid(np.arange(columns, dtype=np.float32), y)

    def moved(array: Array, flags: int) -> Array:
        return np.asarray(cv2.remap(array, x, y, flags, borderMode=cv2.BORDER_REPLICATE))

    fx, fy, cx, _ = sample.camera
    return replace(
        sample,
        image=moved(sample.image, cv2.INTER_LINEAR),
        depth_m=moved(np.asarray(sample.depth_m), cv2.INTER_NEAREST),
        segments=moved(np.asarray(sample.segments), cv2.INTER_NEAREST),
        camera=(fx, fy, cx, (len(y) - 1) / 2),
    )


def _moved(
    left: float, right: float, forward: Array, rows: int, height: int
) -> tuple[float, float]:
    """Columns at the target's mid-height of two upright lines of the source."""
    middle = (rows - 1) / 2
    edges = []
    for column in (left, right):
        ends = forward @ np.array([[column, column], [middle - 50, middle + 50], [1, 1]])
        (x0, x1), (y0, y1) = ends[0] / ends[2], ends[1] / ends[2]
        share = ((height - 1) / 2 - y0) / (y1 - y0)
        edges.append(x0 + share * (x1 - x0))
    return min(edges), max(edges)


def _unmarked(sample: Sample) -> bool:
    """Whether the image shows an opening without telling where."""
    return sample.open == 1 and not sample.spans


def _columns(sample: Sample, spans: list[tuple[float, float]], width: int) -> dict[str, Any]:
    count = width // 4
    centre = (np.arange(count) + 0.5) * 4 - 0.5
    score = np.zeros(count, np.float32)
    left, right, edge, clear, told = (np.zeros(count, np.float32) for _ in range(5))
    weight = np.full(count, sample.weight, np.float32)
    seen = 0.0
    for (start, end), span in zip(spans, sample.spans, strict=True):
        a, b = max(start, -0.5), min(end, width - 0.5)
        if b - a <= 0:
            continue
        share = (b - a) / (end - start)
        strips = np.clip((np.minimum(b, centre + 2) - np.maximum(a, centre - 2)) / 4, 0, 1)
        if b - a < 0.025 * width and share < 0.9:
            weight[strips > 0] = 0  # a sliver at the edge: nobody's fault either way
            continue
        if span.unsure:
            weight[strips > 0] = 0
            continue
        seen = max(seen, share if b - a < 0.08 * width else 1.0)
        if span.loose:
            # box of frame and leaf: its middle is opening, its sides may be leaf
            inner = 0.30 if sample.open is None else 0.15
            margin = inner * (end - start)
            core = (centre > start + margin) & (centre < end - margin)
            weight[(strips > 0) & ~core] = 0
            strips = np.where(core, 1.0, 0.0)
        score = np.maximum(score, strips)
        inside = strips > 0.5
        left[inside] = (centre[inside] - a) / width
        right[inside] = (b - centre[inside]) / width
        loose = 0.0 if sample.open is None else 0.15
        edge[inside] = sample.weight * (loose if span.loose else 1.0) / max(inside.sum(), 1)
        if span.clear is not None:
            clear[inside] = span.clear
            told[inside] = sample.weight / max(inside.sum(), 1)
    np.maximum(left, 0, out=left)
    np.maximum(right, 0, out=right)
    if _unmarked(sample):
        seen, weight = 1.0, np.zeros(count, np.float32)
    certain = sample.open is not None and (sample.open == 0 or seen == 0 or seen > 0.4)
    shows = sample.open == 1 and seen > 0.4
    chance = sample.p_open if sample.p_open is not None and shows == (sample.open == 1) else shows
    return {
        "p_open": float(chance),
        "p_open_weight": sample.weight * certain,
        "score": score,
        "score_weight": weight,
        "left": left,
        "right": right,
        "edge_weight": edge,
        "clear": clear,
        "clear_weight": told,
    }


def _look(image: Array, rng: np.random.Generator) -> Array:
    """Exposure, contrast, white balance, saturation, blur, noise, JPEG: what cameras differ in."""
    x: Array = image.astype(np.float32)
    gain = rng.normal(1.0, 0.08, 3) if rng.random() < 0.6 else np.ones(3)
    x *= (gain * np.exp(rng.normal(0, 0.25))).astype(np.float32)
    if rng.random() < 0.6:
        grey = x.mean(axis=2, keepdims=True)
        x = grey + (x - grey) * np.float32(rng.uniform(0.0 if rng.random() < 0.15 else 0.5, 1.5))
    if rng.random() < 0.5:
        mean = x.mean()
        x = mean + (x - mean) * np.float32(rng.uniform(0.6, 1.4))
    if rng.random() < 0.4:
        x = 255 * (np.clip(x, 0, 255) / 255) ** np.float32(np.exp(rng.normal(0, 0.3)))
    if rng.random() < 0.3:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.3, 1.3))
    if rng.random() < 0.4:
        x += rng.normal(0, rng.uniform(1, 9), (*x.shape[:2], 1 if rng.random() < 0.5 else 3))
    x = np.clip(x, 0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 85))]
        x = np.asarray(cv2.imdecode(cv2.imencode(".jpg", x, quality)[1], cv2.IMREAD_COLOR))
    return np.ascontiguousarray(x)


def _occlude(
    image: Array, depth: Array, segments: Array, floor: Array, rng: np.random.Generator
) -> None:
    """A flat box over a part of the image; depth and segments under it become unknown."""
    height, width = image.shape[:2]
    h, w = rng.integers(height // 8, height // 3), rng.integers(width // 10, width // 4)
    y, x = rng.integers(0, height - h), rng.integers(0, width - w)
    patch = rng.integers(0, 256, 3) + rng.normal(0, 12, (h, w, 1))
    image[y : y + h, x : x + w] = np.clip(patch, 0, 255).astype(np.uint8)
    depth[y // 2 : (y + h) // 2 + 1, x // 2 : (x + w) // 2 + 1] = 0
    for mask in (segments, floor):
        mask[y // 4 : (y + h) // 4 + 1, x // 4 : (x + w) // 4 + 1] = UNKNOWN
