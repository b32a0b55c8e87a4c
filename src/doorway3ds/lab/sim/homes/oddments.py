"""Things that robots trip over or take for doorways. Same conventions as furniture.py."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from doorway3ds.lab.sim.homes.furniture import Item, Part, Rng, body_paint, cloth, grey, rgb, vivid
from doorway3ds.lab.sim.homes.mesh import ball, box, cylinder, rod, rounded_box


def closet(rng: Rng) -> Item:
    """A built-in closet or walk-in wardrobe without a leaf: an opening that leads nowhere."""
    w, d, h = rng.uniform(0.85, 1.7), rng.uniform(0.6, 1.4), rng.uniform(2.1, 2.32)
    ow, oh = rng.uniform(0.68, w - 0.12), rng.uniform(1.95, h - 0.08)
    paint = grey(rng, 0.75, 0.97) if rng.random() < 0.7 else body_paint(rng)
    inner = grey(rng, 0.5, 0.95)
    t = 0.04
    parts: list[Part] = [(paint, box((t, d, h), (s * (w - t) / 2, 0, h / 2))) for s in (-1, 1)]
    cheek = (w - ow) / 2
    parts += [
        (paint, box((cheek, t, h), (s * (w - cheek) / 2, (d - t) / 2, h / 2))) for s in (-1, 1)
    ]
    parts += [
        (paint, box((w, t, h - oh), (0, (d - t) / 2, (h + oh) / 2))),
        (paint, box((w, d, 0.03), (0, 0, h - 0.015))),
        (inner, box((w - t, 0.02, h), (0, -d / 2 + 0.01, h / 2))),
    ]
    low = -d / 2 + 0.05
    if rng.random() < 0.8:
        parts.append(("#b9bbbd", rod((-w / 2, low + 0.25, 1.68), (w / 2, low + 0.25, 1.68), 0.012)))
        x = -w / 2 + 0.1
        while x < w / 2 - 0.12:
            drop = rng.uniform(0.5, 1.15)
            coat = cloth(rng) if rng.random() < 0.5 else vivid(rng)
            parts.append(
                (coat, rounded_box((0.05, 0.42, drop), 0.02, (x, low + 0.25, 1.64 - drop / 2)))
            )
            x += rng.uniform(0.06, 0.3)
    for z in (rng.uniform(1.75, 1.9), *rng.uniform(0.3, 0.6, int(rng.integers(0, 2)))):
        parts.append((inner, box((w - t, 0.35, 0.02), (0, low + 0.16, z))))
    for _ in range(int(rng.integers(0, 4))):
        s = rng.uniform(0.15, 0.35, 3)
        x = rng.uniform(-w / 2 + 0.25, w / 2 - 0.25)
        parts.append((vivid(rng), box((s[0], min(s[1], 0.3), s[2]), (x, low + 0.18, s[2] / 2))))
    return Item("closet", (w, d, h), tuple(parts))


def cable(rng: Rng) -> Item:
    """A lead on the floor with an extension socket, 3 to 5 cm high."""
    paint = grey(rng, 0.03, 0.9)
    points = [np.array([-0.6, rng.uniform(-0.2, 0.2), 0.008])]
    for k in range(9):
        x = -0.6 + 1.2 * (k + 1) / 9
        points.append(np.array([x, rng.uniform(-0.22, 0.22), 0.008 + 0.012 * rng.random()]))
    corners = [(float(p[0]), float(p[1]), float(p[2])) for p in points]
    parts: list[Part] = [(paint, rod(a, b, 0.007, 6)) for a, b in pairwise(corners)]
    height = rng.uniform(0.03, 0.05)
    block = box((0.3, 0.06, height), (0, 0, height / 2)).moved((0, 0, 0), rng.uniform(0, 180))
    parts.append((paint, block))
    return Item("cable", (1.25, 0.5, height), tuple(parts))


def toys(rng: Rng) -> Item:
    """Balls, blocks and cars of 3 to 15 cm, strewn over half a metre."""
    parts: list[Part] = []
    for _ in range(int(rng.integers(4, 10))):
        x, y = rng.uniform(-0.24, 0.24, 2)
        s = float(rng.uniform(0.03, 0.15))
        paint, turn = vivid(rng), float(rng.uniform(0, 360))
        kind = rng.random()
        if kind < 0.35:
            parts.append((paint, ball((s / 2, s / 2, s / 2), (x, y, s / 2), 10)))
        elif kind < 0.7:
            parts.append((paint, box((s, s, s), (0, 0, s / 2)).moved((x, y, 0), turn)))
        else:
            low, cab = box((0.16, 0.08, 0.05), (0, 0, 0.04)), box((0.08, 0.07, 0.04), (0, 0, 0.08))
            parts += [(paint, m.moved((x, y, 0), turn)) for m in (low, cab)]
    return Item("toys", (0.62, 0.62, 0.15), tuple(parts))


def pet(rng: Rng) -> Item:
    """A cat or a dog, standing, 0.25 to 0.65 m tall; it looks towards +y."""
    k = rng.uniform(0.45, 0.6) if rng.random() < 0.5 else rng.uniform(0.7, 1.2)
    coats = (0.08, 0.08, 0.08), (0.55, 0.38, 0.2), (0.85, 0.8, 0.7), (0.35, 0.33, 0.32)
    coat = rgb(*coats[int(rng.integers(4))])
    parts: list[Part] = [
        (coat, ball((0.1, 0.28, 0.11), (0, 0, 0.36), 12)),
        (coat, ball((0.08, 0.1, 0.085), (0, 0.32, 0.48), 10)),
        (coat, ball((0.04, 0.07, 0.04), (0, 0.41, 0.46), 8)),
        (coat, rod((0, -0.26, 0.38), (0.05, -0.44, rng.uniform(0.3, 0.6)), 0.018)),
    ]
    for sx in (-1, 1):
        parts.append((coat, cylinder(0.022, 0.07, (sx * 0.05, 0.3, 0.53), 0.004, n=8)))
        for y in (-0.19, 0.19):
            parts.append((coat, rod((sx * 0.07, y, 0.0), (sx * 0.07, y, 0.34), 0.028)))
    grown = [(p, replace(m, vertices=m.vertices * k)) for p, m in parts]
    return Item("pet", (0.22 * k, 0.92 * k, 0.6 * k), tuple(grown))
