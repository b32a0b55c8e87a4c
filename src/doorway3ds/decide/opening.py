"""The `opening` method: from opening columns, depth and floor to where to turn.

An opening's bearing is the ray through the pixel at the middle of its two columns at the
image's mid-height, by the camera's calibration and pose, about the robot's turning axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from doorway3ds.camera.model import bearing_of_pixel, pixel_to_ray
from doorway3ds.decide.scene.clearance import Clearance, ClearanceParams, look_down, sweep
from doorway3ds.decide.scene.floor import FloorParams, Scene, build_scene
from doorway3ds.decide.scene.sill import ThresholdParams, Walls, locate_threshold, see_walls
from doorway3ds.types import ColumnVotes, Frame, Opening, Perception, Selection

Span = tuple[float, float, float]


@dataclass(frozen=True)
class OpeningParams:
    """Limits of the selection; a network's metadata may carry its own.

    min_score: a strip below it is no candidate.
    sure_score: below it the best opening is only a guess: unsure.
    same_iou: strips whose spans overlap by more belong to one opening.
    edge_fraction: of the image's width within which an edge counts as cut by the image.
    face_margin_deg: turned by a cut opening's bearing, the robot's side must clear the visible
        jamb by this much.
    assumed_range_m: for that check, where the range is unknown.
    """

    min_score: float = 0.05
    sure_score: float = 0.3
    same_iou: float = 0.5
    edge_fraction: float = 0.01
    face_margin_deg: float = 2.0
    assumed_range_m: float = 1.5
    floor: FloorParams = field(default_factory=FloorParams)
    threshold: ThresholdParams = field(default_factory=ThresholdParams)
    clearance: ClearanceParams = field(default_factory=ClearanceParams)


def columns_from_spans(
    spans: Sequence[tuple[float, float]], width: int, n: int = 64
) -> ColumnVotes:
    """Perfect votes for openings (left_px, right_px): what a network is trained to say.

    Strips outside every opening score 0 and vote for their own centre.
    """
    centre = (np.arange(n) + 0.5) * width / n - 0.5
    score = np.zeros(n)
    left, right = centre.copy(), centre.copy()
    for low, high in spans:
        low, high = max(low, -0.5), min(high, width - 0.5)
        if high <= low:
            continue
        inside = (centre >= low) & (centre <= high) & (score == 0)
        if not inside.any():  # narrower than a strip: the strip that holds its middle
            inside = np.arange(n) == np.argmin(np.abs(centre - (low + high) / 2))
        score[inside], left[inside], right[inside] = 1.0, low, high
    return ColumnVotes(score, left, right)


def decode_columns(
    votes: ColumnVotes, width: int, min_score: float = 0.05, same_iou: float = 0.5
) -> list[Span]:
    """Openings (left_px, right_px, score) from column votes, best first.

    The best strip gathers all strips whose spans overlap its own by `same_iou`; the opening's
    edges are the score-weighted mean of their votes, which is finer than a strip. What is left
    inside it, or overlaps it by a third of the narrower of the two, is dropped, and the next best
    strip begins the next opening.
    """
    score = np.nan_to_num(np.asarray(votes.score, dtype=np.float64))
    left = np.clip(np.asarray(votes.left_px, dtype=np.float64), -0.5, width - 0.5)
    right = np.clip(np.asarray(votes.right_px, dtype=np.float64), -0.5, width - 0.5)
    centre = (np.arange(score.size) + 0.5) * width / max(score.size, 1) - 0.5
    free = (score >= min_score) & (right > left)
    found: list[Span] = []
    while free.any():
        seed = int(np.argmax(np.where(free, score, -1.0)))
        overlap = np.minimum(right, right[seed]) - np.maximum(left, left[seed])
        union = np.maximum(right, right[seed]) - np.minimum(left, left[seed])
        group = free & (overlap >= same_iou * union)
        weight = score[group]
        low = float(weight @ left[group] / weight.sum())
        high = float(weight @ right[group] / weight.sum())
        found.append((low, high, float(weight @ weight / weight.sum())))
        shared = np.minimum(right, high) - np.maximum(left, low)
        narrower = np.minimum(right - left, high - low)
        free &= ~group & ~((centre >= low) & (centre <= high)) & (shared < narrower / 3)
    return sorted(found, key=lambda span: (-span[2], span[0] - span[1]))


def select_opening(
    perception: Perception, frame: Frame, params: OpeningParams | None = None
) -> Selection:
    """Ranked openings with bearing and range, the way to the best one, and whether to abstain."""
    params = params or OpeningParams()
    if perception.columns is None:
        return Selection(
            None, None, None, None, unsure=f"{perception.network} returns no opening columns"
        )
    scene = build_scene(perception, frame, params.floor)
    spans = decode_columns(
        perception.columns, frame.camera.width, params.min_score, params.same_iou
    )
    walls = None if scene is None else see_walls(scene, params.threshold)
    openings = tuple(_opening(span, scene, walls, frame, params) for span in spans)
    if not openings:
        return Selection(None, None, None, None, unsure="no opening is found in the columns")

    best = openings[0]
    passing_deg = _passing_bearing(best, params)
    way: Clearance | None = None
    if scene is not None:
        vote = way_vote(perception.columns, best.left_px, best.right_px, frame.camera.width)
        way = sweep(scene, frame.camera, passing_deg, best.range_m, params.clearance, vote)
    unsure, look = _doubt(best, passing_deg, params)
    return Selection(
        bearing_deg=best.bearing_deg,
        range_m=best.range_m,
        pixel=(round((frame.camera.height - 1) / 2), round((best.left_px + best.right_px) / 2)),
        clear=None if way is None else way.clear,
        floor_from_m=None if way is None else way.floor_from_m,
        openings=openings,
        unsure=unsure,
        look=look,
        evidence={} if way is None else way.evidence(),
    )


def way_below(
    perception: Perception,
    frame: Frame,
    bearing_deg: float,
    range_m: float | None,
    params: OpeningParams | None = None,
) -> bool | None:
    """Whether a way is free in an image taken with the head down along it; None: unknown."""
    params = params or OpeningParams()
    scene = build_scene(perception, frame, params.floor)
    if scene is None:
        return None
    return look_down(scene, frame.camera, bearing_deg, range_m, params.clearance).clear


def way_vote(votes: ColumnVotes, left_px: float, right_px: float, width: int) -> float | None:
    """The network's own probability that the way to an opening is free: its strips' mean."""
    if votes.clear is None:
        return None
    centre = (np.arange(votes.score.size) + 0.5) * width / votes.score.size - 0.5
    weight = np.where((centre >= left_px) & (centre <= right_px), votes.score, 0.0)
    if not weight.any():  # narrower than a strip
        nearest = np.abs(centre - (left_px + right_px) / 2).argmin()
        weight = np.where(np.arange(centre.size) == nearest, 1.0, 0.0)
    return float(weight @ votes.clear / weight.sum())


def _opening(
    span: Span, scene: Scene | None, walls: Walls | None, frame: Frame, params: OpeningParams
) -> Opening:
    """One span with its bearings and the range to its threshold."""
    camera, pose = frame.camera, frame.pose
    left, right, score = span
    slack = params.edge_fraction * camera.width
    cut_left, cut_right = left <= -0.5 + slack, right >= camera.width - 0.5 - slack
    cut = {(1, 0): "left", (0, 1): "right", (1, 1): "both"}.get((int(cut_left), int(cut_right)))
    row = (camera.height - 1) / 2
    pixels = np.array([[left, row], [(left + right) / 2, row], [right, row]])
    range_m: float | None = None
    if scene is not None and walls is not None:
        edges = pixel_to_ray(camera, pixels) @ scene.turn.T
        jambs = (not cut_left, not cut_right)
        middle = locate_threshold(scene, walls, edges, jambs, params.threshold)
        range_m = None if middle is None else float(np.hypot(*middle))
    left_deg, bearing, right_deg = bearing_of_pixel(camera, pose, pixels, range_m)
    return Opening(
        left, right, float(left_deg), float(right_deg), float(bearing), range_m, score, cut
    )


def _passing_bearing(best: Opening, params: OpeningParams) -> float:
    """The bearing nearest to the opening's own at which the robot passes its visible jamb.

    It differs from the opening's own only where the image cuts it: the doorway goes on beyond
    the image's edge, so the visible middle may lie too near the one jamb in view.
    """
    if best.cut not in ("left", "right"):
        return best.bearing_deg
    distance = best.range_m or params.assumed_range_m
    half = math.degrees(math.asin(min(1.0, params.clearance.width_m / 2 / distance)))
    room = half + params.face_margin_deg
    if best.cut == "left":
        return max(best.bearing_deg, best.right_deg + room)
    return min(best.bearing_deg, best.left_deg - room)


def _doubt(
    best: Opening, passing_deg: float, params: OpeningParams
) -> tuple[str | None, str | None]:
    """Why the best opening's bearing should not be acted on, and the side to look to."""
    if passing_deg != best.bearing_deg:
        return f"the opening is cut by the image's {best.cut} edge", best.cut
    if best.score < params.sure_score:
        side = "left" if best.bearing_deg > 0 else "right"
        return f"the best opening scores only {best.score:.2f}", side
    return None, None
