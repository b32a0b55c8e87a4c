"""The built parts of a home: walls with their holes, door frames and leaves, windows, balcony."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.homes.apartment import Home, Portal, Room, WallSpan
from doorway3ds.lab.sim.homes.furniture import SIDES, Part, X, Y, Z
from doorway3ds.lab.sim.homes.mesh import Mesh, box, extrude, rod, rounded_box, sheet, steps

LINING_M = 0.025
LEAF_M = 0.04
INWARD = (X, -X, Y, -Y)


def wall_face(home: Home, room: Room, span: WallSpan) -> tuple[NDArray[np.float64], float, float]:
    """Lower start corner of a room's wall face, its length, and the plan start along the wall."""
    x0, y0, x1, y1 = room.inner(home.wall_m)
    corner = ((x0, y0), (x1, y0), (x0, y0), (x0, y1))[span.side]
    length = (y1 - y0) if span.side < 2 else (x1 - x0)
    return np.array([*corner, 0.0]), length, y0 if span.side < 2 else x0


def wall_mesh(home: Home, room: Room, span: WallSpan, pitch: float = 0.45) -> Mesh:
    """A room's wall face with its holes cut out; uv in metres (along, up)."""
    start, length, begin = wall_face(home, room, span)
    along = Y if span.side < 2 else X
    us, vs = list(steps(0, length, pitch)), list(steps(0, home.ceiling_m, pitch))
    holes = []
    for p in span.holes:
        pad = LINING_M
        a, b = p.at - begin - p.width / 2 - pad, p.at - begin + p.width / 2 + pad
        low = p.sill - pad if p.sill > 0 else 0.0
        holes.append((max(a, 0.0), min(b, length), low, min(p.height + pad, home.ceiling_m)))
        us += [max(a, 0.0), min(b, length)]
        vs += [low, min(p.height + pad, home.ceiling_m)]
    u = np.unique(np.round(us, 6))
    v = np.unique(np.round(vs, 6))
    face = sheet(start, along, Z, u, v, INWARD[span.side])
    middle = face.uv[face.faces].mean(axis=1)
    keep = np.ones(len(middle), bool)
    for a, b, low, high in holes:
        keep &= ~(
            (middle[:, 0] > a) & (middle[:, 0] < b) & (middle[:, 1] > low) & (middle[:, 1] < high)
        )
    return Mesh(face.vertices, face.normals, face.uv, face.faces[keep])


def _in_wall(portal: Portal, mesh: Mesh) -> Mesh:
    """From the portal's frame (x along the wall, y across it, z up) to the plan."""
    if portal.axis == 1:
        return mesh.moved((portal.at, portal.wall, 0.0))
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    flipped = mesh.turned(swap)
    return Mesh(
        flipped.vertices + np.array([portal.wall, portal.at, 0.0]),
        flipped.normals,
        flipped.uv,
        flipped.faces[:, ::-1],
    )


@dataclass(frozen=True)
class Leaf:
    """A door leaf in the plan: a thin upright box, its middle, direction and size."""

    x: float
    y: float
    direction: tuple[float, float]
    length: float
    height: float


def leaf_of(home: Home, portal: Portal) -> Leaf | None:
    """The hinged leaf of a portal, or None."""
    if portal.state not in ("open", "half", "closed", "glass_closed"):
        return None
    angle = np.radians(portal.angle_deg)
    run = np.array([-portal.hinge * np.cos(angle), portal.swing * np.sin(angle)])
    # The leaf's body lies on the opening's side of the face it turns about.
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if portal.hinge * portal.swing > 0:
        turn = turn.T
    body = turn @ np.array([0.0, -portal.swing])
    pivot = np.array([portal.hinge * portal.width / 2, portal.swing * home.wall_m / 2])
    length = portal.width - 0.006
    middle = pivot + run * length / 2 + body * LEAF_M / 2
    x, y = portal.point(float(middle[0]), float(middle[1]))
    direction = (run[1], run[0]) if portal.axis == 0 else (run[0], run[1])
    return Leaf(x, y, (float(direction[0]), float(direction[1])), length, portal.height - 0.006)


