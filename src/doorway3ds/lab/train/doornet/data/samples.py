"""Training samples: one image with whatever labels it has, read from mixed sources.

Readers keep everything at a modest size in memory, so that an epoch never waits for a disk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import (
    DEPTH_FULL_M,
    Dataset,
    load_depth,
    load_floor,
    load_frame,
    load_labels,
)
from doorway3ds.lab.datasets.samples import Sample as Marked
from doorway3ds.lab.evaluate.overview import source_of
from doorway3ds.types import Frame

# Labels 0..5 of SEGMENTS (other, wall, floor, door, window, ceiling); 255 = unknown
UNKNOWN = 255
LONGER = 352  # side of a stored image at most, unless it is rendered
_DOOR_WIDTH = LONGER * 3 // 4
_NYU40 = np.zeros(256, np.uint8)  # by the labels of NYU40, less 1
_NYU40[[0, 1, 7, 8, 21, 39]] = 1, 2, 3, 4, 5, UNKNOWN
_NAN = np.float32(np.nan)
_LOW_M = 0.65  # a robot's camera is below, and no photograph shows what it sees
_LOW_DRAWS = 2.0
_WITHIN = 0.6  # share of the width from which on an image is taken from within the doorway
_WITHIN_WEIGHT = 0.3
CONFIDENCE = {3: 1.0, 2: 0.8, 1: 0.4}  # how sure the eye was -> weight


@dataclass(frozen=True)
class Span:
    """An opening at mid-height, in columns of the stored image.

    loose: the marked box holds frame and leaf, so its edges are only rough.
    clear: whether the way to it was marked free; None = not told. unsure: there may be an opening
    here or not, so nothing is learned from these columns.
    """

    left: float
    right: float
    loose: bool = False
    clear: int | None = None
    unsure: bool = False


@dataclass(frozen=True)
class Sample:
    """One image and the labels it carries; None = not labelled.

    image: (H, W, 3) uint8 RGB. depth_m: (H, W) float32, nan unknown. segments: (H, W) uint8,
    255 unknown. camera: fx, fy, cx, cy in pixels of `image`. open: 1, 0, or None (half open);
    1 without spans: an opening that nobody has marked. p_open: how likely it is, if not known for
    certain. weight: of the opening labels; depth_weight, segment_weight: of pseudo-labels. draws:
    how often training draws it, as against others of its source. kinds: what an image without an
    opening shows instead, if told.
    """

    name: str
    source: str
    place: str
    image: NDArray[Any]
    camera: tuple[float, float, float, float]
    open: int | None
    spans: tuple[Span, ...]
    depth_m: NDArray[Any] | None = None
    segments: NDArray[Any] | None = None
    p_open: float | None = None
    weight: float = 1.0
    depth_weight: float = 1.0
    segment_weight: float = 1.0
    draws: float = 1.0
    kinds: tuple[str, ...] = ()
    extra: dict[str, Any] = field(default_factory=dict)


def _scaled_column(column: float, scale: float) -> float:
    return (column + 0.5) * scale - 0.5


def read_samples(folder: Path, *, closed_weight: float = 1.0) -> list[Sample]:
    """Samples of a data set of any layout. Raises UserError if it is none or damaged.

    closed_weight: of photographs in which every door is closed, if there are boxes of doors.
    """
    dataset = read_dataset(folder)
    if dataset.layout == "plain":
        return _by_hand(dataset)
    read: dict[str, Callable[[Marked], Sample]] = {
        "nyu": lambda one: replace(_with_maps(one, "nyu", LONGER), place=f"nyu-{one.place}"),
        "rendered": _rendered,
        "boxes": lambda one: _door(one, closed_weight),
        "folders": lambda one: from_frame(one, load_frame(one), source_of(dataset)),
    }
    return [read[dataset.layout](marked) for marked in dataset.samples]


def _door(marked: Marked, closed_weight: float) -> Sample:
    """A photograph of doors with their boxes, as a portrait of 3:4."""
    frame = load_frame(replace(marked, size=(_DOOR_WIDTH, LONGER)))
    sample = from_frame(marked, frame, "doors", loose=True)
    return replace(
        sample,
        place=sample.name,
        weight=closed_weight if sample.open == 0 else sample.weight,
        extra={} if marked.leaf is None else {"leaf": marked.leaf},
    )


def _rendered(marked: Marked) -> Sample:
    """An image of a rendered home at its full size."""
    sample = _with_maps(marked, "rendered", None)
    # not open and only guessed: a doorway is glimpsed, too little of it to count
    glimpse = sample.open == 0 and marked.confidence == 1
    low = marked.pose.height_m is not None and marked.pose.height_m < _LOW_M
    weight = 0.0 if glimpse else sample.weight
    return replace(sample, weight=weight, draws=_LOW_DRAWS if low else 1.0)


def _with_maps(marked: Marked, source: str, longer: int | None) -> Sample:
    """A marked image with depth and segments: its labels', or floor and unknown."""
    sample = from_frame(marked, load_frame(marked), source, longer)
    size = (sample.image.shape[1], sample.image.shape[0])

    def fitted(values: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_NEAREST))

    depth, labels, floor = load_depth(marked), load_labels(marked), load_floor(marked)
    if depth is not None:
        # at 10 m it is a bound, and beyond lies what windows show: no network of this size need
        # know how far
        sample = replace(sample, depth_m=fitted(np.where(depth < DEPTH_FULL_M, depth, _NAN)))
    if labels is not None:
        sample = replace(sample, segments=fitted(_NYU40[labels]))
    if floor is not None:
        segments = np.where(floor, 2, UNKNOWN).astype(np.uint8)
        mask = fitted(floor.astype(np.uint8)) > 0
        sample = replace(sample, segments=fitted(segments), extra={"floor": mask})
    return sample


