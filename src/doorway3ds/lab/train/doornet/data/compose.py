"""Doorways, and what resembles them, built into walls of photographed rooms.

Rooms with a marked doorway are few. A wall takes a hole of true perspective, and another
photographed room, moved behind it along its line of sight, is seen through: cut and paste
(Dwibedi et al., ICCV 2017) with depth deciding what hides what. So that the seams teach nothing,
as many holes hold a closed door, a window, a picture or a mirror.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.train.doornet.data.holes import (
    DOOR,
    OTHER,
    WINDOW,
    Hole,
    Size,
    classes_of,
    column_at,
    cut,
    depth_of,
    filled,
    free_edges,
    horizon,
    rays_of,
    sill_seen,
    way_to,
)
from doorway3ds.lab.train.doornet.data.samples import Sample, Span

Array = NDArray[Any]

_TRIES = 40  # for one image
_HIDDEN = 0.4  # share of a hole behind furniture, at most
_TELLING = 15.0  # grey levels by which what is seen through a hole must vary
# furniture stands along most photographed walls, and before few doorways: what is kept, by the way
_KEPT = {1: 1.0, None: 0.5, 0: 0.3}


@dataclass(frozen=True)
class ComposeConfig:
    """How many, and how wide.

    count: images to build. opens: share of them with a doorway; of the others the share
    `closed` holds a closed door, the rest a window, a picture or a mirror. width_m, height_m:
    of doorways. passages: share of the doorways, and of what is no door, that are passage_m wide.
    """

    count: int = 0
    opens: float = 0.5
    closed: float = 0.5
    width_m: tuple[float, float] = (0.65, 1.3)
    height_m: tuple[float, float] = (1.9, 2.3)
    passages: float = 0.0
    passage_m: tuple[float, float] = (1.3, 2.6)


def compose(samples: Sequence[Sample], config: ComposeConfig, seed: int = 1) -> list[Sample]:
    """Built images of the source "composed", the same for the same seed.

    samples: rooms with measured depth and classes to build into and to see through to, and
    photographs with `extra["leaf"]`, the box of a closed door. All that is built comes from
    them. Fewer than config.count where too few walls can take a hole.
    """
    builder = _Builder(samples, config)
    rng = np.random.default_rng(seed)
    found: list[Sample] = []
    # a bare wall takes every hole, and must not be most of what is learnt from
    used: Counter[int] = Counter()
    most = 1 + 3 * config.count // max(len(builder.hosts), 1)
    for _ in range(_TRIES * config.count if builder.hosts else 0):
        if len(found) == config.count:
            break
        number = int(rng.integers(len(builder.hosts)))
        if used[number] >= most:
            continue
        # one kind after the other, so that what fits seldom does not come seldom
        kind = "open" if len(found) < config.opens * config.count else builder.other(rng)
        made = builder.build(builder.hosts[number], kind, rng)
        if made is not None:
            used[number] += 1
            found.append(made)
    return found


@dataclass
class _Inside:
    """What a hole shows: (H, W, 3) float32 image, (H, W) metres (nan unknown), classes."""

    image: Array
    depth: Array
    classes: Array


class _Builder:
    def __init__(self, samples: Sequence[Sample], config: ComposeConfig) -> None:
        self._config = config
        # rendered homes have walls enough and doorways of their own
        self._rooms = [
            s
            for s in samples
            if s.depth_m is not None
            and s.segments is not None
            and s.depth_weight == 1
            and "floor" not in s.extra
        ]
        self.hosts = [s for s in self._rooms if s.open == 0]
        self._leaves = [s for s in samples if "leaf" in s.extra]
        self._horizons: dict[int, float] = {}

    def other(self, rng: np.random.Generator) -> str:
        """Something that is no doorway."""
        if self._leaves and rng.random() < self._config.closed:
            return "closed"
        return str(rng.choice(["window", "picture", "mirror"]))

    def build(self, host: Sample, kind: str, rng: np.random.Generator) -> Sample | None:
        """`host` with a hole of that kind in one of its walls; None where none fits."""
        hole = cut(host, self._size(kind, rng), rng)
        if hole is None:
            return None
        depth, shape = depth_of(host), host.image.shape[:2]
        wall = hole.wall.depth(rays_of(host))
        whole = filled(hole.front, shape)
        free = depth > 0.94 * wall  # everything nearer stands before the wall
        region = whole & free
        flat = region & (np.abs(depth / wall - 1) < 0.08)
        if whole.sum() < 150 or region.sum() < (1 - _HIDDEN) * whole.sum():
            return None
        if flat.sum() < 0.5 * whole.sum() or (kind != "open" and not sill_seen(hole, region)):
            return None
        image: Array = host.image.astype(np.float32)
        colour = _frame_colour(image[region], rng)
        if kind != "closed" and rng.random() < 0.8:
            frame = (filled(hole.casing, shape, smooth=True) * free)[..., None]
            image = image * (1 - frame) + (colour + rng.normal(0, 3, (*shape, 1))) * frame
        spans: tuple[Span, ...] = ()
        if kind == "closed":
            inside = self._closed(hole, image, wall, region, rng)
        elif kind in ("picture", "mirror"):
            inside = self._flat(host, hole, kind, wall, rng)
        else:
            found = self._behind(host, wall, region, rng)
            if found is None:
                return None
            found.image *= _light(kind, rng)
            deep = filled(hole.back, shape, smooth=True)[..., None]
            found.image = found.image * deep + colour * rng.uniform(0.55, 1.0) * (1 - deep)
            inside = found
            if kind == "window":
                inside.classes[:], inside.depth[:] = WINDOW, np.nan
            else:
                span = self._opening(host, hole, inside, rng)
                if span is None:
                    return None
                spans = (span,)
        alpha = filled(hole.front, shape, smooth=True) * free
        alpha = cv2.GaussianBlur(alpha, (0, 0), rng.uniform(0.4, 0.9))[..., None]
        image = image * (1 - alpha) + inside.image * alpha
        return replace(
            host,
            name=f"{host.name}+{kind}",
            source="composed",
            image=np.clip(image, 0, 255).astype(np.uint8),
            depth_m=np.where(region, inside.depth, np.asarray(host.depth_m)).astype(np.float32),
            segments=np.where(region, inside.classes, classes_of(host)),
            open=int(kind == "open"),
            spans=spans,
            weight=0.8,
        )

    def _size(self, kind: str, rng: np.random.Generator) -> Size:
        config = self._config
        # a hole as wide as a passage must not tell that it is one
        passage = config.passages and kind != "closed" and rng.random() < config.passages
        if kind in ("open", "closed"):
            wide = rng.uniform(*(config.passage_m if passage else config.width_m))
            return Size(wide, 0.0, rng.uniform(*config.height_m))
        sill = rng.uniform(0.65, 1.3) if kind != "mirror" else rng.uniform(0.05, 1.1)
        wide = rng.uniform(*(config.passage_m if passage else (0.4, 1.5)))
        return Size(wide, sill, sill + rng.uniform(0.5, 1.4))

    def _behind(
        self, host: Sample, wall: Array, region: Array, rng: np.random.Generator
    ) -> _Inside | None:
        """Another room, moved away until it lies behind the wall."""
        rows, columns = np.nonzero(region)
        low, high = columns.min(), columns.max()
        nearest = wall[region]
        for _ in range(4):
            guest = self._rooms[rng.integers(len(self._rooms))]
            flip = rng.random() < 0.5
            for scale in (1.0, 0.75, 0.55, 0.42):
                slack = round(guest.image.shape[1] * scale) - (high - low + 1)
                # the horizons meet, so that both rooms have one floor
                down = self._horizon(host) - self._horizon(guest) * scale
                covered = (rows >= down) & (rows < down + len(guest.image) * scale)
                if guest.place == host.place or slack < 0 or covered.mean() < 0.8:
                    break
                shift = (float(low - rng.integers(slack + 1)), down)
                far = _placed(depth_of(guest), region.shape, scale, shift, flip) / scale
                if (far[region] > 1.03 * nearest).mean() < 0.88:
                    continue
                image = _placed(guest.image, region.shape, scale, shift, flip).astype(np.float32)
                # a bare wall behind a doorway looks like a closed door
                if np.median(far[region] - nearest) > 0.5 and image[region].std() > _TELLING:
                    return _Inside(
                        image,
                        np.where(far > 1.03 * wall, far, np.nan),
                        _placed(classes_of(guest), region.shape, scale, shift, flip),
                    )
        return None

    def _horizon(self, sample: Sample) -> float:
        if id(sample) not in self._horizons:
            self._horizons[id(sample)] = horizon(sample)
        return self._horizons[id(sample)]

    def _opening(
        self, host: Sample, hole: Hole, inside: _Inside, rng: np.random.Generator
    ) -> Span | None:
        """The free opening; in some an open leaf hides a part of the room behind."""
        rows, columns = host.image.shape[:2]
        left, right = free_edges(hole, rows)
        if rng.random() < 0.4:
            left, right = self._leaf(hole, left, right, inside, rng)
        if min(right, columns - 1) - max(left, 0) < 0.02 * columns:
            return None
        clear = way_to(hole, left, right, host)
        if rng.random() > _KEPT[clear]:
            return None
        return Span(float(left), float(right), clear=clear)

    def _leaf(
        self, hole: Hole, left: float, right: float, inside: _Inside, rng: np.random.Generator
    ) -> tuple[float, float]:
        """Hangs a leaf that is open into the room behind; what it leaves free."""
        share, shrink = rng.uniform(0.06, 0.45), rng.uniform(0.02, 0.1)
        hinge_left = rng.random() < 0.5
        low, top, top_far, low_far = hole.front if hinge_left else hole.front[::-1]
        top_end, low_end = top + share * (top_far - top), low + share * (low_far - low)
        tall = low_end - top_end
        quad = np.array([low, top, top_end + shrink * tall, low_end - shrink * tall])
        shape = inside.depth.shape
        if self._leaves and rng.random() < 0.7:
            skin = self._skin(quad, shape, rng)
        else:
            skin = rng.uniform(40, 235) * rng.uniform(0.85, 1.1, 3) * np.ones((*shape, 3))
        alpha = filled(quad, shape, smooth=True)[..., None]
        inside.image = inside.image * (1 - alpha) + skin * rng.uniform(0.5, 1.1) * alpha
        hidden = filled(quad, shape)
        inside.classes[hidden], inside.depth[hidden] = DOOR, np.nan
        edge = column_at(quad[[3, 2]], shape[0])
        return (max(left, edge), right) if hinge_left else (left, min(right, edge))

    def _skin(self, quad: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        """The box of a photographed closed door, warped onto four corners."""
        sample = self._leaves[rng.integers(len(self._leaves))]
        return _warped(sample, np.array(sample.extra["leaf"]), quad, shape)

    def _closed(
        self, hole: Hole, image: Array, wall: Array, region: Array, rng: np.random.Generator
    ) -> _Inside:
        skin = self._skin(hole.casing, region.shape, rng)
        # as bright as the wall about it, more or less
        ratio = (image[region].mean() + 10) / (skin[region].mean() + 10)
        skin = skin * ratio ** rng.uniform(0.2, 0.9) * rng.uniform(0.75, 1.2)
        return _Inside(skin, wall, np.full(region.shape, DOOR, np.uint8))

    def _flat(
        self, host: Sample, hole: Hole, kind: str, wall: Array, rng: np.random.Generator
    ) -> _Inside:
        """An image of some room, or the host mirrored."""
        share = rng.uniform(0.3, 0.9)
        left, top = rng.uniform(0, 1 - share, 2)
        box = np.array([left, top, left + share, top + share])
        source, depth = self._rooms[rng.integers(len(self._rooms))], wall
        if kind == "mirror":
            box, source, depth = box[[2, 1, 0, 3]], host, np.full(wall.shape, np.nan)
        skin = _warped(source, box, hole.front, wall.shape) * _light(kind, rng)
        return _Inside(skin, depth, np.full(wall.shape, OTHER, np.uint8))


def _placed(
    array: Array, shape: tuple[int, ...], scale: float, shift: tuple[float, float], flip: bool
) -> Array:
    """A room's image, depth or classes made smaller and put at (column, row) `shift`."""
    colours = array.ndim == 3
    array = np.ascontiguousarray(array[:, ::-1]) if flip else array
    size = (round(array.shape[1] * scale), round(array.shape[0] * scale))
    small = cv2.resize(array, size, interpolation=cv2.INTER_AREA if colours else cv2.INTER_NEAREST)
    move = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    flags = cv2.INTER_LINEAR if colours else cv2.INTER_NEAREST
    return np.asarray(
        cv2.warpAffine(small, move, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
    )


def _warped(sample: Sample, box: Array, quad: Array, shape: tuple[int, ...]) -> Array:
    """A box (left, top, right, bottom as fractions) of an image on four corners; float32."""
    left, top, right, bottom = box
    height, width = sample.image.shape[:2]
    corners = np.array([[left, bottom], [left, top], [right, top], [right, bottom]])
    matrix = cv2.getPerspectiveTransform(
        (corners * [width, height]).astype(np.float32), quad.astype(np.float32)
    )
    # what lies beyond the corners is not looked at; near a vanishing line it comes from so far away
    # that reflecting it, which OpenCV does by one width at a time, never ends
    border = cv2.BORDER_REPLICATE
    warped = cv2.warpPerspective(sample.image, matrix, shape[::-1], borderMode=border)
    return np.asarray(warped, np.float32)


def _frame_colour(wall: Array, rng: np.random.Generator) -> Array:
    """Like the wall, white, or wood."""
    own = wall.mean(axis=0) * rng.uniform(0.6, 1.3)
    white = np.full(3, rng.uniform(150, 240))
    wood = np.array([120, 80, 50]) * rng.uniform(0.4, 1.6)
    return np.asarray((own, white, wood)[rng.choice(3, p=[0.35, 0.4, 0.25])])


def _light(kind: str, rng: np.random.Generator) -> float:
    """Rooms behind are often darker; windows are brighter."""
    if kind == "window":
        return float(rng.uniform(0.8, 2.2))
    return float(rng.uniform(0.12, 0.5) if rng.random() < 0.3 else rng.uniform(0.5, 1.2))