def _bars(
    w: float, h: float, bar: float, t: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> list[Mesh]:
    """A frame of bars, w by h: two upright, then two across; at: the middle of its lower edge."""
    x, y, z = at
    upright = [box((bar, t, h), (x + s * (w - bar) / 2, y, z + h / 2)) for s in SIDES]
    return upright + [box((w, t, bar), (x, y, z + k)) for k in (bar / 2, h - bar / 2)]


def leaf_parts(leaf: Leaf, style: int, paint: str) -> list[Part]:
    """A leaf with panels, a glazed field or all of glass, and handles on both sides."""
    yaw = float(np.degrees(np.arctan2(leaf.direction[1], leaf.direction[0])))
    w, h, t = leaf.length, leaf.height, LEAF_M
    parts: list[Part] = []
    if style == 5:
        rail = 0.11
        parts += [(paint, box((rail, t, h), (s * (w - rail) / 2, 0, h / 2))) for s in SIDES]
        across = (t, 0.12, h - 0.06), (t, 0.7, 0.35), (t * 0.6, 0.03, 1.35)
        parts += [(paint, box((w, deep, high), (0, 0, z))) for deep, high, z in across]
    elif style == 6:
        parts += [(paint, mesh) for mesh in _bars(w, h, 0.05, t)]
    else:
        parts.append((paint, box((w, t, h), (0, 0, h / 2))))
        rows = {
            1: ((0.15, 0.9), (1.0, h - 0.15)),
            2: ((0.15, 0.65), (0.75, 1.25), (1.35, h - 0.12)),
            3: ((0.12, h - 0.12),),
        }.get(style, ())
        columns = 2 if style in (1, 2) else 1
        for low, high in rows:
            for c in range(columns):
                cw = (w - 0.2) / columns - 0.04
                cx = (c - (columns - 1) / 2) * (cw + 0.08)
                at, ch = (cx, 0.0, (low + high) / 2), high - low
                parts.append((paint, box((cw, t + 0.014, ch), at)))
                parts.append((paint, box((cw - 0.08, t + 0.03, ch - 0.08), at)))
    x = w / 2 - 0.07
    for s in SIDES:
        y = s * (t / 2 + 0.045)
        parts.append(("#a9aaac", rod((x, s * t / 2, 1.03), (x, y, 1.03), 0.009, 6)))
        parts.append(("#a9aaac", rod((x, y, 1.03), (x - 0.12, y, 1.03), 0.009, 6)))
        parts.append(("#a9aaac", box((0.035, 0.004, 0.16), (x, s * (t / 2 + 0.002), 1.0))))
    return [(p, m.grain_up().moved((leaf.x, leaf.y, 0.004), yaw)) for p, m in parts]


def glass_of_leaf(
    leaf: Leaf, style: int
) -> tuple[tuple[float, float, float], float, tuple[float, float]]:
    """(middle, yaw, (width, height)) of a glazed leaf's pane."""
    yaw = float(np.degrees(np.arctan2(leaf.direction[1], leaf.direction[0])))
    low, high = (0.7, leaf.height - 0.12) if style == 5 else (0.04, leaf.height - 0.04)
    return (leaf.x, leaf.y, (low + high) / 2), yaw, (leaf.length - 0.22, high - low)


def frame_parts(home: Home, portal: Portal, trim: str, wall_paint: str) -> list[Part]:
    """Lining, casing, threshold; arch corners; window bars and sill."""
    w, t, top, sill = portal.width, home.wall_m, portal.height, portal.sill
    bare = portal.state == "archway" and portal.style < 4
    paint = wall_paint if bare else trim
    pad = LINING_M
    height = top - sill
    parts: list[Part] = [
        (paint, box((pad, t, height), (s * (w + pad) / 2, 0, sill + height / 2))) for s in SIDES
    ]
    parts.append((paint, box((w + 2 * pad, t, pad), (0, 0, top + pad / 2))))
    if sill > 0:
        parts.append((paint, box((w + 2 * pad, t, pad), (0, 0, sill - pad / 2))))
    if not bare:
        cw = 0.05 + 0.01 * (portal.style % 4)
        proud = t + 0.03
        base = sill - (cw if sill > 0 else 0)
        for s in SIDES:
            x = s * (w / 2 + pad * 0.6 + cw / 2)
            parts.append((trim, box((cw, proud, top + cw - base), (x, 0, (base + top + cw) / 2))))
        span = w + 2 * (pad * 0.6 + cw)
        # Casings lie on both faces; the middle is the hole itself.
        for face in (-1, 1):
            y = face * (t / 2 + 0.0075)
            parts.append((trim, box((span, 0.015, cw), (0, y, top + pad * 0.6 + cw / 2))))
    if portal.state == "archway" and portal.style < 2:
        parts += _arch(w, t, top, paint)
    if sill == 0:
        top = portal.sill_top_m
        parts.append(("wood0", box((w, t, top + 0.002), (0, 0, top / 2 - 0.001))))
    if portal.state == "curtain":
        parts += _folds(portal)
    if portal.state == "window":
        parts += _window_bars(portal, t, trim)
    if portal.state.startswith("sliding"):
        parts += _sliding(portal, t, trim)
    return [(p, _in_wall(portal, m)) for p, m in parts]


def _arch(w: float, t: float, top: float, paint: str) -> list[Part]:
    """Rounded upper corners; the opening keeps its width below them."""
    rise = min(0.32, w / 2)
    angles = np.linspace(0, np.pi / 2, 7)
    out: list[Part] = []
    for s in SIDES:
        for a, b in pairwise(angles):
            p = [(w / 2 - rise + rise * np.cos(k), top - rise + rise * np.sin(k)) for k in (a, b)]
            quad = [(w / 2, p[0][1]), (w / 2, p[1][1]), p[1], p[0]]
            outline = [(s * x, z) for x, z in quad]
            out.append((paint, extrude(outline if s > 0 else outline[::-1], -t / 2, t / 2)))
    return out


def _folds(portal: Portal) -> list[Part]:
    """A drawn curtain that fills the opening."""
    count = max(4, round(portal.width / 0.11))
    fold, drop = portal.width / count, portal.height - 0.05
    size, low, z = (fold * 1.15, 0.06, drop), -portal.width / 2, 0.03 + drop / 2
    places = [(low + (k + 0.5) * fold, 0.02 * (-1) ** k, z) for k in range(count)]
    return [("curtain", rounded_box(size, 0.025, at, 1)) for at in places]


def _window_bars(portal: Portal, t: float, trim: str) -> list[Part]:
    w, low, h = portal.width, portal.sill, portal.height - portal.sill
    parts: list[Part] = [(trim, mesh) for mesh in _bars(w, h, 0.05, 0.06, (0.0, 0.0, low))]
    fields = max(1, round(w / 0.8))
    for i in range(1, fields):
        parts.append((trim, box((0.08, 0.06, h), (-w / 2 + i * w / fields, 0, low + h / 2))))
    if portal.style == 1:
        parts.append((trim, box((w, 0.04, 0.03), (0, 0, low + h * 0.62))))
    side = 1 if portal.rooms[1] >= 0 else -1
    parts.append((trim, box((w + 0.16, 0.22, 0.025), (0, side * (t / 2 + 0.06), low - 0.012))))
    return parts


def _sliding(portal: Portal, t: float, trim: str) -> list[Part]:
    """Two glass sashes; when open, both stand behind one another on the hinge side."""
    w, h, bar = portal.width, portal.height, 0.06
    out: list[Part] = [(trim, box((w, 0.1, 0.012), (0, 0, 0.006)))]
    half = w / 2
    for k, y in ((-1, -0.025), (1, 0.025)):
        side = portal.hinge if portal.state == "sliding_open" else k
        c = side * half / 2
        out += [(trim, mesh) for mesh in _bars(half, h, bar, 0.04, (c, y, 0.0))]
    return out


def panes(portal: Portal) -> list[tuple[float, float, float, float]]:
    """Glass of a window or sliding door: (along, width, low, high)."""
    if portal.state == "window":
        return [(0.0, portal.width, portal.sill, portal.height)]
    if portal.state == "sliding_closed":
        return [(0.0, portal.width, 0.0, portal.height)]
    if portal.state == "sliding_open":
        return [(portal.hinge * portal.width / 4, portal.width / 2, 0.0, portal.height)]
    return []


def balcony(home: Home, portal: Portal) -> list[Part]:
    """A slab with a railing outside a sliding door."""
    out = 1 if portal.rooms[1] < 0 else -1
    w, d, t = portal.width + 1.4, 1.5, home.wall_m / 2
    parts: list[Part] = [("#9b978f", box((w, d, 0.1), (0, out * (t + d / 2), -0.052)))]
    for i in range(int(w / 0.12) + 1):
        x = -w / 2 + 0.12 * i
        parts.append(("#5b5f63", box((0.015, 0.015, 1.0), (x, out * (t + d - 0.03), 0.5))))
    parts.append(("#5b5f63", box((w, 0.05, 0.04), (0, out * (t + d - 0.03), 1.02))))
    for s in SIDES:
        parts.append(("#c9c6bf", box((0.08, d, 1.04), (s * w / 2, out * (t + d / 2), 0.52))))
    return [(p, _in_wall(portal, m)) for p, m in parts]


def baseboards(home: Home, room: Room, span: WallSpan, trim: str) -> list[Part]:
    """Skirting between the doorways of one wall face."""
    start, length, begin = wall_face(home, room, span)
    gaps = sorted(
        (p.at - begin - p.width / 2 - 0.09, p.at - begin + p.width / 2 + 0.09)
        for p in span.holes
        if p.sill < 0.08
    )
    runs, at = [], 0.0
    for a, b in gaps:
        runs.append((at, a))
        at = b
    runs.append((at, length))
    inward, parts = INWARD[span.side], []
    for a, b in runs:
        if b - a < 0.03:
            continue
        size = (0.012, b - a, 0.075) if span.side < 2 else (b - a, 0.012, 0.075)
        along = Y if span.side < 2 else X
        centre = start + along * (a + b) / 2 + inward * 0.006 + Z * 0.0375
        parts.append((trim, box(size, (float(centre[0]), float(centre[1]), float(centre[2])))))
    return parts