def _by_hand(dataset: Dataset) -> list[Sample]:
    """Photographs of any size and camera marked by hand, as `3ds label` writes them: no depth.

    Their source is the folder's name. What is taken from within a doorway, so that the opening
    covers most of the image, counts less: where its edges are is a guess. Where not every
    image's place is told, images also share one that a perceptual hash finds nearly the same.

    Raises UserError where an image cannot be read or is not of the folder's camera.
    """
    name = source_of(dataset)
    samples, hashes = [], []
    for marked in dataset.samples:
        frame = load_frame(marked)
        hashes.append(groups.perceptual_hash(frame.image))
        sample = from_frame(marked, frame, name)
        width = sample.image.shape[1]
        if any(span.right - span.left > _WITHIN * width for span in sample.spans):
            sample = replace(sample, weight=sample.weight * _WITHIN_WEIGHT)
        samples.append(sample)
    pairs = groups.near_pairs(np.array(hashes, bool))
    newest: dict[str, int] = {}
    for index, marked in enumerate(dataset.samples):
        if marked.place in newest:
            pairs.append((newest[marked.place], index))
        newest[marked.place] = index
    places, _ = groups.name_groups(dataset.samples, pairs, places_known=dataset.places_known)
    named = zip(samples, places, strict=True)
    return [replace(sample, place=f"{name}-{place}") for sample, place in named]


def from_frame(
    marked: Marked, frame: Frame, source: str, longer: int | None = LONGER, *, loose: bool = False
) -> Sample:
    """A marked image as a sample whose longer side has at most so many pixels; None: any.

    frame: the image as `load_frame` returns it. loose: openings are boxes of frame and leaf.
    """
    height, width = frame.image.shape[:2]
    scale = 1.0 if longer is None else min(1.0, longer / max(width, height))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    camera = frame.camera.stretched_to(*size)
    across = size[0] / (marked.size[0] if marked.size else width)
    spans = tuple(
        Span(
            _scaled_column(opening.left_px, across),
            _scaled_column(opening.right_px, across),
            loose=loose,
            clear=None if opening.clear is None else int(opening.clear),
        )
        for opening in marked.openings
    )
    return Sample(
        name=marked.name,
        source=source,
        place=marked.place,
        image=cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA),
        camera=(camera.fx, camera.fy, camera.cx, camera.cy),
        open=None if marked.is_open is None else int(marked.is_open),
        spans=spans,
        weight=CONFIDENCE[marked.confidence],
        kinds=marked.kinds,
    )


def cluster_places(descriptors: NDArray[np.float32], threshold: float) -> NDArray[np.int64]:
    """Place numbers of images whose descriptors are linked by cosine similarity.

    descriptors: (N, V, D), V views of each image (itself, mirrored). Two images belong to
    one place if any pair of their views is more alike than `threshold`, transitively.
    """
    # what all images share says nothing of the place
    descriptors = descriptors - descriptors.mean(axis=(0, 1))
    unit = descriptors / np.linalg.norm(descriptors, axis=-1, keepdims=True)
    count = len(unit)
    alike = np.full((count, count), -1.0, np.float32)
    for view in range(unit.shape[1]):
        np.maximum(alike, unit[:, 0] @ unit[:, view].T, out=alike)
    alike = np.maximum(alike, alike.T)
    pairs = [(int(a), int(b)) for a, b in np.argwhere(np.triu(alike > threshold, 1))]
    return np.array(groups.clusters(count, pairs))
