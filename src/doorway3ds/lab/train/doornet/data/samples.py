"""Training samples: one picture with whatever labels it has, read from mixed sources.

Readers keep everything at a modest size in memory, so that an epoch never waits for a disk.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.csvfile import csv_rows
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import Sample as Marked
from doorway3ds.lab.datasets.samples import load_frame
from doorway3ds.types import Frame

# Labels 0..5 of SEGMENTS (other, wall, floor, door, window, ceiling); 255 = unknown
UNKNOWN = 255
_NYU40 = {0: 1, 1: 2, 7: 3, 8: 4, 21: 5, 39: UNKNOWN}
_NYU_CAMERA = (518.86, 519.47, 325.58, 253.74)
_NYU_CROP = 10  # a white frame of 5-8 px surrounds each picture
_NYU_PLACE = 40  # neighbouring numbers show the same room
_LOW_M = 0.65  # a robot's camera is below, and no photograph shows what it sees
_LOW_DRAWS = 2.0
_WITHIN = 0.6  # share of the width from which on a picture is taken from within the doorway
_WITHIN_WEIGHT = 0.3
CONFIDENCE = {3: 1.0, 2: 0.8, 1: 0.4}  # how sure the eye was -> weight


@dataclass(frozen=True)
class Span:
    """An opening at mid-height, in columns of the stored picture.

    loose: the marked box holds frame and leaf, so its edges are only rough.
    clear: whether the way to it was marked free; None = not told.
    """

    left: float
    right: float
    loose: bool = False
    clear: int | None = None


@dataclass(frozen=True)
class Sample:
    """One picture and the labels it carries; None = not labelled.

    image: (H, W, 3) uint8 RGB. depth_m: (H, W) float32, nan unknown. segments: (H, W) uint8,
    255 unknown. camera: fx, fy, cx, cy in pixels of `image`. open: 1, 0, or None (half open);
    1 without spans: an opening that nobody has marked. weight: of the opening labels;
    depth_weight, segment_weight: of pseudo-labels. draws: how often training draws it, as against
    others of its source.
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
    weight: float = 1.0
    depth_weight: float = 1.0
    segment_weight: float = 1.0
    draws: float = 1.0
    extra: dict[str, Any] = field(default_factory=dict)


def _read(path: Path, flags: int) -> NDArray[Any]:
    image = cv2.imread(str(path), flags)
    if image is None:
        raise UserError(f"cannot read {path} as an image")
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return np.asarray(image)


def _scaled_camera(
    camera: tuple[float, float, float, float], sx: float, sy: float
) -> tuple[float, float, float, float]:
    fx, fy, cx, cy = camera
    return fx * sx, fy * sy, (cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5


def _scaled_column(column: float, scale: float) -> float:
    return (column + 0.5) * scale - 0.5


def read_rows(path: Path) -> dict[str, list[dict[str, str]]]:
    """Rows of a CSV by image name; UserError where it cannot be read or has no such column."""
    by_image: dict[str, list[dict[str, str]]] = {}
    for _, row in csv_rows(path, ("image",)):
        by_image.setdefault(row["image"], []).append(row)
    return by_image


def _relabel(labels: NDArray[np.uint8], table: dict[int, int]) -> NDArray[np.uint8]:
    lookup = np.zeros(256, np.uint8)
    for source, target in table.items():
        lookup[source] = target
    return lookup[labels]


def read_nyu(folder: Path, width: int = 352) -> list[Sample]:
    """NYU Depth v2 pictures with 8-bit depth, NYU40 labels and doorways.csv."""
    samples = []
    for name, rows in sorted(read_rows(folder / "doorways.csv").items()):
        crop = np.s_[_NYU_CROP:-_NYU_CROP, _NYU_CROP:-_NYU_CROP]
        stem = Path(name).stem
        image = _read(folder / "images" / name, cv2.IMREAD_COLOR)[crop]
        code = _read(folder / "depth" / f"{stem}.png", cv2.IMREAD_UNCHANGED)[crop]
        labels = _read(folder / "labels" / f"{stem}.png", cv2.IMREAD_UNCHANGED)[crop]
        scale = width / image.shape[1]
        size = (width, round(image.shape[0] * scale))
        fx, fy, cx, cy = _NYU_CAMERA
        camera = (fx, fy, cx - _NYU_CROP, cy - _NYU_CROP)
        # 255 says "10 m or more": a bound, not a distance
        depth = np.where(code == 255, np.nan, code * (9.9955 / 255)).astype(np.float32)
        spans = tuple(
            Span(
                _scaled_column(float(row["left_px"]) - _NYU_CROP, scale),
                _scaled_column(float(row["right_px"]) - _NYU_CROP, scale),
                clear=int(row["clear"]) if row["clear"] else None,
            )
            for row in rows
            if row["open"] == "1"
        )
        first = rows[0]
        samples.append(
            Sample(
                name=name,
                source="nyu",
                place=f"nyu-{int(stem) // _NYU_PLACE:03d}",
                image=cv2.resize(image, size, interpolation=cv2.INTER_AREA),
                camera=_scaled_camera(camera, scale, size[1] / image.shape[0]),
                open=int(first["open"]),
                spans=spans,
                depth_m=cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST),
                segments=cv2.resize(
                    _relabel(labels, _NYU40), size, interpolation=cv2.INTER_NEAREST
                ),
                weight=CONFIDENCE[int(first["confidence"])],
            )
        )
    return samples


