"""Lens distortion, both ways: OpenCV's plumb_bob, rational_polynomial and equidistant (fisheye).

Points are (x, y) on the plane z = 1 of the camera frame; their distorted images are in units of
the focal length. The formulas are those of OpenCV's calibration and fisheye modules, which ROS
names so in `distortion_model`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MODELS = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
"""Number of coefficients by model: k1 k2 p1 p2 k3, then k4 k5 k6; k1 to k4 of equidistant."""

WIDEST_DEG = 89.5
"""Angle from the optical axis beyond which a ray with z = 1 is of no use."""
_STEEP = 0.5  # of its value at the centre: where a slope is as small as this the model has failed


@dataclass(frozen=True)
class _End:
    """Where a model stops to be credible: angle from the axis, distorted radius and its slope."""

    angle: float
    radius: float
    distorted: float
    slope: float


@dataclass(frozen=True)
class Lens:
    """One distortion model up to the distorted radius `reach`, the image's farthest corner.

    A polynomial that was fitted to the middle of an image may turn back further out, so that two
    directions share a pixel and some pixels have none. From just before that point the lens goes on
    as an equidistant one does, so that every pixel keeps one ray and every ray one pixel.
    """

    model: str
    coefficients: tuple[float, ...]
    reach: float

    @property
    def plain(self) -> bool:
        """Whether there is no distortion at all."""
        return self.model != "equidistant" and not any(self.coefficients)

    @property
    def trusted(self) -> float:
        """Distorted radius up to which the model itself holds; beyond it the lens is a guess."""
        return math.inf if self.plain or self._end is None else self._end.distorted

    @property
    def widest(self) -> bool:
        """Whether the model holds as far from the axis as any ray with z = 1 can be."""
        return math.degrees(float(self._profile[0][-1])) > WIDEST_DEG - 0.1

    def distort(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Where the points (x, y) appear."""
        end = None if self.plain else self._end
        if end is None:
            return self._project(x, y)[:2]
        radius = np.hypot(x, y)
        beyond = radius > end.radius
        scale = np.where(beyond, end.radius / np.maximum(radius, end.radius), 1.0)
        xd, yd = self._project(x * scale, y * scale)[:2]
        further = end.slope * (np.arctan(radius) - end.angle) / end.distorted
        grown = np.where(beyond, 1 + further, 1.0)
        return xd * grown, yd * grown

    def undistort(self, xd: Array, yd: Array) -> tuple[Array, Array]:
        """The points that appear at (xd, yd)."""
        if self.plain:
            return xd, yd
        end = self._end
        if end is None:
            return self._solve(xd, yd)
        x, y, grown = self._on_rim(xd, yd, end)
        beyond = grown > 1
        inner = self._solve(np.where(beyond, 0.0, xd), np.where(beyond, 0.0, yd))
        angle = end.angle + (grown - 1) * end.distorted / end.slope
        far = np.tan(np.minimum(angle, math.radians(WIDEST_DEG)))
        return np.where(beyond, far * x, inner[0]), np.where(beyond, far * y, inner[1])

    def _on_rim(self, xd: Array, yd: Array, end: _End) -> tuple[Array, Array, Array]:
        """The unit vectors whose points at the end's radius appear in the directions of (xd, yd),
        and how much further out than those (xd, yd) are."""
        wanted = np.arctan2(yd, xd)
        turn = wanted
        for _ in range(15):  # tangential distortion turns directions by little
            x, y = np.cos(turn), np.sin(turn)
            rim_x, rim_y = self._project(end.radius * x, end.radius * y)[:2]
            off = wanted - np.arctan2(rim_y, rim_x)
            turn = turn + (off + np.pi) % (2 * np.pi) - np.pi
        return x, y, np.hypot(xd, yd) / np.hypot(rim_x, rim_y)

    def _solve(self, xd: Array, yd: Array) -> tuple[Array, Array]:
        """Newton's method from what the radial part alone would give."""
        radius = np.hypot(xd, yd)
        angles, distorted, _ = self._profile
        first = np.tan(np.interp(radius, distorted, angles))
        scale = np.where(radius > 0, first / np.where(radius > 0, radius, 1), 1.0)
        x, y = xd * scale, yd * scale
        for _ in range(20):  # 2 or 3 rounds for ordinary lenses
            xe, ye, dxx, dxy, dyy = self._project(x, y)
            ex, ey = xe - xd, ye - yd
            determinant = dxx * dyy - dxy * dxy
            step_x = (dyy * ex - dxy * ey) / determinant
            step_y = (dxx * ey - dxy * ex) / determinant
            x, y = x - step_x, y - step_y
            if max(np.abs(step_x).max(initial=0), np.abs(step_y).max(initial=0)) < 1e-12:
                break
        return x, y

    def _project(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        """The model itself: distorted x and y, the derivatives dx/dx, dx/dy (= dy/dx), dy/dy."""
        r2 = x * x + y * y
        if self.model == "equidistant":
            return _equidistant(x, y, r2, self.coefficients)
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * 3)[:8]
        below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below
        slope = k1 + r2 * (2 * k2 + 3 * k3 * r2) - radial * (k4 + r2 * (2 * k5 + 3 * k6 * r2))
        slope = 2 * slope / below  # d radial / d r2, times 2
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        dxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        dxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
        dyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        return xd, yd, dxx, dxy, dyy

    @cached_property
    def _profile(self) -> tuple[Array, Array, Array]:
        """Angles from the axis, distorted radii there and their slopes, up to where it turns."""
        angles = np.radians(np.arange(0.0, WIDEST_DEG + 0.01, 0.05))
        if self.model == "equidistant":
            distorted = _polynomial(angles, self.coefficients)[0]
        else:
            k1, k2, _, _, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * 3)[:8]
            r = np.tan(angles)
            with np.errstate(all="ignore"):
                above = 1 + r**2 * (k1 + r**2 * (k2 + r**2 * k3))
                distorted = r * above / (1 + r**2 * (k4 + r**2 * (k5 + r**2 * k6)))
        steps = np.diff(distorted)
        bad = ~((steps > 0) & np.isfinite(steps))
        if bad[0]:  # nothing can be made of it; `trusted` says so
            return angles[:2], angles[:2], np.ones(1)
        turn = int(np.argmax(bad)) if bad.any() else len(steps)
        return angles[: turn + 1], distorted[: turn + 1], steps[:turn] / np.diff(angles)[:turn]

    @cached_property
    def _end(self) -> _End | None:
        """Where the model is left; None if it holds over the whole image."""
        angles, distorted, slopes = self._profile
        if distorted[-1] >= self.reach:
            return None
        failing = slopes < _STEEP * slopes[0]
        at = int(np.argmax(failing)) if failing.any() else len(slopes) - 1
        at = max(at, 1)
        slope = max(float(slopes[at - 1]), _STEEP * float(slopes[0]))
        return _End(float(angles[at]), math.tan(angles[at]), float(distorted[at]), slope)


def _polynomial(angle: Array, coefficients: tuple[float, ...]) -> tuple[Array, Array]:
    """The equidistant model's distorted radius at an angle, and its derivative."""
    k1, k2, k3, k4 = coefficients
    a2 = angle * angle
    distorted = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
    slope = 1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4)))
    return distorted, slope


def _equidistant(
    x: Array, y: Array, r2: Array, coefficients: tuple[float, ...]
) -> tuple[Array, Array, Array, Array, Array]:
    radius = np.sqrt(r2)
    distorted, slope = _polynomial(np.arctan(radius), coefficients)
    away = radius > 1e-8
    safe = np.where(away, radius, 1.0)
    scale = np.where(away, distorted / safe, 1.0)
    along = slope / (1 + r2)  # d distorted / d radius
    bend = np.where(away, (along - scale) / np.where(away, r2, 1.0), 0.0)
    return x * scale, y * scale, scale + bend * x * x, bend * x * y, scale + bend * y * y
