"""Photographs that nobody has marked, labelled by a network that learned from marked ones.

A student that learns from them under augmentation, beside the marked ones, sees many more homes
than were ever marked (Xie et al., "Self-training with Noisy Student improves ImageNet
classification", CVPR 2020). What the teacher is unsure of is left out or counts little.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from doorway3ds.camera.choice import default_camera
from doorway3ds.decide.opening import decode_columns, way_vote
from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image
from doorway3ds.images.folder import images_in
from doorway3ds.lab.train.doornet.data.samples import LONGER, Sample, Span
from doorway3ds.networks.base import Network
from doorway3ds.types import ColumnVotes

_ASPECT = 4 / 3  # of a square image: collections squeeze theirs, cameras take none
_SURE, _DOUBTED = 0.5, 0.12  # scores from which on an opening is one, or may be one
_LEAST = 0.2  # how sure of open or not a label must be, 0 to 1
_NONE_EACH = 2
_FREE, _BLOCKED = 0.8, 0.2  # probabilities from which on the way to it is told


def read_unmarked(folder: Path, network: Network) -> list[Sample]:
    """The images below `folder` with the openings that `network` sees, in the order of names.

    Left out are images that its gate and its columns disagree on, those that it is unsure of, and
    of those without an opening so many that two for each with one remain. A square one is
    stretched to 4:3. Raises UserError if the folder holds no image, or one that cannot be read.
    """
    files = images_in(folder, recursive=True)
    if not files:
        raise UserError(f"{folder} holds no image to learn from")
    shown: list[Sample] = []
    none: list[Sample] = []
    for path in files:
        image = _stored(read_image(path).image)
        sample = _labelled(image, network, path.relative_to(folder).as_posix(), folder)
        if sample is not None:
            (shown if sample.open else none).append(sample)
    spaced = np.linspace(0, len(none) - 1, min(len(none), _NONE_EACH * len(shown))).astype(int)
    return shown + [none[index] for index in spaced]


def _stored(image: Any) -> Any:
    rows, columns = image.shape[:2]
    wide = columns * _ASPECT if rows == columns else columns
    scale = min(LONGER / max(wide, rows), 1.0) if rows != columns else LONGER / wide
    size = (round(wide * scale), round(rows * scale))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _labelled(image: Any, network: Network, name: str, folder: Path) -> Sample | None:
    """One image; None if nothing certain can be said of it."""
    rows, columns = image.shape[:2]
    camera = default_camera(columns, rows)
    seen = network(image, camera)
    if seen.columns is None or seen.p_open is None:
        raise UserError(f"{network.name} cannot label images: it gives no opening columns")
    found = decode_columns(seen.columns, columns, _DOUBTED)
    spans = tuple(
        Span(left, right, clear=_clear(seen.columns, left, right, columns), unsure=score < _SURE)
        for left, right, score in found
    )
    is_open = seen.p_open >= 0.5
    sure = abs(2 * seen.p_open - 1)
    if is_open == all(span.unsure for span in spans) or sure < _LEAST:
        return None
    source = folder.resolve().name
    return Sample(
        name=name,
        source=source,
        place=f"{source}-{name}",
        image=image,
        camera=(camera.fx, camera.fy, camera.cx, camera.cy),
        open=int(is_open),
        p_open=seen.p_open,
        spans=spans,
        weight=sure,
    )


def _clear(votes: ColumnVotes, left: float, right: float, width: int) -> int | None:
    chance = way_vote(votes, left, right, width)
    if chance is None or _BLOCKED < chance < _FREE:
        return None
    return int(chance >= _FREE)
