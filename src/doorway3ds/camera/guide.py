"""Which frames of a board to take for a calibration, and what is still missing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.board import Board, BoardView, Corners, find_corners
from doorway3ds.errors import UserError

COLUMNS, ROWS = 4, 3
FEWEST, MOST = 12, 60  # frames
SPREAD = 1.5  # of the farthest board's distance to the nearest one's
TILTS = ("left", "right", "up", "down")
_TILTED_DEG = 15.0
_STILL_PER_S = 0.05  # of the image's width: a rolling shutter of 30 ms bends less than a pixel
_SHARP_PX = 4.0  # from black to white along an edge, per 640 columns
_NEW = 0.2  # sum of the differences in place (of the image), tilt (of 60 deg) and distance
_LOOK_PX = 640  # wide, to look for a board: at full size that takes up to half a second


@dataclass(frozen=True)
class Sight:
    """A board as it stands in an image.

    middle: x, y as fractions of the image. zones: of the grid of COLUMNS x ROWS, those with a
    corner in them. tilt_deg: across and down, + to the right and down. distance: in units in which
    two sights of one camera compare.
    """

    middle: tuple[float, float]
    zones: frozenset[int]
    tilt_deg: tuple[float, float]
    distance: float

    def unlike(self, other: Sight) -> float:
        """How different two sights are; 0 the same."""
        place = sum(abs(a - b) for a, b in zip(self.middle, other.middle, strict=True))
        tilt = sum(abs(a - b) for a, b in zip(self.tilt_deg, other.tilt_deg, strict=True))
        return place + tilt / 60 + abs(math.log(self.distance / other.distance))

    @property
    def tilts(self) -> set[str]:
        across, down = self.tilt_deg
        sides = zip(TILTS, (-across, across, -down, down), strict=True)
        return {side for side, deg in sides if deg >= _TILTED_DEG}


class Guide:
    """Takes frames in which the board is sharp, still and in a new place, until they suffice.

    views: the frames taken. verdict: what became of the last frame. seen: the board's corners in
    it, (n, 2) pixels, or None.
    """

    def __init__(self, board: Board) -> None:
        self.board = board
        self.views: list[BoardView] = []
        self.size: tuple[int, int] | None = None
        self.verdict = "show the board"
        self.seen: Corners | None = None
        self._sights: list[Sight] = []
        self._last: tuple[float, dict[bytes, NDArray[np.float32]]] | None = None

    def look(self, name: str, image: NDArray[np.uint8], stamp_s: float) -> bool:
        """Whether this frame was taken. image: (H, W, 3) uint8 RGB.

        Raises UserError if its size is another than that of the frames before.
        """
        height, width = image.shape[:2]
        if self.size not in (None, (width, height)):
            raise UserError(f"{name} is {width}x{height} and the frames before it had another size")
        self.size = (width, height)
        found = _look_for(image, self.board)
        if found is None:
            self._last = self.seen = None
            self.verdict = "no board in sight: all of it, in good light"
            return False
        points, corners = found
        self.seen = corners
        speed = self._speed(points, corners, stamp_s) / width
        if speed > _STILL_PER_S:
            self.verdict = "hold it still"
            return False
        if _edge_px(image, corners) > _SHARP_PX * max(1.0, width / 640):
            self.verdict = "blurred: more light, or wait for the focus"
            return False
        sight = _sight(points, corners, (width, height))
        if min((sight.unlike(s) for s in self._sights), default=math.inf) < _NEW:
            self.verdict = "taken already"
            return False
        if width > _LOOK_PX:
            found = find_corners(image, self.board)
            if found is None:
                self.verdict = "hold it still"
                return False
        self.views.append(BoardView(name, *found))
        self._sights.append(sight)
        self.verdict = "taken"
        return True

    @property
    def done(self) -> bool:
        """Whether no further frame is needed."""
        return not self.missing or len(self.views) >= MOST

    @property
    def hint(self) -> str:
        """What was wrong with the last frame, or what to do next."""
        taken = self.verdict.startswith("taken")
        return f"{self.verdict}; {self.missing}" if taken else self.verdict

    @property
    def zones(self) -> frozenset[int]:
        """Covered zones of the image, row by row from 0."""
        return frozenset[int]().union(*(sight.zones for sight in self._sights))

    @property
    def tilts(self) -> set[str]:
        """Which of TILTS were seen."""
        return set[str]().union(*(sight.tilts for sight in self._sights))

    @property
    def spread(self) -> float:
        """Distance of the farthest board over that of the nearest, 1 without any."""
        distances = [sight.distance for sight in self._sights] or [1.0]
        return max(distances) / min(distances)

    @property
    def missing(self) -> str:
        """The next thing to show, empty once the frames suffice."""
        blank = [zone for zone in range(COLUMNS * ROWS) if zone not in self.zones]
        if blank:
            row, column = divmod(blank[0], COLUMNS)
            down = ("upper", "middle", "lower")[row]
            across = "left" if column == 0 else "right" if column == COLUMNS - 1 else "inner"
            return f"move it to the {down} {across} part of the image"
        untilted = [side for side in TILTS if side not in self.tilts]
        if untilted:
            return f"tilt it to face {untilted[0]}"
        if self.spread < SPREAD:
            return "hold it much nearer or farther"
        return "" if len(self.views) >= FEWEST else "any other place or tilt"

    def _speed(self, points: Corners, corners: Corners, stamp_s: float) -> float:
        """Pixels a second since the last look, inf if there was no board in it."""
        now = {point.tobytes(): corner for point, corner in zip(points, corners, strict=True)}
        last, self._last = self._last, (stamp_s, now)
        if last is None:
            return math.inf
        moved = [np.hypot(*(now[key] - last[1][key])) for key in now.keys() & last[1].keys()]
        if not moved or stamp_s <= last[0]:
            return math.inf
        return float(np.mean(moved)) / (stamp_s - last[0])


def incomplete(missing: str) -> str:
    """What to say of a calibration by a guide that lacked something."""
    return f"coverage is not complete; next would be: {missing}"


def _look_for(image: NDArray[np.uint8], board: Board) -> tuple[Corners, Corners] | None:
    """`find_corners`, in an image made smaller if it is large."""
    shrunk = max(1.0, image.shape[1] / _LOOK_PX)
    if shrunk > 1:
        small = cv2.resize(image, None, fx=1 / shrunk, fy=1 / shrunk, interpolation=cv2.INTER_AREA)
        image = np.asarray(small, np.uint8)
    found = find_corners(image, board)
    if found is None:
        return None
    return found[0], ((found[1] + 0.5) * shrunk - 0.5).astype(np.float32)


def _edge_px(image: NDArray[np.uint8], corners: Corners) -> float:
    """Pixels from black to white along the board's steepest edges."""
    x, y, width, height = cv2.boundingRect(corners)
    part = image[max(y, 0) : y + height, max(x, 0) : x + width]
    grey = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY).astype(np.float32)
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)) / 8
    black, white = np.percentile(grey, (5, 95))
    return float((white - black) / max(np.percentile(slope, 99), 1e-6))


def _sight(points: Corners, corners: Corners, size: tuple[int, int]) -> Sight:
    width, height = size
    # Of a lens as most are; tilts and distances need only compare.
    focal = 0.9 * width
    lens = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    _, turn, move = cv2.solvePnP(points, corners, lens, np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    turned = cv2.Rodrigues(turn)[0]
    faces = turned[:, 2] if turned[2, 2] < 0 else -turned[:, 2]
    tilt = np.degrees(np.arcsin(np.clip(faces[:2], -1, 1)))
    far = turned @ points.mean(axis=0) + np.ravel(move)
    middle = corners.mean(axis=0) / size
    cells = np.clip(corners / size, 0, 0.999) * (COLUMNS, ROWS)
    zones = frozenset(int(row) * COLUMNS + int(column) for column, row in cells)
    return Sight(
        (float(middle[0]), float(middle[1])),
        zones,
        (float(tilt[0]), float(tilt[1])),
        float(np.linalg.norm(far)),
    )