def read_doors(
    folder: Path, places: dict[str, str], width: int = 264, closed_weight: float = 1.0
) -> list[Sample]:
    """Door photographs with state boxes: squares that were portraits of 480x640, 64 deg wide.

    places: picture name to place (see `cluster_places`). closed_weight: of pictures in which
    every door is closed.
    """
    samples = []
    for name, rows in sorted(read_rows(folder / "boxes.csv").items()):
        height = width * 4 // 3
        square = _read(folder / "images" / name, cv2.IMREAD_COLOR)
        image = cv2.resize(square, (width, height), interpolation=cv2.INTER_AREA)
        states = {row["state"] for row in rows}
        spans = tuple(
            Span(
                float(row["left"]) * width - 0.5,
                float(row["right"]) * width - 0.5,
                loose=True,
            )
            for row in rows
            if row["state"] in ("open", "semi")
        )
        focal = width / 2 / np.tan(np.radians(32.0))
        is_open = 1 if "open" in states else None if "semi" in states else 0
        samples.append(
            Sample(
                name=name,
                source="doors",
                place=places.get(name, name),
                image=image,
                camera=(focal, focal, (width - 1) / 2, (height - 1) / 2),
                open=is_open,
                spans=spans,
                weight=closed_weight if is_open == 0 else 1.0,
                extra={"states": sorted(states)} | _leaf(rows),
            )
        )
    return samples


def _leaf(rows: list[dict[str, str]]) -> dict[str, Any]:
    """The first closed door's box, as fractions of width and height."""
    for row in rows:
        if row["state"] == "closed":
            return {"leaf": tuple(float(row[k]) for k in ("left", "top", "right", "bottom"))}
    return {}


def read_rendered(folder: Path) -> list[Sample]:
    """Rendered homes: images/, 16-bit depth in millimetres, floor/, doorways.csv with fx_px."""
    samples = []
    for name, rows in sorted(read_rows(folder / "doorways.csv").items()):
        stem = Path(name).stem
        image = _read(folder / "images" / name, cv2.IMREAD_COLOR)
        millimetres = _read(folder / "depth" / f"{stem}.png", cv2.IMREAD_UNCHANGED)
        floor = _read(folder / "floor" / f"{stem}.png", cv2.IMREAD_UNCHANGED)
        # beyond 10 m lies what windows show: no network of this size need know how far
        known = (millimetres > 0) & (millimetres < 10_000)
        depth = np.where(known, millimetres / 1000.0, np.nan).astype(np.float32)
        height, width = image.shape[:2]
        focal = float(rows[0]["fx_px"])
        glimpse = rows[0]["open"] == "0" and rows[0]["confidence"] == "1"
        # only floor or not is known: everything else keeps its class unknown
        segments = np.where(floor > 127, 2, UNKNOWN).astype(np.uint8)
        first = rows[0]
        samples.append(
            Sample(
                name=name,
                source="rendered",
                place=f"home-{first['home']}",
                image=image,
                camera=(focal, focal, (width - 1) / 2, (height - 1) / 2),
                open=int(first["open"]),
                spans=tuple(
                    Span(
                        float(row["left_px"]),
                        float(row["right_px"]),
                        clear=int(row["clear"]) if row["clear"] else None,
                    )
                    for row in rows
                    if row["open"] == "1"
                ),
                depth_m=depth,
                segments=segments,
                # not open and only guessed: a doorway is glimpsed, too little of it to count
                weight=0.0 if glimpse else CONFIDENCE[int(first["confidence"])],
                draws=_LOW_DRAWS if float(first.get("height_m") or _LOW_M) < _LOW_M else 1.0,
                extra={"floor": floor > 127},
            )
        )
    return samples


def read_marked(folder: Path, longer: int = 352) -> list[Sample]:
    """Photographs of any size and camera marked by hand, as `3ds label` writes them: no depth.

    Their source is the folder's name. What is taken from within a doorway, so that the opening
    covers most of the picture, counts less: where its edges are is a guess.

    longer: side of the stored pictures at most. Where not every picture's place is told, pictures
    also share one that a perceptual hash finds nearly the same. Raises UserError where a picture
    cannot be read or is not of the folder's camera.
    """
    dataset = read_dataset(folder, "plain")
    name = folder.resolve().name
    samples, hashes = [], []
    for marked in dataset.samples:
        frame = load_frame(marked)
        hashes.append(groups.perceptual_hash(frame.image))
        sample = from_frame(marked, frame, name, longer)
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
    marked: Marked, frame: Frame, source: str, longer: int = 352, *, loose: bool = False
) -> Sample:
    """A marked picture as a sample whose longer side has at most so many pixels.

    frame: the picture as `load_frame` gives it. loose: openings are boxes of frame and leaf.
    """
    height, width = frame.image.shape[:2]
    scale = min(1.0, longer / max(width, height))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    camera = frame.camera.stretched_to(*size)
    across = size[0] / width
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
    )


def cluster_places(descriptors: NDArray[np.float32], threshold: float) -> NDArray[np.int64]:
    """Place numbers of pictures whose descriptors are linked by cosine similarity.

    descriptors: (N, V, D), V views of each picture (itself, mirrored). Two pictures belong to
    one place if any pair of their views is more alike than `threshold`, transitively.
    """
    # what all pictures share says nothing of the place
    descriptors = descriptors - descriptors.mean(axis=(0, 1))
    unit = descriptors / np.linalg.norm(descriptors, axis=-1, keepdims=True)
    count = len(unit)
    alike = np.full((count, count), -1.0, np.float32)
    for view in range(unit.shape[1]):
        np.maximum(alike, unit[:, 0] @ unit[:, view].T, out=alike)
    alike = np.maximum(alike, alike.T)
    pairs = [(int(a), int(b)) for a, b in np.argwhere(np.triu(alike > threshold, 1))]
    return np.array(groups.clusters(count, pairs))
