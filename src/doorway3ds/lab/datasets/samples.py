"""Marked data sets: what a sample is, how its files are read, how places are held out.

`readers.read_dataset` finds the samples of a folder; nothing here decodes an image before
it is asked to.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.choice import FitCamera, default_camera, turned_camera
from doorway3ds.camera.model import Camera, Pose, ray_to_pixel, rotation
from doorway3ds.errors import CallError, UserError
from doorway3ds.images.codec import read_image
from doorway3ds.types import Frame

# What is easily taken for an open doorway, and the NYU40 ids minus 1 that count as it.
NYU_KINDS = {
    "closed door": (7,),
    "window": (8, 12, 15),  # window, blinds, curtain
    "mirror": (18,),
    "picture or screen": (10, 24, 29),  # picture, television, whiteboard
    "wardrobe or cabinet": (2, 16, 23),  # cabinet, dresser, refrigerator
    "shelves": (9, 14),  # bookshelf, shelves
    "shower curtain": (27,),
}
KIND_SHARE = 0.02  # of an image's pixels, from which on a kind counts as shown

DEPTH_FULL_M = 10.0


@dataclass(frozen=True)
class Marked:
    """One opening marked in an image: columns at mid-height of the image as it is used."""

    left_px: float
    right_px: float
    clear: bool | None = None
    confidence: int = 3
    second: bool = False
    range_m: float | None = None


@dataclass(frozen=True)
class Sample:
    """One image with its marks; the files are read by the functions below.

    camera None: what `fit` gives, once the image's size is known. is_open None: neither
    open nor closed (half open). crop: (top, bottom, left, right) to cut from image, depth
    and labels alike. size: (width, height) to stretch the image to. depth_unit_m: metres per
    count; counts of 0 are unknown. depth_full: the count that
    stands for DEPTH_FULL_M or more. leaf: left, top, right, bottom of a closed door as fractions
    of the image. eigen_box: the Eigen crop in the cropped image.
    """

    name: str
    place: str
    image_path: Path
    is_open: bool | None
    openings: tuple[Marked, ...] = ()
    kinds: tuple[str, ...] = ()
    camera: Camera | None = None
    fit: FitCamera = default_camera
    pose: Pose = field(default_factory=Pose)
    confidence: int = 3
    crop: tuple[int, int, int, int] | None = None
    size: tuple[int, int] | None = None
    depth_path: Path | None = None
    depth_unit_m: float = 0.001
    depth_full: int | None = None
    labels_path: Path | None = None
    floor_path: Path | None = None
    leaf: tuple[float, float, float, float] | None = None
    eigen_box: tuple[int, int, int, int] | None = None


@dataclass(frozen=True)
class Dataset:
    """Samples in name order. places_known: False where each image is its own place."""

    path: Path
    layout: str
    samples: tuple[Sample, ...]
    places_known: bool


def load_frame(sample: Sample) -> Frame:
    """Decode, crop and stretch a sample's image. Raises UserError where it cannot be read."""
    picture = read_image(sample.image_path)
    image = _cropped(picture.image, sample)
    if sample.size is not None:
        enlarges = sample.size[0] * sample.size[1] > image.shape[0] * image.shape[1]
        image = cv2.resize(
            image, sample.size, interpolation=cv2.INTER_LINEAR if enlarges else cv2.INTER_AREA
        )
    height, width = image.shape[:2]
    camera = sample.camera or turned_camera(
        sample.fit, width, height, picture.focal_35mm, picture.orientation
    )
    if (camera.width, camera.height) != (width, height):
        camera = camera.scaled_to(width, height)
    return Frame(np.ascontiguousarray(image, np.uint8), camera, sample.pose)


def load_depth(sample: Sample) -> NDArray[np.float32] | None:
    """True depth (H, W) in metres, nan where unknown; None where the sample has none."""
    if sample.depth_path is None:
        return None
    counts = _read_map(sample.depth_path, sample, "depth image")
    depth = counts.astype(np.float32) * np.float32(sample.depth_unit_m)
    depth[counts == 0] = np.nan
    if sample.depth_full is not None:
        depth[counts == sample.depth_full] = DEPTH_FULL_M
    return np.asarray(depth, np.float32)


def load_labels(sample: Sample) -> NDArray[np.uint8] | None:
    """The class of each pixel (H, W) as in NYU_KINDS; None where the sample tells none."""
    if sample.labels_path is None:
        return None
    return _read_map(sample.labels_path, sample, "8-bit label image", np.uint8)


