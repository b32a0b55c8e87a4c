"""What is really in an image of a simulated home: openings, floor, free path, door states.

And the same as a network that makes no mistakes would report it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, grid_rays, pixel_to_ray, rotation, wrapped_deg
from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.errors import UserError
from doorway3ds.lab.sim.homes.apartment import Portal
from doorway3ds.lab.sim.homes.furnish import Furnished
from doorway3ds.lab.sim.homes.hazards import beyond
from doorway3ds.lab.sim.homes.plan import LOW_M, Plan
from doorway3ds.lab.sim.homes.shell import Leaf, leaf_of
from doorway3ds.lab.sim.pictures.way import Way, way_to
from doorway3ds.lab.sim.render.renderer import Eye
from doorway3ds.types import Perception

Float = NDArray[np.float64]
FLOOR_M = 0.012  # rugs and thresholds are floor
# Less than this is a glimpse that nobody would call a seen doorway.
LEAST_WIDTH = 0.025  # of the image's width
LEAST_AREA = 0.004  # of the image
LEAST_STEPS = 0.008  # of the image
STANDING_STATES = ("wardrobe", "closet", "person", "pet")
LEAST_OBSTACLE = 0.001  # of the image
SEEN_ENOUGH = 0.25  # of what the image shows of the opening, column by column
WIDTH_M, HEIGHT_M = 0.28, 1.3  # what must pass: NAO's width, and what is in its way


@dataclass(frozen=True)
class OpeningTruth:
    """One open doorway as the image shows it; see docs/sim.md for the exact meaning.

    left_px, right_px: at mid-height, by what is seen through it, cut at the image's edge.
    bearing_deg, range_m: where the ray through the middle column meets the threshold, from the
        turning axis.
    jambs_deg: (left, right) bearings of the whole free opening from the lens.
    way: what lies between the turning axis and the sill, by the plan.
    clear: the same as far as the image shows it; None for a grazing way too.
    obstacle: share of the image that shows what stands in the way.
    beyond: threshold, step or stairs at or close behind the sill; they do not block.
    seen: share of the opening within the image that is not hidden.
    """

    portal: int
    state: str
    left_px: float
    right_px: float
    left_deg: float
    right_deg: float
    bearing_deg: float
    range_m: float
    jambs_deg: tuple[float, float]
    cut: str | None
    seen: float
    area: float
    way: Way
    clear: bool | None
    confidence: int
    obstacle: float = 0.0
    beyond: tuple[str, ...] = ()


@dataclass(frozen=True)
class Truth:
    """openings: seen and open, biggest first. glimpse: one is seen, but too little to count.

    states: what doors, windows and mirrors of the room the image shows, nearest first.
    """

    openings: tuple[OpeningTruth, ...]
    floor: NDArray[np.bool_]
    glimpse: bool
    states: tuple[str, ...]


def _wall_frame(portal: Portal, vectors: Float, origin: bool) -> Float:
    """Plan vectors (or points) as (along, across, up) of a portal's wall."""
    along, across = (1, 0) if portal.axis == 0 else (0, 1)
    out = np.stack([vectors[..., along], vectors[..., across], vectors[..., 2]], -1)
    if origin:
        out = out - np.array([portal.at, portal.wall, 0.0])
    return out


