"""What the marks of an image say in degrees and metres."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, Pose, back_project, bearing_of_pixel
from doorway3ds.lab.datasets.samples import Sample
from doorway3ds.types import Frame


@dataclass(frozen=True)
class TruthOpening:
    """One marked opening as seen from the turning axis; left_deg > right_deg.

    clear: whether the way to it is free, None = cannot be told. second: a further opening.
    """

    left_deg: float
    right_deg: float
    bearing_deg: float
    range_m: float | None = None
    clear: bool | None = None
    second: bool = False


@dataclass(frozen=True)
class PictureTruth:
    """What an image shows. is_open None (half-open only) stays out of p_open's score.

    place: images of one place depend on each other. openings: main one first; without any,
    and is_open False, there is no doorway to go to. kinds: what such an image shows that is
    easily taken for one.
    """

    image: str
    place: str
    is_open: bool | None
    openings: tuple[TruthOpening, ...] = ()
    kinds: tuple[str, ...] = ()

    @property
    def unmarked(self) -> bool:
        """Whether it shows a doorway, open or half open, and nobody said where."""
        return self.is_open is not False and not self.openings


def picture_truth(sample: Sample, frame: Frame, depth_m: NDArray[Any] | None) -> PictureTruth:
    """What the marks say in degrees and metres, by the frame's camera and pose.

    A marked opening's bearing is that of the ray through (left_px + right_px) / 2 at the
    image's middle row. Its range is the marked one, else that of its jambs in true depth.
    """
    camera, pose = frame.camera, frame.pose
    row = (camera.height - 1) / 2
    openings = []
    for marked in sample.openings:
        range_m = marked.range_m
        if range_m is None and depth_m is not None:
            range_m = threshold_range_m(depth_m, camera, pose, marked.left_px, marked.right_px)
        columns = (marked.left_px, (marked.left_px + marked.right_px) / 2, marked.right_px)
        left, middle, right = bearing_of_pixel(camera, pose, [(x, row) for x in columns], range_m)
        openings.append(
            TruthOpening(
                float(left), float(right), float(middle), range_m, marked.clear, marked.second
            )
        )
    openings.sort(key=lambda opening: opening.second)
    return PictureTruth(sample.name, sample.place, sample.is_open, tuple(openings))


def threshold_range_m(
    depth_m: NDArray[Any], camera: Camera, pose: Pose, left_px: float, right_px: float
) -> float | None:
    """Horizontal distance to the middle between the jambs, from true depth.

    A jamb is read as the median point of a strip just outside the opening (0.5 to 2.5 % of the
    width, the middle tenth of the rows). None where the image's edge cuts a jamb or its
    depth is unknown.
    """
    height, width = depth_m.shape
    scale = width / camera.width
    near, far = 0.005 * width, 0.025 * width
    left, right = (left_px + 0.5) * scale - 0.5, (right_px + 0.5) * scale - 0.5
    strips = ((left - far, left - near), (right + near, right + far))
    if strips[0][0] < 0 or strips[1][1] > width - 1:
        return None
    rows = slice(round(0.45 * height), max(round(0.55 * height), round(0.45 * height) + 1))
    points = back_project(camera, pose, depth_m)[rows]
    jambs = []
    for start, end in strips:
        strip = points[:, round(start) : round(end) + 1, :2].reshape(-1, 2)
        strip = strip[np.isfinite(strip).all(axis=1)]
        if len(strip) == 0:
            return None
        jambs.append(np.median(strip, axis=0))
    return float(math.hypot(*((jambs[0] + jambs[1]) / 2)))