def load_floor(sample: Sample) -> NDArray[np.bool_] | None:
    """Whether each pixel (H, W) shows floor; None where the sample does not tell."""
    if sample.floor_path is None:
        return None
    return np.asarray(_read_map(sample.floor_path, sample, "8-bit mask", np.uint8) > 127)


def _read_map(path: Path, sample: Sample, what: str, dtype: Any = None) -> NDArray[Any]:
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if values is None or values.ndim != 2 or dtype not in (None, values.dtype):
        raise UserError(f"{path} is not a one-channel {what} that can be read")
    return _cropped(np.asarray(values), sample)


def kinds_shown(sample: Sample, labels: NDArray[np.uint8] | None) -> tuple[str, ...]:
    """The sample's own kinds, and those that its labels show on 2 % of the pixels."""
    if labels is None:
        return sample.kinds
    shown = [k for k, ids in NYU_KINDS.items() if np.isin(labels, ids).mean() >= KIND_SHARE]
    return (*sample.kinds, *shown)


def bearing_to_column(frame: Frame, bearing_deg: float) -> float:
    """Column at which a level ray of this bearing (seen from the lens) meets the image."""
    angle = math.radians(bearing_deg)
    robot = np.array([math.cos(angle), math.sin(angle), 0.0])
    pixel = ray_to_pixel(frame.camera, rotation(frame.pose).T @ robot)
    return float(np.nan_to_num(pixel[0], nan=-1.0))


def place_folds(places: Iterable[str], folds: int) -> dict[str, int]:
    """Fold 0..folds-1 of each place: the sorted places dealt out in turn.

    Training and evaluation must use this same rule, so that what is held out stays unseen.
    """
    names = sorted(set(places))
    if not 2 <= folds <= len(names):
        raise CallError(f"expected 2 to {len(names)} folds for {len(names)} places, got {folds}")
    return {name: index % folds for index, name in enumerate(names)}


def parse_split(text: str) -> tuple[int, int]:
    """(fold counted from 0, folds) of "K/N", where K counts from 1."""
    first, slash, second = text.partition("/")
    if not slash or not first.isdigit() or not second.isdigit():
        raise CallError(f"expected a split K/N such as 1/5, got '{text}'")
    fold, folds = int(first), int(second)
    if not 1 <= fold <= folds:
        raise CallError(f"expected K from 1 to N in the split K/N, got '{text}'")
    return fold - 1, folds


def held_out(dataset: Dataset, fold: int, folds: int) -> Dataset:
    """The samples of one fold of places."""
    if not dataset.places_known:
        raise UserError(
            f"{dataset.path} does not say which images share a place, so none can be held out; "
            "add a 'place' column or give --places FILE"
        )
    of_place = place_folds((s.place for s in dataset.samples), folds)
    kept = tuple(s for s in dataset.samples if of_place[s.place] == fold)
    return replace(dataset, samples=kept)


def with_camera(dataset: Dataset, fit: FitCamera, pose: Pose) -> Dataset:
    """Photographs whose camera is not known otherwise, as taken by the camera that `fit` gives."""
    if all(s.camera is not None for s in dataset.samples):
        raise CallError(f"the {dataset.layout} layout brings its camera; leave camera options out")
    samples = tuple(
        replace(s, fit=fit, pose=pose) if s.camera is None else s for s in dataset.samples
    )
    return replace(dataset, samples=samples)


def only_named(dataset: Dataset, names: Sequence[str]) -> Dataset:
    """The samples of these names. Raises UserError where one is not there."""
    wanted = set(names)
    kept = tuple(s for s in dataset.samples if s.name in wanted)
    missing = sorted(wanted - {s.name for s in kept})
    if missing:
        raise UserError(
            f"{len(missing)} of the listed images are not in {dataset.path}, first '{missing[0]}'"
        )
    return replace(dataset, samples=kept)


def at_least(dataset: Dataset, confidence: int) -> Dataset:
    """Images, and of them further openings, marked with at least this confidence."""
    kept = tuple(
        replace(s, openings=tuple(o for o in s.openings if o.confidence >= confidence))
        for s in dataset.samples
        if s.confidence >= confidence
    )
    return replace(dataset, samples=kept)


def _cropped(array: NDArray[Any], sample: Sample) -> NDArray[Any]:
    if sample.crop is None:
        return array
    top, bottom, left, right = sample.crop
    if array.shape[0] < bottom or array.shape[1] < right:
        raise UserError(
            f"{sample.image_path} or its depth is {array.shape[1]}x{array.shape[0]}; expected "
            f"at least {right}x{bottom} to cut the white frame from"
        )
    return array[top:bottom, left:right]
