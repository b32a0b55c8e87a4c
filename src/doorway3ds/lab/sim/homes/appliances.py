"""Kitchen and bathroom furniture; the conventions are those of furniture.py."""

from __future__ import annotations

from doorway3ds.lab.sim.homes.furniture import Item, Part, Rng, body_paint, fronts, grey, on_top
from doorway3ds.lab.sim.homes.mesh import box, cylinder, lathe, rod, rotation_x, rounded_box


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
    parts: list[Part] = [
        (white, box((w, 0.06, h), (0, s * (d / 2 - 0.03), h / 2))) for s in (-1, 1)
    ]
    parts += [(white, box((0.08, d, h), (s * (w / 2 - 0.04), 0, h / 2))) for s in (-1, 1)]
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
