"""Furniture from small meshes. Every maker takes (rng) and returns an `Item`.

An item stands on the floor with its footprint's middle at the origin, its back at
y = -depth / 2 and its front towards +y. A part is (paint, mesh): paint is "wood0".."wood2",
"fabric0".."fabric3", "curtain", "#rrggbb", or a picture ("painting0", "books0", "screen0",
"rug0", ...) whose uv then run 0..1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from doorway3ds.lab.sim.homes.mesh import (
    Mesh,
    ball,
    box,
    cylinder,
    lathe,
    rod,
    rotation_x,
    rounded_box,
    sheet,
)

Rng = np.random.Generator
Part = tuple[str, Mesh]
X, Y, Z = np.eye(3)
SIDES = (-1, 1)
_VASE = ((0.0, 0.0), (0.6, 0.0), (1.0, 1.2), (0.35, 2.6), (0.5, 3.0))  # radius and height by radius


@dataclass(frozen=True)
class Item:
    """size: footprint width (x), depth (y) and height in metres."""

    name: str
    size: tuple[float, float, float]
    parts: tuple[Part, ...]


Maker = Callable[[Rng], Item]


def picture(width: float, height: float, centre: tuple[float, float, float]) -> Mesh:
    """A panel facing +y with uv 0..1."""
    start = np.asarray(centre, float) + X * width / 2 - Z * height / 2
    panel = sheet(start, -X, Z, np.array([0.0, width]), np.array([0.0, height]), Y)
    return Mesh(panel.vertices, panel.normals, panel.uv / [width, height], panel.faces)


def grey(rng: Rng, low: float = 0.05, high: float = 0.95) -> str:
    v = rng.uniform(low, high)
    tint = rng.normal(0, 0.02, 3)
    return rgb(*(v + tint))


def rgb(r: float, g: float, b: float) -> str:
    return "#" + "".join(f"{int(np.clip(c, 0, 1) * 255):02x}" for c in (r, g, b))


def vivid(rng: Rng) -> str:
    base = rng.uniform(0.08, 0.9, 3)
    return rgb(*(base.mean() + (base - base.mean()) * rng.uniform(0.2, 1.2)))


def body_paint(rng: Rng) -> str:
    """What furniture is made of: wood or lacquer."""
    if rng.random() < 0.6:
        return f"wood{rng.integers(3)}"
    return grey(rng, 0.75, 0.95) if rng.random() < 0.7 else vivid(rng)


def cloth(rng: Rng) -> str:
    return f"fabric{rng.integers(4)}"


def legs(
    paint: str, w: float, d: float, h: float, r: float = 0.02, inset: float = 0.05
) -> list[Part]:
    x, y, size = w / 2 - inset, d / 2 - inset, (2 * r, 2 * r, h)
    return [(paint, box(size, (sx * x, sy * y, h / 2))) for sx in SIDES for sy in SIDES]


def fronts(
    rng: Rng, paint: str, w: float, y: float, z0: float, z1: float, columns: int, rows: int
) -> list[Part]:
    """Doors or drawers with gaps and handles on a front at y."""
    out: list[Part] = []
    handle = grey(rng, 0.1, 0.8)
    for i in range(columns):
        for j in range(rows):
            cw, ch = w / columns, (z1 - z0) / rows
            cx, cz = -w / 2 + (i + 0.5) * cw, z0 + (j + 0.5) * ch
            tall = ch > 0.5
            front = box((cw - 0.012, 0.02, ch - 0.012), (cx, y + 0.01, cz))
            out.append((paint, front.grain_up() if tall else front))
            size = (0.012, 0.02, 0.14) if tall else (0.12, 0.02, 0.012)
            hx = cx + (cw / 2 - 0.05) * (1 if i % 2 == 0 else -1) if tall else cx
            out.append((handle, box(size, (hx, y + 0.035, cz))))
    return out


def bed(rng: Rng) -> Item:
    w, d = float(rng.choice([0.9, 1.2, 1.4, 1.6, 1.8])), float(rng.uniform(1.95, 2.1))
    frame, h = body_paint(rng), rng.uniform(0.22, 0.34)
    sheet_paint, cover = grey(rng, 0.8, 0.97), cloth(rng)
    head = rng.uniform(0.7, 1.15)
    parts: list[Part] = [
        (frame, box((w, d, h - 0.08), (0, 0, 0.08 + (h - 0.08) / 2))),
        (frame, box((w + 0.04, 0.06, head), (0, -d / 2 + 0.03, head / 2))),
        (sheet_paint, rounded_box((w - 0.04, d - 0.08, 0.2), 0.06, (0, 0.02, h + 0.1))),
        (cover, rounded_box((w + 0.04, d * 0.62, 0.1), 0.05, (0, d * 0.18, h + 0.18))),
        (cover, box((w + 0.05, d * 0.58, 0.18), (0, d * 0.19, h + 0.08))),
    ]
    for i in range(1 if w < 1.3 else 2):
        x = 0.0 if w < 1.3 else (i - 0.5) * w * 0.46
        pillow = rounded_box((0.6, 0.38, 0.14), 0.065, (x, -d / 2 + 0.3, h + 0.26))
        parts.append((sheet_paint if rng.random() < 0.6 else cloth(rng), pillow))
    return Item("bed", (w + 0.05, d, head), tuple(parts))


def wardrobe(rng: Rng) -> Item:
    w, d, h = rng.uniform(0.8, 2.2), rng.uniform(0.5, 0.62), rng.uniform(1.8, 2.25)
    paint = body_paint(rng)
    parts: list[Part] = [(paint, box((w, d - 0.02, h), (0, -0.01, h / 2)))]
    parts += fronts(rng, paint, w, d / 2 - 0.02, 0.07, h - 0.03, max(2, round(w / 0.5)), 1)
    return Item("wardrobe", (w, d, h), tuple(parts))


def dresser(rng: Rng) -> Item:
    w, d, h = rng.uniform(0.45, 1.4), rng.uniform(0.38, 0.5), rng.uniform(0.45, 1.1)
    paint = body_paint(rng)
    parts: list[Part] = [(paint, box((w, d, h - 0.06), (0, 0, 0.06 + (h - 0.06) / 2)))]
    columns, rows = 1 if w < 0.8 else 2, max(2, round(h / 0.25))
    parts += fronts(rng, paint, w, d / 2, 0.08, h - 0.03, columns, rows)
    parts += on_top(rng, w, d, h)
    return Item("dresser", (w, d, h), tuple(parts))


def on_top(rng: Rng, w: float, d: float, h: float) -> list[Part]:
    """Vases, books, a lamp, boxes on a surface at height h."""
    out: list[Part] = []
    for _ in range(int(rng.integers(0, 4))):
        x, y = rng.uniform(-w / 2 + 0.1, w / 2 - 0.1), rng.uniform(-d / 4, d / 6)
        kind = rng.random()
        if kind < 0.3:
            r = rng.uniform(0.04, 0.09)
            out.append((vivid(rng), lathe([(r * a, r * z) for a, z in _VASE], (x, y, h))))
        elif kind < 0.55:
            for k in range(int(rng.integers(1, 5))):
                out.append((vivid(rng), box((0.22, 0.16, 0.03), (x, y, h + 0.015 + 0.03 * k))))
        elif kind < 0.75:
            out.append((grey(rng), cylinder(0.05, 0.02, (x, y, h))))
            out.append((grey(rng), cylinder(0.01, 0.28, (x, y, h))))
            out.append((rgb(0.95, 0.88, 0.7), cylinder(0.13, 0.18, (x, y, h + 0.26), 0.08)))
        else:
            s = rng.uniform(0.08, 0.25, 3)
            out.append((vivid(rng), box(tuple(s), (x, y, h + s[2] / 2))))
    return out


def table(rng: Rng, w: float, d: float, h: float) -> list[Part]:
    paint = body_paint(rng)
    if rng.random() < 0.2 and abs(w - d) < 0.4:
        return [
            (paint, cylinder(min(w, d) / 2, 0.03, (0, 0, h - 0.03), n=24)),
            (paint, cylinder(0.05, h - 0.03)),
            (paint, cylinder(w * 0.28, 0.03)),
        ]
    leg = paint if rng.random() < 0.6 else grey(rng, 0.05, 0.4)
    out: list[Part] = [(paint, rounded_box((w, d, 0.035), 0.008, (0, 0, h - 0.0175), 1))]
    return out + legs(leg, w, d, h - 0.03, rng.uniform(0.015, 0.035))


def chair(rng: Rng) -> Item:
    w, seat = rng.uniform(0.4, 0.5), rng.uniform(0.43, 0.48)
    frame = body_paint(rng)
    pad = cloth(rng) if rng.random() < 0.5 else frame
    back = rng.uniform(0.8, 1.0)
    parts: list[Part] = legs(frame, w, w, seat, 0.017, 0.03)
    parts.append((pad, rounded_box((w, w, 0.05), 0.015, (0, 0, seat))))
    y, post = -w / 2 + 0.02, (0.03, 0.03, back - seat)
    parts += [(frame, box(post, (s * (w / 2 - 0.03), y, (back + seat) / 2))) for s in SIDES]
    if rng.random() < 0.5:
        parts.append((pad, box((w - 0.05, 0.025, 0.3), (0, y, back - 0.16))))
    else:
        bar = (w - 0.05, 0.02, 0.045)
        parts += [(frame, box(bar, (0, y, back - 0.03 - 0.13 * k))) for k in range(3)]
    return Item("chair", (w, w, back), tuple(parts))


def office_chair(rng: Rng) -> Item:
    paint, dark = cloth(rng), grey(rng, 0.04, 0.25)
    parts: list[Part] = [
        (paint, rounded_box((0.48, 0.48, 0.09), 0.04, (0, 0, 0.48))),
        (paint, rounded_box((0.44, 0.07, 0.55), 0.03, (0, -0.24, 0.85))),
        (dark, cylinder(0.03, 0.4, (0, 0, 0.06))),
        (dark, box((0.06, 0.03, 0.3), (0, -0.26, 0.55))),
    ]
    for a in np.arange(5) * 2 * np.pi / 5:
        tip = (0.3 * float(np.cos(a)), 0.3 * float(np.sin(a)), 0.05)
        foot = ball((0.03, 0.03, 0.03), tip, 6)
        parts += [(dark, rod((0, 0, 0.09), tip, 0.018, 6)), (dark, foot)]
    return Item("office_chair", (0.6, 0.6, 1.1), tuple(parts))


def dining(rng: Rng) -> Item:
    w, d = rng.uniform(1.1, 1.9), rng.uniform(0.75, 0.95)
    parts = table(rng, w, d, 0.74) + on_top(rng, w, d, 0.74)
    one = chair(rng)
    seats = max(1, int(w / 0.62))
    for side in (-1, 1):
        for i in range(seats):
            if rng.random() < 0.85:
                x = (i - (seats - 1) / 2) * 0.62 + rng.normal(0, 0.03)
                y = side * (d / 2 + rng.uniform(-0.05, 0.2))
                yaw = 180.0 * (side > 0) + rng.normal(0, 8)
                parts += [(p, m.moved((x, y, 0), yaw)) for p, m in one.parts]
    return Item("dining", (w, d + 0.9, 0.95), tuple(parts))


def desk(rng: Rng) -> Item:
    w, d, h = rng.uniform(1.0, 1.6), rng.uniform(0.55, 0.75), 0.74
    parts = table(rng, w, d, h)
    for i in range(int(rng.integers(1, 3))):
        x = (i - 0.3) * 0.5
        parts += [
            ("#0c0c0e", box((0.54, 0.02, 0.33), (x, -d / 4, h + 0.3))),
            (f"screen{rng.integers(2)}", picture(0.52, 0.3, (x, -d / 4 + 0.012, h + 0.3))),
            ("#1a1a1c", cylinder(0.09, 0.14, (x, -d / 4 - 0.01, h), 0.02)),
        ]
    parts.append((grey(rng), box((0.4, 0.13, 0.02), (0, d / 5, h + 0.01))))
    seat = office_chair(rng)
    yaw = 180 + rng.normal(0, 25)
    parts += [(p, m.moved((rng.normal(0, 0.1), d / 2 + 0.15, 0), yaw)) for p, m in seat.parts]
    return Item("desk", (w, d + 0.55, 1.1), tuple((p, m.moved((0, -0.275, 0))) for p, m in parts))


def bookshelf(rng: Rng) -> Item:
    w, d, h = rng.uniform(0.4, 1.6), rng.uniform(0.26, 0.36), rng.uniform(0.8, 2.2)
    paint, t = body_paint(rng), 0.022
    rows = max(2, round(h / 0.36))
    parts: list[Part] = [(paint, box((w, 0.012, h), (0, -d / 2 + 0.006, h / 2)))]
    parts += [(paint, box((t, d, h), (s * (w - t) / 2, 0, h / 2))) for s in SIDES]
    for i in range(rows + 1):
        z = min(0.05 + i * (h - 0.06) / rows, h - t / 2)
        parts.append((paint, box((w, d, t), (0, 0, z))))
        if i < rows and rng.random() < 0.85:
            bw = (w - 2 * t) * rng.uniform(0.5, 1.0)
            bh = (h - 0.06) / rows - t
            shift = (w - 2 * t - bw) / 2 * rng.choice([-1, 1])
            strip = picture(bw, bh, (shift, d / 2 - 0.06, z + t / 2 + bh / 2))
            parts.append((f"books{rng.integers(3)}", strip))
    return Item("bookshelf", (w, d, h), tuple(parts))


def sofa(rng: Rng, seats: int | None = None) -> Item:
    n = seats or int(rng.integers(2, 4))
    arm, sw = rng.uniform(0.12, 0.24), rng.uniform(0.58, 0.72)
    w, d, h = n * sw + 2 * arm, rng.uniform(0.8, 0.98), rng.uniform(0.72, 0.92)
    paint = cloth(rng)
    high = h - 0.1
    parts: list[Part] = [
        (paint, rounded_box((w, d - 0.05, 0.26), 0.04, (0, 0, 0.21))),
        (paint, rounded_box((w - 0.02, 0.22, high), 0.07, (0, -d / 2 + 0.12, 0.1 + high / 2))),
    ]
    side = (arm, d, 0.5)
    parts += [(paint, rounded_box(side, 0.06, (s * (w - arm) / 2, 0, 0.33))) for s in SIDES]
    for i in range(n):
        x = (i - (n - 1) / 2) * sw
        parts.append((paint, rounded_box((sw - 0.01, d - 0.26, 0.17), 0.05, (x, 0.1, 0.4))))
        parts.append((paint, rounded_box((sw - 0.03, 0.18, 0.42), 0.07, (x, -d / 2 + 0.29, 0.64))))
        if rng.random() < 0.45:
            lean = rotation_x(rng.uniform(-25, -10))
            cushion, cover = rounded_box((0.4, 0.14, 0.38), 0.065).turned(lean), cloth(rng)
            parts.append((cover, cushion.moved((x + rng.normal(0, 0.1), -d / 2 + 0.45, 0.66))))
    parts += legs("#2a2018", w, d, 0.1, 0.02, 0.08)
    return Item("sofa" if n > 1 else "armchair", (w, d, h), tuple(parts))


def armchair(rng: Rng) -> Item:
    return sofa(rng, 1)


def coffee_table(rng: Rng) -> Item:
    w, d, h = rng.uniform(0.5, 1.2), rng.uniform(0.45, 0.7), rng.uniform(0.36, 0.5)
    return Item("coffee_table", (w, d, h), tuple(table(rng, w, d, h) + on_top(rng, w, d, h)))


def tv_unit(rng: Rng) -> Item:
    w, d, h = rng.uniform(1.1, 2.0), 0.4, rng.uniform(0.35, 0.55)
    paint = body_paint(rng)
    tw = rng.uniform(0.8, min(1.4, w))
    th = tw * 0.57
    parts: list[Part] = [(paint, box((w, d, h - 0.08), (0, 0, 0.08 + (h - 0.08) / 2)))]
    parts += fronts(rng, paint, w, d / 2, 0.1, h - 0.02, max(2, round(w / 0.5)), 1)
    z = h + 0.1 + th / 2
    parts += [
        ("#0b0b0c", box((tw + 0.03, 0.04, th + 0.03), (0, -0.05, z))),
        (f"screen{rng.integers(2)}", picture(tw, th, (0, -0.028, z))),
        ("#151516", box((0.3, 0.2, 0.1), (0, -0.05, h + 0.05))),
    ]
    return Item("tv", (w, d, h + th + 0.1), tuple(parts))


def kitchen(rng: Rng) -> Item:
    w, d = rng.uniform(1.8, 3.2), 0.62
    paint, top = (
        body_paint(rng),
        grey(rng, 0.1, 0.9) if rng.random() < 0.6 else f"wood{rng.integers(3)}",
    )
    n = round(w / 0.6)
    parts: list[Part] = [
        ("#2b2b2b", box((w, d - 0.1, 0.1), (0, -0.05, 0.05))),
        (paint, box((w, d - 0.03, 0.76), (0, -0.015, 0.48))),
        (top, box((w + 0.02, d + 0.02, 0.04), (0, 0, 0.88))),
        ("#1c1c1e", box((0.56, 0.48, 0.01), (w / 4, 0, 0.905))),
        ("#9da0a3", box((0.5, 0.4, 0.012), (-w / 4, 0, 0.902))),
        ("#c8cacc", rod((-w / 4, -0.22, 0.9), (-w / 4, -0.22, 1.18), 0.012)),
        ("#c8cacc", rod((-w / 4, -0.22, 1.18), (-w / 4, -0.02, 1.14), 0.012)),
    ]
    parts += fronts(rng, paint, w, d / 2 - 0.03, 0.11, 0.85, n, 1)
    if rng.random() < 0.75:
        parts.append((paint, box((w, 0.33, 0.68), (0, -d / 2 + 0.165, 1.76))))
        parts += fronts(rng, paint, w, -d / 2 + 0.33, 1.43, 2.09, n, 1)
    parts.append(("#111113", box((0.55, 0.015, 0.42), (w / 4, d / 2, 0.5))))
    parts += [(p, m.moved((0, -0.1, 0))) for p, m in on_top(rng, w, d, 0.9)]
    return Item("kitchen", (w, d, 2.1), tuple(parts))


def fridge(rng: Rng) -> Item:
    w, d, h = 0.6, 0.64, rng.uniform(1.4, 2.0)
    paint = grey(rng, 0.55, 0.97)
    cut = h * rng.choice([0.35, 0.68])
    parts: list[Part] = [(paint, box((w, d - 0.05, h), (0, -0.025, h / 2)))]
    for z0, z1 in ((0.04, cut), (cut + 0.01, h)):
        parts.append(
            (paint, rounded_box((w, 0.05, z1 - z0), 0.02, (0, d / 2 - 0.025, (z0 + z1) / 2)))
        )
        grip = z1 - 0.2 if z1 == cut else z0 + 0.2
        parts.append(("#77797c", box((0.02, 0.03, 0.3), (w / 2 - 0.05, d / 2 + 0.01, grip))))
    return Item("fridge", (w, d, h), tuple(parts))


def washer(rng: Rng) -> Item:
    ring = lathe([(0.13, 0.0), (0.2, 0.0), (0.2, 0.03), (0.13, 0.03)], n=20).turned(rotation_x(-90))
    glass = cylinder(0.13, 0.02, n=20).turned(rotation_x(-90))
    parts: list[Part] = [
        (grey(rng, 0.85, 0.97), rounded_box((0.6, 0.56, 0.85), 0.015, (0, 0, 0.425), 1)),
        ("#b7babd", ring.moved((0, 0.28, 0.42))),
        ("#15181c", glass.moved((0, 0.285, 0.42))),
        ("#d5d8da", box((0.58, 0.01, 0.1), (0, 0.284, 0.77))),
    ]
    return Item("washer", (0.6, 0.6, 0.85), tuple(parts))


def bathtub(rng: Rng) -> Item:
    w, d, h = rng.uniform(1.5, 1.8), 0.75, 0.56
    white = "#f0f0ee"
    parts: list[Part] = [(white, box((w, 0.06, h), (0, s * (d / 2 - 0.03), h / 2))) for s in SIDES]
    parts += [(white, box((0.08, d, h), (s * (w / 2 - 0.04), 0, h / 2))) for s in SIDES]
    parts.append((white, box((w, d, 0.15), (0, 0, 0.075))))
    if rng.random() < 0.5:
        parts.append(("curtain", box((w * 0.5, 0.03, 1.6), (w * 0.2, d / 2 - 0.03, 1.2))))
    return Item("bathtub", (w, d, h), tuple(parts))


def toilet(rng: Rng) -> Item:
    white = "#f2f2f0"
    bowl = lathe(
        [(0.1, 0.0), (0.12, 0.1), (0.17, 0.36), (0.19, 0.4), (0.19, 0.43), (0.0, 0.43)], squash=1.25
    )
    parts: list[Part] = [
        (white, bowl.moved((0, 0.08, 0))),
        (white, rounded_box((0.38, 0.18, 0.38), 0.03, (0, -0.24, 0.6))),
        (white, box((0.2, 0.3, 0.38), (0, -0.15, 0.19))),
    ]
    return Item("toilet", (0.4, 0.66, 0.8), tuple(parts))


def basin(rng: Rng) -> Item:
    w = rng.uniform(0.5, 0.9)
    paint = body_paint(rng)
    parts: list[Part] = [
        (paint, box((w, 0.44, 0.6), (0, 0, 0.5))),
        ("#f4f4f2", rounded_box((w + 0.02, 0.48, 0.1), 0.03, (0, 0, 0.83))),
        ("#b9bcc0", rod((0, -0.18, 0.86), (0, -0.18, 1.02), 0.014)),
        ("#b9bcc0", rod((0, -0.18, 1.02), (0, -0.04, 1.0), 0.012)),
    ]
    parts += fronts(rng, paint, w, 0.22, 0.22, 0.78, 2, 1)
    return Item("basin", (w, 0.5, 0.9), tuple(parts))
