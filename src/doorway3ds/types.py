"""What flows from one stage to the next: frozen values, no behaviour beyond checks.

Frames, units and signs are those of docs/architecture.md: pixels count from the centre
of the top-left pixel, angles are degrees (bearing + left, elevation and pitch + up),
distances metres.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.arguments import (
    require,
    require_image,
    require_number,
    require_pixel,
    require_probability,
    shown,
)
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.compat import StrEnum
from doorway3ds.errors import CallError

FloatArray = NDArray[np.floating[Any]]

# A doorway's distance is off by more than the depth of the pixels round it: by the image's scale,
# and by taking the wrong jamb or floor's edge, too. Both measured with benchmarks/range_error.py,
# see docs/results/distances.md.
RANGE_PER_DEPTH_ERROR = 1.5


class Reason(StrEnum):
    """Why the robot should turn, or why not: the first that holds.

    >>> Reason("turn") is Reason.TURN
    True
    >>> print(Reason.BLOCKED)
    blocked
    """

    NO_DOOR = "no_door"  # no open doorway is seen
    BLOCKED = "blocked"  # a doorway is seen, and something stands in the way to it
    UNSURE = "unsure"  # cut by the image's edge, low score, or too much unseen floor
    ALIGNED = "aligned"  # the robot already faces the doorway
    TURN = "turn"  # turn by `turn_deg`
    LOST = "lost"  # live use: the tracked doorway or the camera is gone

    @classmethod
    def _missing_(cls, value: object) -> Reason:
        raise CallError(f"reason must be one of {', '.join(cls)}, got {shown(value)}")


@dataclass(frozen=True)
class Frame:
    """One image with the camera that took it.

    >>> image = np.zeros((480, 640, 3), np.uint8)
    >>> Frame(image, Camera.from_fov(640, 480, 60.9), Pose(height_m=0.5)).pose.height_m
    0.5

    Args:
        image: (H, W, 3) uint8 RGB (`from_bgr` for OpenCV's), H and W equal to the camera's.
        camera: intrinsics for this size.
        pose: where the camera sits; default: level, of unknown height.
        stamp_s: time of exposure in seconds, any fixed origin.

    Raises:
        UserError: for an array of another shape or type, or a camera for another size.
    """

    image: NDArray[np.uint8] = field(repr=False)
    camera: Camera
    pose: Pose = field(default_factory=Pose)
    stamp_s: float = 0.0

    def __post_init__(self) -> None:
        require_image("image", self.image)
        require("camera", self.camera, Camera, "a Camera")
        require("pose", self.pose, Pose, "a Pose")
        require_number("stamp_s", self.stamp_s)
        height, width = self.image.shape[:2]
        if (width, height) != (self.camera.width, self.camera.height):
            raise CallError(
                f"the image is {width}x{height} but the camera is for "
                f"{self.camera.width}x{self.camera.height}; use camera.scaled_to(width, height)"
            )


@dataclass(frozen=True)
class ColumnVotes:
    """What a network says of each of N equal strips of columns across the image.

    score: (N,) probability that the strip, at mid-height, looks through an open doorway.
    left_px, right_px: (N,) where that doorway begins and ends, as columns of the whole
    image at mid-height, if there is one here; clipped to the image's edges
    (-0.5 and W - 0.5).
    clear: (N,) probability that the way to that doorway is free, or None if the network
    has no opinion. It is weighed against what the depth shows, never taken alone for seen floor.
    """

    score: FloatArray = field(repr=False)
    left_px: FloatArray = field(repr=False)
    right_px: FloatArray = field(repr=False)
    clear: FloatArray | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        shapes = {self.score.shape, self.left_px.shape, self.right_px.shape}
        if self.clear is not None:
            shapes.add(self.clear.shape)
        if len(shapes) != 1 or self.score.ndim != 1:
            raise ValueError(f"column votes must be (N,) arrays of one length, got {shapes}")


@dataclass(frozen=True)
class RelativeDepth:
    """What a network says of depth up to a scale, or a scale and a shift.

    inverse: (h, w) float32, 1 / depth = gain * inverse + shift; nan = unknown.
    shifted: the shift is unknown, too; else it is 0.
    """

    inverse: NDArray[np.float32] = field(repr=False)
    shifted: bool


@dataclass(frozen=True)
class Perception:
    """What the networks see, before any geometry; UserError for values of another kind.

    >>> Perception(p_open=0.9, network="mine").depth_m is None
    True

    p_open: calibrated probability that an open doorway is in the image.
    columns: votes for openings, or None if the network gives none.
    depth_m: (h, w) float32 metres along the optical axis, covering the whole image at any
        size; nan = unknown. None if the network gives none.
    floor: (h, w) float32 probability of floor, covering the whole image, or None.
    depth_error: relative standard deviation of depth_m within an image, whose scale as a whole may
        be off by more; 0 for true depth.
    bearing_error_deg: by how much a doorway's bearing by these columns is off, as measured on
        images that the network had not seen (68th percentile); None = not measured.
    relative: instead of depth_m where the network knows no metres; `metres.in_metres` does.
    """

    p_open: float
    columns: ColumnVotes | None = field(default=None, repr=False)
    depth_m: NDArray[np.float32] | None = field(default=None, repr=False)
    floor: NDArray[np.float32] | None = field(default=None, repr=False)
    depth_error: float = 0.0
    bearing_error_deg: float | None = None
    relative: RelativeDepth | None = field(default=None, repr=False)
    network: str = "truth"
    timings_ms: Mapping[str, float] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        require_probability("p_open", self.p_open)
        kinds = {"columns": ColumnVotes, "relative": RelativeDepth}
        for name, kind in kinds.items():
            require(name, getattr(self, name), (kind, type(None)), f"{kind.__name__} or None")
        for name in ("depth_m", "floor"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, np.ndarray) and value.ndim == 2):
                raise CallError(f"{name} must be an array (h, w) or None, got {shown(value)}")
        require_number("depth_error", self.depth_error, 0)
        require_number("bearing_error_deg", self.bearing_error_deg, 0, optional=True)

    def range_error_m(self, range_m: float | None) -> float | None:
        """Standard deviation of a doorway's distance from the true one, as it was measured for
        the network's depth; None if there is no distance, or its error is not known."""
        if range_m is None or not self.depth_error:
            return None
        return RANGE_PER_DEPTH_ERROR * self.depth_error * range_m


@dataclass(frozen=True)
class Opening:
    """One candidate doorway as seen from the robot's turning axis; UserError for what is no number.

    >>> Opening(100.0, 200.0, 12.0, 2.0, 7.0, 2.5, score=0.8, cut=None).bearing_deg
    7.0

    left_px, right_px: its columns at mid-height of the image.
    range_m: horizontal distance to the middle of the threshold, None if unknown.
    cut: side of the image that cuts it (None, "left", "right", "both"); its bearing is
        then the middle of the visible part.
    """

    left_px: float
    right_px: float
    left_deg: float
    right_deg: float
    bearing_deg: float
    range_m: float | None
    score: float
    cut: str | None

    def __post_init__(self) -> None:
        for name in ("left_px", "right_px", "left_deg", "right_deg", "bearing_deg", "score"):
            require_number(name, getattr(self, name))
        require_number("range_m", self.range_m, optional=True)
        if self.cut not in _CUTS:
            raise CallError(f"cut must be left, right, both or None, got {shown(self.cut)}")

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        keys = ("left_deg", "right_deg", "bearing_deg", "range_m", "score", "cut")
        return {key: getattr(self, key) for key in (*keys, "left_px", "right_px")}


@dataclass(frozen=True)
class Selection:
    """Where to go by geometry alone, before the gates.

    openings: candidates, best first (of `paper`: the one run of equal depth).
    pixel: (row, column) aimed at, in the image's pixels, or None.
    clear: True, False, or None if the floor was not seen at all.
    floor_from_m: horizontal distance from which on the floor is in view, None if not seen.
    unsure: why the geometry would abstain, in words, or None; `look` is then the side to
        look to ("left", "right") or None.
    evidence: method-specific numbers: the paper's pixels, or the way's (corridor, obstacle).
    """

    bearing_deg: float | None
    range_m: float | None
    pixel: tuple[int, int] | None
    clear: bool | None
    floor_from_m: float | None = None
    openings: tuple[Opening, ...] = ()
    unsure: str | None = None
    look: str | None = None
    evidence: Mapping[str, Any] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Decision:
    """The answer for one image: printed it is one line, and `to_dict` is the JSON contract.

    >>> line = {"method": "opening", "network": "doornet", "p_open": 0.02, "reason": "no_door"}
    >>> decision = Decision.from_dict(line)
    >>> print(decision)
    no open door 0.02 · stay
    >>> decision.turn_deg is None
    True

    reason: why to turn, or why not. turn_deg: by how much, + left; None unless `turn` or `aligned`.
    p_open: calibrated probability of an open doorway; open: whether that is enough.
    selection, perception, frame: what it follows from. timings_ms: of each stage.
    """

    reason: Reason
    turn_deg: float | None
    p_open: float
    open: bool
    selection: Selection = field(repr=False)
    perception: Perception = field(repr=False)
    frame: Frame = field(repr=False)
    method: str
    timings_ms: Mapping[str, float] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reason", Reason(self.reason))
        require_number("turn_deg", self.turn_deg, optional=True)
        require_probability("p_open", self.p_open)
        for name, kind in (("selection", Selection), ("perception", Perception), ("frame", Frame)):
            require(name, getattr(self, name), kind, f"a {kind.__name__}")

    def __str__(self) -> str:
        """One line: "open door 0.94 · 12.4 deg left · 2.8 m · way free · turn left 12.4 deg"."""
        return " · ".join(_told(self))

    @property
    def bearing_deg(self) -> float | None:
        """Of the best opening, whether or not to turn there; None without an open doorway."""
        return None if self.reason is Reason.NO_DOOR else self.selection.bearing_deg

    def to_dict(self, image: str | None = None) -> dict[str, Any]:
        """Plain values for JSON; `image` is the image's name as it was given, left out if None.

        Without an open doorway there is no way to speak of: bearing, range, clear and pixel are
        None, and `openings` still lists the candidates.
        """
        found, camera = self.selection, self.frame.camera
        door = self.reason is not Reason.NO_DOOR
        named: dict[str, Any] = {} if image is None else {"image": image}
        answer: dict[str, Any] = {
            **named,
            "method": self.method,
            "network": self.perception.network,
            "camera": {"name": camera.name, "assumed": camera.assumed},
            "p_open": float(self.p_open),
            "open": bool(self.open),
            "reason": str(self.reason),
            "turn_deg": self.turn_deg,
            "bearing_deg": self.bearing_deg,
            "range_m": found.range_m if door else None,
            "clear": found.clear if door else None,
            "floor_from_m": found.floor_from_m,
            "look": found.look if self.reason is Reason.UNSURE else None,
            "openings": [opening.to_dict() for opening in found.openings],
            "pixel": list(found.pixel) if door and found.pixel is not None else None,
            "timings_ms": {stage: float(ms) for stage, ms in self.timings_ms.items()},
        }
        if self.method == "paper":
            evidence = found.evidence if door else {}
            for key in _PAPER_PIXELS:
                pixel = evidence.get(key)
                answer[key] = None if pixel is None else list(pixel)
            for key in _PAPER_DEPTHS:
                answer[key] = evidence.get(key)
        return answer

    @classmethod
    def from_dict(cls, answer: Mapping[str, Any]) -> Decision:
        """The decision that `to_dict` wrote; its frame is one black pixel, for no image is kept.

        Args:
            answer: a line of `3ds look --json`, or a part of one with at least `reason`.

        Returns:
            A decision whose `to_dict` is `answer`, but for the image's name.

        Raises:
            UserError: for a reason that is missing or does not exist, an opening that is not whole,
                or a value of another kind.
        """
        require("answer", answer, Mapping, "a mapping, as to_dict returns it")
        if "reason" not in answer:
            raise CallError(
                f"answer must have a reason, got only {', '.join(map(str, answer)) or 'nothing'}"
            )
        camera = answer.get("camera") or {"name": "unknown", "assumed": True}
        if not isinstance(camera, Mapping) or not {"name", "assumed"} <= camera.keys():
            raise CallError(f"camera must have a name and assumed, got {shown(camera)}")
        openings = answer.get("openings") or ()
        try:
            found = tuple(Opening(**opening) for opening in openings)
        except TypeError as error:
            raise CallError(f"openings must each be whole: {error}") from error
        for key in ("bearing_deg", "range_m", "floor_from_m", *_PAPER_DEPTHS):
            require_number(key, answer.get(key), optional=True)
        for key in ("pixel", *_PAPER_PIXELS):
            require_pixel(key, answer.get(key))
        timings = answer.get("timings_ms") or {}
        require("timings_ms", timings, Mapping, "a mapping of milliseconds")
        for stage, spent in timings.items():
            require_number(f"timings_ms {stage}", spent)
        pixel = answer.get("pixel")
        row_column = None if pixel is None else (int(pixel[0]), int(pixel[1]))
        evidence = {key: answer.get(key) for key in _PAPER_PIXELS + _PAPER_DEPTHS if key in answer}
        p_open = answer.get("p_open", math.nan)
        require_probability("p_open", p_open)
        one = Camera(camera["name"], 1, 1, 1.0, 1.0, 0.0, 0.0, assumed=bool(camera["assumed"]))
        return cls(
            reason=answer["reason"],
            turn_deg=answer.get("turn_deg"),
            p_open=p_open,
            open=bool(answer.get("open", p_open >= 0.5)),
            selection=Selection(
                bearing_deg=answer.get("bearing_deg"),
                range_m=answer.get("range_m"),
                pixel=row_column,
                clear=answer.get("clear"),
                floor_from_m=answer.get("floor_from_m"),
                openings=found,
                look=answer.get("look"),
                evidence=evidence,
            ),
            perception=Perception(p_open, network=str(answer.get("network", "unknown"))),
            frame=Frame(np.zeros((1, 1, 3), np.uint8), one),
            method=str(answer.get("method", "opening")),
            timings_ms=dict(timings),
        )


_CUTS = (None, "left", "right", "both")
_PAPER_PIXELS = ("max_pixel", "best_pixel", "trigger_pixel")
_PAPER_DEPTHS = ("max_depth", "best_depth")


def _told(decision: Decision) -> Iterator[str]:
    """The parts of a decision in words."""
    found, reason = decision.selection, decision.reason
    yield f"{'open' if decision.open else 'no open'} door {decision.p_open:.2f}"
    if reason is not Reason.NO_DOOR:
        if found.bearing_deg is not None:
            yield _turned(found.bearing_deg)
        yield "distance unknown" if found.range_m is None else f"{found.range_m:.1f} m"
        yield {True: "way free", False: "way blocked", None: "way not seen"}[found.clear]
    if reason is Reason.TURN and decision.turn_deg is not None:
        side = "left" if decision.turn_deg > 0 else "right"
        yield f"turn {side} {abs(decision.turn_deg):.1f} deg"
    elif reason is Reason.ALIGNED:
        yield "facing it"
    elif reason is Reason.UNSURE:
        yield f"unsure: {found.unsure or 'no bearing'}"
        yield f"look {found.look}" if found.look else "stay"
    elif reason is Reason.LOST:
        yield "lost"
    else:
        yield "stay"
    camera = decision.frame.camera
    if camera.assumed and camera.name != "unknown":
        named = camera.name.startswith("assumed")
        yield f"camera {camera.name if named else f'assumed ({camera.name})'}"


def _turned(bearing_deg: float) -> str:
    if abs(bearing_deg) < 0.05:
        return "straight ahead"
    return f"{abs(bearing_deg):.1f} deg {'left' if bearing_deg > 0 else 'right'}"
