"""Small things, people and pets, what hangs on walls and ceilings, what robots trip over.

Same conventions as furniture.py.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from doorway3ds.lab.sim.homes.furniture import (
    SIDES,
    Item,
    Maker,
    Part,
    Rng,
    body_paint,
    cloth,
    grey,
    picture,
    rgb,
    vivid,
)
from doorway3ds.lab.sim.homes.mesh import ball, box, cylinder, lathe, rod, rotation_x, rounded_box

SKINS = ("#e8c3a3", "#d9a57f", "#b67f57", "#7d5233", "#4f3322", "#f0d2bb")


def person(rng: Rng) -> Item:
    """Somebody standing or walking, 1.0 to 1.9 m tall."""
    tall = rng.uniform(1.5, 1.9) if rng.random() < 0.85 else rng.uniform(1.0, 1.4)
    k = tall / 1.75
    skin, top, legs = str(rng.choice(SKINS)), vivid(rng), grey(rng, 0.05, 0.5)
    if rng.random() < 0.5:
        top, legs = cloth(rng), rgb(0.12, 0.16, rng.uniform(0.2, 0.45))
    hair = rgb(*(np.array([0.32, 0.22, 0.14]) * rng.uniform(0.1, 2.2)))
    parts: list[Part] = []
    stride = rng.uniform(0, 0.22)
    for s in SIDES:
        foot, knee = (s * 0.1, s * stride, 0.06), (s * 0.1, s * stride * 0.6 + 0.02, 0.48)
        parts += [
            (legs, rod(foot, knee, 0.062)),
            (legs, rod(knee, (s * 0.09, 0, 0.92), 0.08)),
            ("#1d1a18", rounded_box((0.1, 0.26, 0.09), 0.035, (s * 0.1, s * stride + 0.05, 0.045))),
        ]
        hand = (s * 0.3, rng.uniform(-0.1, 0.35), rng.uniform(0.78, 1.1))
        elbow = (s * 0.27, rng.uniform(-0.08, 0.05), 1.12)
        parts += [
            (top, rod((s * 0.2, 0, 1.42), elbow, 0.055)),
            (skin if rng.random() < 0.5 else top, rod(elbow, hand, 0.042)),
            (skin, ball((0.045, 0.045, 0.06), hand, 8)),
        ]
    torso = [(0.0, 0.86), (0.17, 0.88), (0.165, 1.0), (0.15, 1.12), (0.19, 1.3), (0.2, 1.4)]
    parts += [
        (top, lathe([*torso, (0.1, 1.48), (0.0, 1.5)], squash=0.62)),
        (skin, cylinder(0.055, 0.12, (0, 0, 1.45))),
        (skin, ball((0.085, 0.1, 0.125), (0, 0.01, 1.64))),
        (hair, ball((0.095, 0.1, 0.11), (0, -0.025, 1.68))),
    ]
    grown = [(p, replace(m, vertices=m.vertices * k)) for p, m in parts]
    return Item("person", (0.55 * k, 0.45 * k, tall), tuple(grown))


def carton(rng: Rng) -> Item:
    w, d, h = (float(v) for v in rng.uniform(0.18, 0.6, 3))
    brown = rgb(0.66, 0.5, 0.33) if rng.random() < 0.7 else vivid(rng)
    parts: list[Part] = [(brown, box((w, d, h), (0, 0, h / 2)))]
    parts.append((rgb(0.78, 0.65, 0.45), box((0.05, d + 0.004, h + 0.004), (0, 0, h / 2))))
    if h < 0.3 and rng.random() < 0.4:
        h2 = h * 0.8
        upper = box((w * 0.8, d * 0.8, h2), (0.02, 0, h + h2 / 2))
        parts.append((brown, upper.moved((0, 0, 0), 12)))
        h += h2
    return Item("carton", (w, d, h), tuple(parts))


def suitcase(rng: Rng) -> Item:
    paint = vivid(rng)
    parts: list[Part] = [(paint, rounded_box((0.45, 0.26, 0.62), 0.05, (0, 0, 0.37)))]
    feet = [(sx * 0.18, sy * 0.08, 0.0) for sx in SIDES for sy in SIDES]
    parts += [("#202022", cylinder(0.03, 0.06, at)) for at in feet]
    parts += [("#3a3a3c", rod((s * 0.1, 0, 0.68), (s * 0.1, 0, 1.0), 0.01)) for s in SIDES]
    parts.append(("#3a3a3c", box((0.24, 0.03, 0.03), (0, 0, 1.0))))
    return Item("suitcase", (0.45, 0.26, 1.0), tuple(parts))


def bag(rng: Rng) -> Item:
    w, h = rng.uniform(0.25, 0.5), rng.uniform(0.25, 0.5)
    profile = [(0.0, 0.0), (w / 2, 0.02), (w / 2.2, h * 0.5), (w / 4, h), (0, h)]
    return Item("bag", (w, w * 0.6, h), ((cloth(rng), lathe(profile, squash=0.6)),))


def bin_(rng: Rng) -> Item:
    r, h = rng.uniform(0.11, 0.2), rng.uniform(0.25, 0.65)
    profile = [(0.0, 0.0), (r * 0.8, 0.0), (r, h), (r * 0.93, h), (r * 0.75, 0.05), (0.0, 0.05)]
    return Item("bin", (2 * r, 2 * r, h), ((grey(rng), lathe(profile)),))


def basket(rng: Rng) -> Item:
    w, h = rng.uniform(0.35, 0.55), rng.uniform(0.25, 0.6)
    parts: list[Part] = [
        (f"wood{rng.integers(3)}", box((w, 0.02, h), (0, s * w * 0.35, h / 2))) for s in SIDES
    ]
    parts += [(parts[0][0], box((0.02, w * 0.7, h), (s * w / 2, 0, h / 2))) for s in SIDES]
    parts.append((cloth(rng), ball((w * 0.45, w * 0.32, 0.15), (0, 0, h - 0.03))))
    return Item("basket", (w, w * 0.7, h + 0.1), tuple(parts))


def plant(rng: Rng) -> Item:
    r, h = rng.uniform(0.12, 0.2), rng.uniform(0.4, 1.7)
    pot = 0.25 + r
    profile = [(0.0, 0.0), (r * 0.7, 0.0), (r, pot), (r * 0.9, pot), (0.0, pot - 0.04)]
    parts: list[Part] = [(vivid(rng), lathe(profile))]
    green = (rng.uniform(0.08, 0.3), rng.uniform(0.3, 0.5), rng.uniform(0.06, 0.2))
    if rng.random() < 0.5:
        for _ in range(int(rng.integers(10, 22))):
            a, out = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.4)
            tip = (out * float(np.cos(a)), out * float(np.sin(a)), pot + h * rng.uniform(0.4, 1))
            paint = rgb(*(np.array(green) * rng.uniform(0.6, 1.4)))
            leaf = ball((0.05, 0.012, np.hypot(out, tip[2] - pot) / 2), n=8)
            lean = leaf.turned(rotation_x(-np.degrees(np.arctan2(out, tip[2] - pot))))
            mid = (tip[0] / 2, tip[1] / 2, (pot + tip[2]) / 2)
            parts.append((paint, lean.moved(mid, float(np.degrees(a)) - 90)))
    else:
        parts.append(("#5a4430", cylinder(0.025, h * 0.6, (0, 0, pot - 0.05), 0.015)))
        for _ in range(int(rng.integers(5, 10))):
            at = rng.normal(0, 0.14, 3) + np.array([0, 0, pot + h * 0.75])
            leaves = ball(tuple(rng.uniform(0.1, 0.22, 3)), tuple(at), 8)
            parts.append((rgb(*(np.array(green) * rng.uniform(0.6, 1.4))), leaves))
    return Item("plant", (0.5, 0.5, pot + h), tuple(parts))


def floor_lamp(rng: Rng) -> Item:
    h, pole = rng.uniform(1.4, 1.8), grey(rng, 0.05, 0.7)  # robots pass under the shade
    parts: list[Part] = [
        (pole, cylinder(0.14, 0.03)),
        (pole, cylinder(0.012, h)),
        ("!" + rgb(0.97, 0.9, 0.75), cylinder(0.2, 0.26, (0, 0, h - 0.05), 0.13)),
    ]
    return Item("floor_lamp", (0.4, 0.4, h + 0.2), tuple(parts))


def stool(rng: Rng) -> Item:
    h, paint = rng.uniform(0.4, 0.7), f"wood{rng.integers(3)}"
    parts: list[Part] = [(paint, cylinder(0.17, 0.035, (0, 0, h - 0.035), n=16))]
    for a in np.arange(3) * 2 * np.pi / 3:
        c, s = float(np.cos(a)), float(np.sin(a))
        parts.append((paint, rod((0.18 * c, 0.18 * s, 0), (0.11 * c, 0.11 * s, h - 0.03), 0.016)))
    return Item("stool", (0.38, 0.38, h), tuple(parts))


def shoes(rng: Rng) -> Item:
    paint = grey(rng, 0.04, 0.8) if rng.random() < 0.6 else vivid(rng)
    parts: list[Part] = []
    for s in SIDES:
        at = (s * 0.07 + rng.normal(0, 0.02), rng.normal(0, 0.04), 0.045)
        parts.append((paint, rounded_box((0.09, 0.27, 0.09), 0.04, at)))
    return Item("shoes", (0.26, 0.3, 0.1), tuple(parts))


def toy(rng: Rng) -> Item:
    r = rng.uniform(0.06, 0.14)
    if rng.random() < 0.5:
        return Item("toy", (2 * r, 2 * r, 2 * r), ((vivid(rng), ball((r, r, r), (0, 0, r))),))
    parts: list[Part] = []
    for _ in range(4):
        x, y = rng.uniform(-0.15, 0.15, 2)
        s = rng.uniform(0.05, 0.12)
        paint, block = vivid(rng), box((s, s, s), (x, y, s / 2))
        parts.append((paint, block.moved((0, 0, 0), rng.uniform(0, 90))))
    return Item("toy", (0.35, 0.35, 0.12), tuple(parts))


def robot_cleaner(rng: Rng) -> Item:
    parts = ((grey(rng, 0.03, 0.9), cylinder(0.17, 0.09, n=20)),)
    return Item("cleaner", (0.34, 0.34, 0.09), parts)


def drying_rack(rng: Rng) -> Item:
    parts: list[Part] = []
    for s in SIDES:
        for e in SIDES:
            parts.append(("#d8dadb", rod((s * 0.5, e * 0.3, 0), (s * 0.5, -e * 0.25, 0.95), 0.01)))
    for i in range(5):
        y = -0.24 + 0.12 * i
        parts.append(("#d8dadb", rod((-0.5, y, 0.95), (0.5, y, 0.95), 0.006, 6)))
        if rng.random() < 0.7:
            w, drop = rng.uniform(0.25, 0.7), rng.uniform(0.25, 0.6)
            x = rng.uniform(-0.5 + w / 2, 0.5 - w / 2)
            parts.append((cloth(rng), box((w, 0.02, drop), (x, y, 0.95 - drop / 2))))
    return Item("rack", (1.0, 0.6, 0.96), tuple(parts))


def painting(rng: Rng) -> Item:
    """Hangs with its back at y = 0, middle at the origin."""
    w, h = (float(v) for v in rng.uniform(0.25, 1.0, 2))
    frame = grey(rng, 0.03, 0.95) if rng.random() < 0.5 else f"wood{rng.integers(3)}"
    parts: list[Part] = [(frame, box((w + 0.05, 0.025, h + 0.05), (0, 0.0125, 0)))]
    parts.append((f"painting{rng.integers(6)}", picture(w, h, (0, 0.027, 0))))
    return Item("painting", (w + 0.05, 0.03, h + 0.05), tuple(parts))


def clock(rng: Rng) -> Item:
    r = rng.uniform(0.1, 0.18)
    rim, face = cylinder(r, 0.03, n=20), cylinder(r * 0.88, 0.034, n=20)
    parts: list[Part] = [
        (grey(rng, 0.02, 0.6), rim.turned(rotation_x(-90))),
        ("#f3f2ec", face.turned(rotation_x(-90))),
        ("#111111", box((0.012, 0.004, r * 0.7), (0, 0.037, r * 0.3))),
        ("#111111", box((r * 0.5, 0.004, 0.012), (-r * 0.2, 0.037, 0))),
    ]
    return Item("clock", (2 * r, 0.04, 2 * r), tuple(parts))


def shelf(rng: Rng) -> Item:
    w, paint = rng.uniform(0.5, 1.2), f"wood{rng.integers(3)}"
    parts: list[Part] = [(paint, box((w, 0.22, 0.025), (0, 0.11, 0)))]
    for _ in range(int(rng.integers(2, 6))):
        s = rng.uniform(0.06, 0.2, 3)
        at = (rng.uniform(-w / 2 + 0.1, w / 2 - 0.1), 0.11, 0.0125 + s[2] / 2)
        parts.append((vivid(rng), box((s[0], min(s[1], 0.18), s[2]), at)))
    return Item("shelf", (w, 0.22, 0.3), tuple(parts))


def coats(rng: Rng) -> Item:
    parts: list[Part] = [(f"wood{rng.integers(3)}", box((0.8, 0.03, 0.1), (0, 0.015, 0)))]
    for i in range(4):
        x = -0.3 + 0.2 * i
        if rng.random() < 0.6:
            drop = rng.uniform(0.5, 1.0)
            coat = rounded_box((0.28, 0.16, drop), 0.07, (x, 0.1, -drop / 2 + 0.04))
            parts.append((cloth(rng), coat))
    return Item("coats", (0.9, 0.2, 0.3), tuple(parts))


def radiator(rng: Rng, width: float) -> Item:
    """Hangs below a window; origin at its lower middle."""
    n = max(4, int(width / 0.07))
    parts: list[Part] = [("#ecebe6", box((width, 0.03, 0.5), (0, 0.05, 0.27)))]
    fin = (width / n * 0.75, 0.03, 0.52)
    for i in range(n):
        x = -width / 2 + (i + 0.5) * width / n
        parts.append(("#f4f3ee", rounded_box(fin, 0.012, (x, 0.08, 0.27), 1)))
    return Item("radiator", (width, 0.1, 0.55), tuple(parts))


def pendant(rng: Rng) -> Item:
    """Hangs from the origin downwards."""
    drop, r = rng.uniform(0.4, 0.8), rng.uniform(0.12, 0.28)
    top = -drop + r * 0.9
    shade = lathe([(r, -drop), (r * 0.8, -drop + r * 0.5), (0.04, top), (0.0, top)])
    parts: list[Part] = [
        ("#222222", rod((0, 0, 0), (0, 0, top), 0.006, 6)),
        (vivid(rng) if rng.random() < 0.5 else "#f5efe0", shade),
        ("!#fff6da", ball((0.06, 0.06, 0.06), (0, 0, -drop + 0.05), 8)),
    ]
    return Item("pendant", (2 * r, 2 * r, drop), tuple(parts))


def ceiling_disc(rng: Rng) -> Item:
    r = rng.uniform(0.12, 0.25)
    parts = (("!#fffaf0", cylinder(r * 0.9, 0.07, (0, 0, -0.07), r)),)
    return Item("disc", (2 * r, 2 * r, 0.08), parts)


def poster(rng: Rng) -> Item:
    """A sheet without a frame."""
    w = float(rng.uniform(0.3, 0.8))
    h = w * float(rng.uniform(0.9, 1.5))
    parts = ((f"painting{rng.integers(6)}", picture(w, h, (0, 0.006, 0))),)
    return Item("poster", (w, 0.01, h), parts)


def closet(rng: Rng) -> Item:
    """A built-in closet or walk-in wardrobe without a leaf: an opening that leads nowhere."""
    w, d, h = rng.uniform(0.85, 1.7), rng.uniform(0.6, 1.4), rng.uniform(2.1, 2.32)
    ow, oh = rng.uniform(0.68, w - 0.12), rng.uniform(1.95, h - 0.08)
    paint = grey(rng, 0.75, 0.97) if rng.random() < 0.7 else body_paint(rng)
    inner = grey(rng, 0.5, 0.95)
    t = 0.04
    parts: list[Part] = [(paint, box((t, d, h), (s * (w - t) / 2, 0, h / 2))) for s in SIDES]
    cheek = (w - ow) / 2
    parts += [(paint, box((cheek, t, h), (s * (w - cheek) / 2, (d - t) / 2, h / 2))) for s in SIDES]
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
    for sx in SIDES:
        parts.append((coat, cylinder(0.022, 0.07, (sx * 0.05, 0.3, 0.53), 0.004, n=8)))
        for y in (-0.19, 0.19):
            parts.append((coat, rod((sx * 0.07, y, 0.0), (sx * 0.07, y, 0.34), 0.028)))
    grown = [(p, replace(m, vertices=m.vertices * k)) for p, m in parts]
    return Item("pet", (0.22 * k, 0.92 * k, 0.6 * k), tuple(grown))


SMALL: tuple[Maker, ...] = (
    carton, carton, bag, bin_, basket, plant, plant, floor_lamp, stool, shoes, toy, robot_cleaner,
    suitcase,
)  # fmt: skip
BLOCKERS: tuple[Maker, ...] = (
    carton, carton, suitcase, basket, plant, stool, person, drying_rack, bin_, bag,
)  # fmt: skip
WALL: tuple[Maker, ...] = (painting, painting, painting, poster, clock, shelf, shelf, coats)
