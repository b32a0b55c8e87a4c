"""A camera's focal length against the vanishing points of a room, whose edges are square."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, pixel_to_ray

Array = NDArray[np.float64]

FACTORS = np.exp(np.linspace(np.log(0.6), np.log(1.7), 37))
_SHORTEST = 0.05  # of the image's width
_MOST, _FEWEST = 150, 12
_TRIES = 1500
_OFF = np.sin(np.radians(2.1))  # an edge that misses its vanishing point by more counts nothing
_AS_GOOD = 0.03  # of all edges' length
_WIDEST = 1.5  # ratio of the range's ends, beyond which the image does not tell


@dataclass(frozen=True)
class FocalCheck:
    """The focal length that a room's edges fit best, over the camera's.

    low, high: the range in which the edges fit about as well.
    """

    factor: float
    low: float
    high: float

    @property
    def agrees(self) -> bool:
        """Whether the camera's lies in the range, or within 10 % of the best."""
        return self.low <= 1 <= self.high or abs(self.factor - 1) <= 0.1


class FocalWatch:
    """Whether the first images of one camera contradict its focal length.

    Of 232 views of homes by a known camera (480x360), 102 told a focal length, two of them a wrong
    one; so `MOST` images are looked at, and most of those that tell must disagree.
    """

    MOST, ENOUGH = 5, 3  # images looked at; of them, those that tell

    def __init__(self) -> None:
        self._found: list[FocalCheck] = []
        self._looked = 0
        self._camera: Camera | None = None

    @property
    def done(self) -> bool:
        """Whether further images would be looked at."""
        return self._looked >= self.MOST or len(self._found) >= self.ENOUGH

    def look(self, image: NDArray[np.uint8], camera: Camera) -> None:
        """Takes an image into account, which costs a fraction of a second, unless it is `done`.

        image: as for `check_focal`. An assumed camera is not checked: its answers say so already.
        """
        if self.done or camera.assumed:
            return
        self._looked, self._camera = self._looked + 1, camera
        found = check_focal(image, camera)
        if found is not None:
            self._found.append(found)

    @property
    def doubt(self) -> str | None:
        """What to warn of, in one line, or None."""
        off = sorted(found.factor for found in self._found if not found.agrees)
        if self._camera is None or 2 * len(off) <= len(self._found):
            return None
        factor, camera = off[len(off) // 2], self._camera
        return (
            f"{camera.name} has a focal length of {camera.fx:.0f} px, and the room's lines fit "
            f"{camera.fx * factor:.0f} ({1 / factor - 1:+.0%}): bearings and distances may be off "
            "in proportion; see `3ds calibrate --check`"
        )


def check_focal(image: NDArray[np.uint8], camera: Camera) -> FocalCheck | None:
    """Compares; None if the image does not tell, as one of a wall straight ahead.

    image: (H, W, 3) uint8 RGB of `camera`'s size.

    For each of FACTORS it looks for three directions, square to each other, that most of the
    edges' length points to (random sampling of three edges, with a fixed seed).
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_ADV).detect(grey)[0]
    ends = np.zeros((0, 2, 2)) if found is None else np.asarray(found, float).reshape(-1, 2, 2)
    lengths = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    longest = np.argsort(-lengths)[:_MOST]
    longest = longest[lengths[longest] > _SHORTEST * camera.width]
    if len(longest) < _FEWEST:
        return None
    rays, weights = pixel_to_ray(camera, ends[longest]), lengths[longest] / lengths[longest].sum()
    rng = np.random.default_rng(0)
    threes = np.array(
        [rng.choice(len(longest), 3, replace=False, p=weights) for _ in range(_TRIES)]
    )
    fits = np.array([_fit(rays / (factor, factor, 1), weights, threes) for factor in FACTORS])
    good = np.flatnonzero(fits >= fits.max() - _AS_GOOD)
    low, high = float(FACTORS[good[0]]), float(FACTORS[good[-1]])
    if high > _WIDEST * low or good[0] == 0 or good[-1] == len(FACTORS) - 1:
        return None
    return FocalCheck(float(FACTORS[fits.argmax()]), low, high)


def _fit(rays: Array, weights: Array, threes: NDArray[np.int64]) -> float:
    """The largest part of the weights (n,) that points to three square directions.

    rays: (n, 2, 3) of the edges' ends. threes: (t, 3) edges; the first two give one direction, the
    third another one square to it.
    """
    planes = _unit(np.cross(rays[:, 0], rays[:, 1]))
    middles = _unit(rays.mean(axis=1))
    across = np.cross(middles, planes)
    first = _unit(np.cross(planes[threes[:, 0]], planes[threes[:, 1]]))
    second = _unit(np.cross(first, planes[threes[:, 2]]))
    off = np.full((len(threes), len(rays)), np.inf)
    for direction in (first, second, np.cross(first, second)):
        # Against the plane of the middle and the direction, whose normal is their cross product.
        cosine = direction @ across.T
        length = 1 - (direction @ middles.T) ** 2
        off = np.minimum(off, 1 - cosine**2 / np.maximum(length, 1e-12))
    return float((np.maximum(0, 1 - off / _OFF**2) @ weights).max())


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-12)
    return unit