def _hidden_by_leaf(leaf: Leaf, lens: Float, rays: Float, reach: Float) -> NDArray[np.bool_]:
    """Pixels whose ray meets the leaf within its reach (glazed leaves too)."""
    d = np.array([leaf.direction[0], leaf.direction[1], 0.0])
    n = np.array([-d[1], d[0], 0.0])
    offset = np.array([leaf.x, leaf.y, 0.0]) - lens
    hidden = np.zeros(reach.shape, bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for face in (-0.02, 0.0, 0.02):
            at = (offset @ n + face) / (rays @ n)
            along = at * (rays @ d) - offset @ d
            high = lens[2] + at * rays[..., 2]
            on = (np.abs(along) <= leaf.length / 2) & (high <= leaf.height)
            hidden |= on & (at > 0) & (at <= reach)
    return hidden


def _runs(mask: NDArray[np.bool_], gap: int) -> list[tuple[int, int]]:
    """Runs (first, last) of True, joined over at most `gap` False."""
    where = np.flatnonzero(mask)
    if len(where) == 0:
        return []
    breaks = np.flatnonzero(np.diff(where) > gap + 1)
    firsts = where[np.concatenate([[0], breaks + 1])]
    lasts = where[np.concatenate([breaks, [len(where) - 1]])]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


class _View:
    """Rays and points of one image in the plan."""

    def __init__(self, camera: Camera, eye: Eye, depth: NDArray[np.float32]) -> None:
        self.camera, self.eye = camera, eye
        self.lens = eye.lens()
        rays = grid_rays(camera)
        self.rays = rays @ eye.axes().T
        self.depth = np.where(np.isnan(depth), 1e3, depth).astype(np.float64)
        self.points = self.lens + self.depth[..., None] * self.rays
        turned = rays @ rotation(eye.pose).T
        self.azimuth = np.degrees(np.arctan2(turned[..., 1], turned[..., 0]))
        columns = np.linspace(-0.5, camera.width - 0.5, 2 * camera.width + 1)
        row = np.full_like(columns, (camera.height - 1) / 2)
        middle = pixel_to_ray(camera, np.stack([columns, row], -1)) @ rotation(eye.pose).T
        self.columns = columns[::-1]
        self.middle = np.degrees(np.arctan2(middle[:, 1], middle[:, 0]))[::-1]

    def on_ground(self) -> Float:
        """Plan points (H, W, 2) where the rays meet the floor's plane; nan above the horizon."""
        down = self.rays[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            fall = np.where(down < 0, self.lens[2] / -down, np.nan)
        return np.asarray(self.lens[:2] + fall[..., None] * self.rays[..., :2])

    def azimuth_of(self, plan: Float) -> float:
        """Bearing of a plan point (x, y) from the lens, about its robot's heading."""
        d = plan[:2] - self.lens[:2]
        angle = np.degrees(np.arctan2(d[1], d[0])) - self.eye.heading_deg
        return float(wrapped_deg(angle))

    def azimuth_at(self, column: float) -> float:
        return float(np.interp(column, self.columns[::-1], self.middle[::-1]))

    def column(self, azimuth: float) -> float:
        return float(np.interp(azimuth, self.middle, self.columns))


def _through(
    furnished: Furnished, view: _View, portal: Portal
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Pixels inside the opening, and those of them that look through it."""
    home = furnished.home
    lens = _wall_frame(portal, view.lens, True)
    rays = _wall_frame(portal, view.rays, False)
    side = 1.0 if lens[1] > 0 else -1.0
    low, high = portal.free
    inside = np.ones(view.depth.shape, bool)
    past = np.zeros_like(view.depth)
    with np.errstate(divide="ignore", invalid="ignore"):
        for across in (side * home.wall_m / 2, -side * home.wall_m / 2):
            past = (across - lens[1]) / rays[..., 1]
            along = lens[0] + past * rays[..., 0]
            up = lens[2] + past * rays[..., 2]
            inside &= (past > 0) & (along > low) & (along < high)
            inside &= (up > portal.sill) & (up < portal.height)
    seen = inside & (view.depth > past - 0.01)
    for other in furnished.home.portals:
        # A neighbour's leaf hides the opening as well, but not from behind it.
        leaf = leaf_of(home, other)
        if leaf is not None and set(other.rooms) & set(portal.rooms):
            reach = view.depth + 0.03
            if other is not portal:
                reach = np.minimum(reach, past)
            seen &= ~_hidden_by_leaf(leaf, view.lens, view.rays, reach)
    return inside, seen


def _jambs(home_wall_m: float, portal: Portal, view: _View) -> tuple[float, float]:
    """(left, right) bearings between which the opening is free, both faces of the wall counted."""
    faces = (-home_wall_m / 2, home_wall_m / 2)
    ends = [
        [view.azimuth_of(np.array(portal.point(along, across))) for across in faces]
        for along in portal.free
    ]
    left, right = sorted(ends, key=np.mean, reverse=True)
    return min(left), max(right)


def _opening(plan: Plan, view: _View, index: int, room: int) -> OpeningTruth | None:
    furnished, camera = plan.furnished, view.camera
    home = furnished.home
    portal = home.portals[index]
    inside, seen = _through(furnished, view, portal)
    if seen.sum() < 12:
        return None
    step = (view.middle[-1] - view.middle[0]) / camera.width
    left, right = _jambs(home.wall_m, portal, view)
    lowest = float(view.azimuth.min())
    bins = ((view.azimuth - lowest) / step).astype(int)
    size = int(bins.max()) + 1
    whole = np.bincount(bins[inside], minlength=size)
    through = np.bincount(bins[seen], minlength=size)
    good = (through >= np.maximum(2, SEEN_ENOUGH * whole)) & (whole > 0)
    # A person or a lamp before an opening does not make it two.
    runs = _runs(good, int(0.25 * (left - right) / step))
    if not runs:
        return None
    first, last = max(runs, key=lambda r: int(through[r[0] : r[1] + 1].sum()))
    seen_right, seen_left = lowest + first * step, lowest + (last + 1) * step
    seen_right = right if abs(seen_right - right) < 1.6 * step else seen_right
    seen_left = left if abs(seen_left - left) < 1.6 * step else seen_left
    edge_right, edge_left = float(view.middle[0]), float(view.middle[-1])
    cut_left, cut_right = left > edge_left + 0.3 * step, right < edge_right - 0.3 * step
    if cut_left and seen_left > edge_left - 1.6 * step:
        seen_left = edge_left
    if cut_right and seen_right < edge_right + 1.6 * step:
        seen_right = edge_right
    seen_left, seen_right = min(seen_left, edge_left), max(seen_right, edge_right)
    if seen_left - seen_right < step:
        return None
    left_px, right_px = view.column(seen_left), view.column(seen_right)
    middle = view.azimuth_at((left_px + right_px) / 2)
    target = _on_wall(portal, view, middle)
    if target is None:
        return None
    start = np.array([view.eye.x, view.eye.y])
    to = target - start
    bearing = np.degrees(np.arctan2(to[1], to[0])) - view.eye.heading_deg
    cuts = (cut_left and seen_left == edge_left, cut_right and seen_right == edge_right)
    cut = {(True, True): "both", (True, False): "left", (False, True): "right"}.get(cuts)
    area = float(seen.mean())
    share = float(seen.sum() / max(inside.sum(), 1))
    width = (right_px - left_px) / camera.width
    sure = 3 if width > 0.05 and share > 0.35 and area > 0.012 else 2
    # A wide passage, or one of which a single jamb is seen, is a matter of taste.
    if portal.state == "archway" and (portal.width > 1.6 or cut is not None):
        sure = min(sure, 2)
    way = way_to(plan, start, target, portal, WIDTH_M)
    on_floor, obstacle = _on_the_way(view, target, portal)
    clear: bool | None = None
    if way is Way.FREE and on_floor > 0:
        clear = True
    if way is Way.BLOCKED and obstacle >= LEAST_OBSTACLE:
        clear = False
    return OpeningTruth(
        index,
        portal.state,
        left_px,
        right_px,
        seen_left,
        seen_right,
        float(wrapped_deg(bearing)),
        float(np.hypot(*to)),
        (left, right),
        cut,
        share,
        area,
        way,
        clear,
        sure,
        obstacle,
        beyond(home, portal, room),
    )


def _on_wall(portal: Portal, view: _View, azimuth: float) -> Float | None:
    """Where a bearing from the lens meets the middle of the threshold's wall, in the plan."""
    angle = np.radians(azimuth + view.eye.heading_deg)
    direction = np.array([np.cos(angle), np.sin(angle)])
    axis = portal.axis
    if abs(direction[axis]) < 1e-6:
        return None
    reach = (portal.wall - view.lens[axis]) / direction[axis]
    return np.asarray(view.lens[:2] + reach * direction) if reach > 0 else None


def _on_the_way(view: _View, target: Float, portal: Portal) -> tuple[float, float]:
    """Shares of the image that show floor, and obstacles or drops, on the way to the sill."""
    start = np.array([view.eye.x, view.eye.y])
    run = target - start
    length = float(np.hypot(*run))
    ahead = run / max(length, 1e-9)
    side = start[portal.axis] - portal.wall

    def within(plan_points: Float) -> NDArray[np.bool_]:
        off = plan_points - start
        forward, aside = off @ ahead, off @ np.array([-ahead[1], ahead[0]])
        before = (plan_points[..., portal.axis] - portal.wall) * side > 0
        strip = (forward > 0) & (forward < length) & (np.abs(aside) < WIDTH_M / 2)
        return np.asarray(strip & before)

    z = view.points[..., 2]
    strip = within(view.points[..., :2])
    high = strip & (z > LOW_M) & (z < HEIGHT_M)
    drop = within(view.on_ground()) & (z < -LOW_M)
    return float((strip & (np.abs(z) < FLOOR_M)).mean()), float((high | drop).mean())


def _states(furnished: Furnished, view: _View, room: int) -> tuple[str, ...]:
    """Closed doors, windows, mirrors, stairs, people and tall furniture of the room in view."""
    half = (view.middle[-1] - view.middle[0]) / 2
    found: list[tuple[float, str]] = []
    targets = [(p.point(0.0), p.state) for p in furnished.home.portals_of(room)]
    targets += [((m.x, m.y), "mirror") for m in furnished.mirrors if m.room == room]
    targets += [
        ((p.x, p.y), p.item.name)
        for p in furnished.standing
        if p.room == room and p.item.name in STANDING_STATES
    ]
    z = view.points[..., 2]
    for flight in furnished.home.flights:
        # The shaft of steps down is seen below the floor, or not at all.
        level = z < -LOW_M if flight.rise_m < 0 else (z > LOW_M) & (z < flight.end_m + FLOOR_M)
        if flight.room == room and (flight.holds(view.points) & level).mean() > LEAST_STEPS:
            targets.append((flight.start, flight.kind))
    for at, state in targets:
        if abs(view.azimuth_of(np.array(at))) < half * 0.95:
            distance = float(np.hypot(at[0] - view.lens[0], at[1] - view.lens[1]))
            found.append((distance, state))
    return tuple(state for _, state in sorted(found))


def truth_of(plan: Plan, camera: Camera, eye: Eye, depth: NDArray[np.float32]) -> Truth:
    """Truth of one image from its plan and its exact depth (H, W), nan for the sky."""
    furnished = plan.furnished
    view = _View(camera, eye, depth)
    floor = (np.abs(view.points[..., 2]) < FLOOR_M) & ~np.isnan(depth)
    room = furnished.home.room_at(float(view.lens[0]), float(view.lens[1]))
    if room is None:
        return Truth((), floor, False, ())  # outdoors no doorway of a room is faced
    found = []
    for index, portal in enumerate(furnished.home.portals):
        if portal.is_open and room.index in portal.rooms:
            opening = _opening(plan, view, index, room.index)
            if opening is not None:
                found.append(opening)
    width = camera.width
    wide = [o for o in found if (o.right_px - o.left_px) / width >= LEAST_WIDTH]
    counted = sorted((o for o in wide if o.area >= LEAST_AREA), key=lambda o: -o.area)
    states = _states(furnished, view, room.index)
    return Truth(tuple(counted), floor, len(counted) < len(found), states)


def perfect(truth: Truth, depth_m: NDArray[np.float32]) -> Perception:
    """What a network that makes no mistakes would say; depth_m: (H, W), of the whole image."""
    spans = [(o.left_px, o.right_px) for o in truth.openings]
    return Perception(
        p_open=float(bool(spans)),
        columns=columns_from_spans(spans, depth_m.shape[1]),
        depth_m=depth_m,
        floor=truth.floor.astype(np.float32),
    )


class TruthNetwork:
    """The last image's truth as a network; seen: returns it with the depth, None before a look."""

    name = "truth"
    gives = frozenset({"p_open", "columns", "depth", "floor"})

    def __init__(self, seen: Callable[[], tuple[Truth, NDArray[np.float32]] | None]) -> None:
        self._seen = seen

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        seen = self._seen()
        if seen is None:
            raise UserError("network truth knows only images of its source")
        return perfect(*seen)
