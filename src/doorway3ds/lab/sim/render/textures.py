"""Procedural surface pictures: floors, walls, textiles, woods, paintings, the view outside.

Every maker takes (rng, pixels a metre) or a size, and returns (H, W, 3) float32 in 0..1.
Tiles repeat without a seam unless their maker says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

Rng = np.random.Generator
Picture = NDArray[np.float32]


def noise(rng: Rng, height: int, width: int, cell: float, octaves: int = 3) -> Picture:
    """Smooth seamless noise (height, width) in about -1..1; `cell` pixels is the coarsest grain."""
    out = np.zeros((height, width), np.float32)
    weight = 1.0
    for _ in range(octaves):
        rows, columns = max(2, round(height / cell)), max(2, round(width / cell))
        grid = rng.standard_normal((rows, columns)).astype(np.float32)
        # Wrapping the grid by two cells before enlarging keeps the tile seamless.
        wrapped = np.pad(grid, 2, mode="wrap")
        whole = round(width * (columns + 4) / columns), round(height * (rows + 4) / rows)
        big = cv2.resize(wrapped, whole, interpolation=cv2.INTER_CUBIC)
        top, left = round(2 * height / rows), round(2 * width / columns)
        out += weight * big[top : top + height, left : left + width]
        weight *= 0.5
        cell = max(cell / 2, 1.0)
    return out * 0.5


def flat(colour: tuple[float, float, float] | Picture, height: int, width: int) -> Picture:
    return np.broadcast_to(np.asarray(colour, np.float32), (height, width, 3)).copy()


def hsv(hue: float, saturation: float, value: float) -> Picture:
    """One colour (3,) from hue 0..1, saturation and value."""
    pixel = np.array([[[hue % 1.0 * 360.0, saturation, value]]], np.float32)
    return np.asarray(cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB)[0, 0], np.float32)


def shade(picture: Picture, by: Picture) -> Picture:
    """Multiplied by 1 + by (H, W)."""
    return np.clip(picture * (1.0 + by[..., None]), 0.0, 1.0).astype(np.float32)


WOODS = (
    (0.085, 0.45, 0.75),
    (0.075, 0.55, 0.5),
    (0.06, 0.6, 0.32),
    (0.09, 0.3, 0.82),
    (0.07, 0.15, 0.55),
    (0.05, 0.65, 0.42),
    (0.1, 0.25, 0.9),
)


def wood_colour(rng: Rng) -> Picture:
    h, s, v = WOODS[rng.integers(len(WOODS))] + rng.normal(0, (0.008, 0.06, 0.06))
    return hsv(h, np.clip(s, 0, 1), np.clip(v, 0.1, 0.95))


def grain(rng: Rng, height: int, width: int, strength: float = 0.12) -> Picture:
    """Wood grain that runs along the rows."""
    size, cubic = (width, height), cv2.INTER_CUBIC
    short = rng.standard_normal((height, max(2, width // 24))).astype(np.float32)
    fine = cv2.resize(short, size, interpolation=cubic)
    long = noise(rng, height, max(4, width // 6), height / 4)
    slow = cv2.resize(long, size, interpolation=cubic)
    rings = np.sin(5.0 * slow + np.linspace(0, 40, height, dtype=np.float32)[:, None])
    return np.asarray(strength * (0.4 * fine + 0.3 * rings), np.float32)


def wood(rng: Rng, ppm: float) -> Picture:
    """One metre of plain wood for furniture and door leaves."""
    size = int(ppm)
    plain, strength = flat(wood_colour(rng), size, size), rng.uniform(0.03, 0.15)
    return shade(plain, grain(rng, size, size, strength))


def planks(rng: Rng, ppm: float) -> Picture:
    """Two metres of floor boards or laminate."""
    size = int(2 * ppm)
    rows = int(rng.choice([10, 12, 16, 20, 26]))
    base = wood_colour(rng)
    out = flat(base, size, size)
    spread = rng.uniform(0.02, 0.14)
    edges = np.linspace(0, size, rows + 1).round().astype(int)
    tone = grain(rng, size, size, rng.uniform(0.03, 0.12))
    for top, bottom in pairwise(edges):
        start = int(rng.integers(size))
        for piece in range(2):
            a = (start + piece * size // 2) % size
            columns = np.arange(a, a + size // 2) % size
            tone[top:bottom, columns] += rng.normal(0, spread)
            tone[top:bottom, a % size] -= 0.25
        tone[top] -= 0.28
    return shade(out, tone)


def herringbone(rng: Rng, ppm: float) -> Picture:
    """About 1.2 m of block parquet."""
    unit = max(4, int(0.1 * ppm))
    blocks = 4  # length of a block in widths
    size = unit * blocks * 2
    y, x = np.mgrid[0:size, 0:size] // unit
    phase = (x - y) % (2 * blocks)
    lying = phase < blocks
    block = np.where(lying, (x - phase) * 31 + y * 17, (y + phase) * 13 + x * 57) % 97
    tones = rng.normal(0, rng.uniform(0.05, 0.13), 97).astype(np.float32)
    g = grain(rng, size, size, 0.08)
    tone = tones[block] + np.where(lying, g, g.T)
    yy, xx = np.mgrid[0:size, 0:size]
    tone -= 0.2 * (lying & (yy % unit == 0)) + 0.2 * (~lying & (xx % unit == 0))
    return shade(flat(wood_colour(rng), size, size), tone.astype(np.float32))


def tiles(rng: Rng, ppm: float) -> Picture:
    """1.2 m of stone or ceramic tiles, at times two-coloured."""
    count = int(rng.choice([2, 3, 4, 6, 8]))
    size = int(1.2 * ppm) // count // 2 * 2 * count
    y, x = np.mgrid[0:size, 0:size]
    side = size // count
    base = hsv(rng.uniform(0, 1), rng.uniform(0, 0.25) ** 1.5, rng.uniform(0.35, 0.95))
    out = flat(base, size, size)
    if count % 2 == 0 and rng.random() < 0.25:
        other = hsv(rng.uniform(0, 1), rng.uniform(0, 0.5), rng.uniform(0.1, 0.7))
        out[(x // side + y // side) % 2 == 1] = other
    tone = noise(rng, size, size, side, 4) * rng.uniform(0.01, 0.1)
    tone += rng.normal(0, 0.02, (count, count)).astype(np.float32)[y // side, x // side]
    joint = (x % side < max(1, side // 50)) | (y % side < max(1, side // 50))
    out = shade(out, tone)
    out[joint] = np.clip(out[joint] * rng.uniform(0.6, 0.9) + rng.uniform(-0.05, 0.12), 0, 1)
    return out


def carpet(rng: Rng, ppm: float) -> Picture:
    """A metre of short pile."""
    size = int(ppm)
    base = hsv(rng.uniform(0, 1), rng.uniform(0.02, 0.6) ** 1.6, rng.uniform(0.2, 0.75))
    tone = 0.05 * noise(rng, size, size, size / 3, 3)
    tone += rng.normal(0, 0.07, (size, size)).astype(np.float32)
    return shade(flat(base, size, size), tone)


def concrete(rng: Rng, ppm: float) -> Picture:
    size = int(2 * ppm)
    base = hsv(rng.uniform(0, 1), 0.03, rng.uniform(0.35, 0.7))
    return shade(flat(base, size, size), 0.12 * noise(rng, size, size, size / 3, 6))


def plaster(rng: Rng, ppm: float) -> Picture:
    """A metre of painted wall: mostly white to cream, at times a colour."""
    size = int(ppm)
    kind = rng.random()
    if kind < 0.62:
        base = hsv(rng.uniform(0.08, 0.16), rng.uniform(0.0, 0.12), rng.uniform(0.82, 0.97))
    elif kind < 0.9:
        base = hsv(rng.uniform(0, 1), rng.uniform(0.04, 0.22), rng.uniform(0.65, 0.92))
    else:
        base = hsv(rng.uniform(0, 1), rng.uniform(0.2, 0.5), rng.uniform(0.35, 0.75))
    tone = 0.02 * noise(rng, size, size, size / 2, 3)
    tone += rng.normal(0, rng.uniform(0, 0.012), (size, size)).astype(np.float32)
    return shade(flat(base, size, size), tone)


def wallpaper(rng: Rng, ppm: float) -> Picture:
    """A metre of stripes, dots, diamonds or leaves on a calm ground."""
    size = int(ppm)
    base = hsv(rng.uniform(0, 1), rng.uniform(0.02, 0.25), rng.uniform(0.6, 0.95))
    ink = np.clip(base * rng.uniform(0.7, 1.15) + rng.normal(0, 0.06, 3), 0, 1)
    count = int(rng.choice([4, 5, 8, 10]))
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) / size * count
    kind = int(rng.integers(4))
    if kind == 0:
        mask = (x % 1.0) < rng.uniform(0.3, 0.6)
    elif kind == 1:
        mask = np.hypot(x % 1 - 0.5, (y + 0.5 * (np.floor(x) % 2)) % 1 - 0.5) < 0.22
    elif kind == 2:
        mask = (np.abs((x + y) % 1 - 0.5) < 0.06) | (np.abs((x - y) % 1 - 0.5) < 0.06)
    else:
        mask = np.sin(2 * np.pi * x + 1.5 * np.sin(2 * np.pi * y)) > 0.6
    out = flat(base, size, size)
    out[mask] = ink
    return shade(out, 0.015 * noise(rng, size, size, size / 2))


def brick(rng: Rng, ppm: float) -> Picture:
    """A metre of bare or painted brick."""
    rows, columns = 12, 4
    size = max(1, round(ppm / (2 * rows))) * 2 * rows
    y, x = np.mgrid[0:size, 0:size]
    row = y * rows // size
    xs = (x + (row % 2) * size // (2 * columns)) % size
    column = xs * columns // size
    base = hsv(rng.uniform(0.0, 0.06), rng.uniform(0.3, 0.6), rng.uniform(0.4, 0.65))
    if rng.random() < 0.4:
        base = hsv(0.1, 0.05, rng.uniform(0.8, 0.95))
    tone = rng.normal(0, 0.1, (rows, columns)).astype(np.float32)[row, column]
    tone += 0.06 * noise(rng, size, size, 12)
    out = shade(flat(base, size, size), tone)
    wide = size / rows * 0.12
    joint = (y % (size // rows) < wide) | (xs % (size // columns) < wide)
    out[joint] = np.clip(base.mean() * 0.75 + 0.15, 0, 1)
    return out


def fabric(rng: Rng, ppm: float) -> Picture:
    """Half a metre of cloth: plain weave, stripes or plaid."""
    size = int(ppm)
    base = hsv(rng.uniform(0, 1), rng.uniform(0.02, 0.85) ** 1.8, rng.uniform(0.15, 0.92))
    out = flat(base, size, size)
    kind = rng.random()
    if kind > 0.55:
        ramp = np.arange(size) / size
        for _ in range(int(rng.integers(1, 4))):
            ink = hsv(rng.uniform(0, 1), rng.uniform(0, 0.7), rng.uniform(0.1, 0.95))
            count, width = int(rng.integers(2, 9)), rng.uniform(0.08, 0.5)
            stripe = ((ramp * count + rng.random()) % 1) < width
            out[:, stripe] = 0.5 * out[:, stripe] + 0.5 * ink
            if kind > 0.8:
                out[stripe] = 0.5 * out[stripe] + 0.5 * ink
    weave = rng.normal(0, 0.05, (size, size)).astype(np.float32)
    return shade(out, weave + 0.04 * noise(rng, size, size, size / 3))


def curtain(rng: Rng, ppm: float) -> Picture:
    """A metre of hanging cloth, its folds painted in."""
    out = np.tile(fabric(rng, ppm / 2), (2, 2, 1))
    size = out.shape[1]
    folds = int(rng.integers(6, 14))
    wave = np.sin(2 * np.pi * folds * np.arange(size) / size).astype(np.float32)
    return shade(out, np.broadcast_to(0.22 * wave, out.shape[:2]))


def rug(rng: Rng, height: int, width: int) -> Picture:
    """A whole rug with borders, rings or bands (does not repeat)."""
    colours = [hsv(*rng.uniform((0, 0.1, 0.2), (1, 0.7, 0.9))) for _ in range(4)]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    edge = np.minimum.reduce([x, y, width - 1 - x, height - 1 - y]) / min(height, width)
    kind = int(rng.integers(4))
    if kind == 0:
        band = np.clip(edge * rng.uniform(6, 14), 0, 3.99).astype(int)
    elif kind == 1:
        band = ((x / width * rng.integers(4, 14)).astype(int)) % 4
    elif kind == 2:
        band = ((np.abs(x - width / 2) + np.abs(y - height / 2)) / width * 8).astype(int) % 4
    else:
        band = np.clip((noise(rng, height, width, width / 3, 4) + 1) * 2, 0, 3.99).astype(int)
    out = np.stack(colours)[band].astype(np.float32)
    return shade(out, rng.normal(0, 0.06, (height, width)).astype(np.float32))


def painting(rng: Rng, height: int, width: int) -> Picture:
    """Something framed on a wall: landscape, blots, a grid of colour, clouds."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    kind = int(rng.integers(4))
    if kind == 0:
        out = outside(rng, height, width)
    elif kind == 1:
        out = flat(hsv(rng.random(), 0.2, rng.uniform(0.5, 0.95)), height, width)
        for _ in range(int(rng.integers(3, 12))):
            colour = hsv(rng.random(), rng.uniform(0.2, 0.9), rng.uniform(0.1, 0.95))
            centre = (int(rng.integers(width)), int(rng.integers(height)))
            axes = tuple(int(v) for v in rng.integers(2, max(3, width // 3), 2))
            colour_tuple = tuple(float(c) for c in colour)
            cv2.ellipse(out, centre, axes, float(rng.uniform(0, 180)), 0, 360, colour_tuple, -1)
    elif kind == 2:
        rows, columns = rng.integers(2, 6, 2)
        grid = np.stack([hsv(*rng.random(3)) for _ in range(rows * columns)])
        cell = (y * rows / height).astype(int) * columns + (x * columns / width).astype(int)
        out = grid[cell].astype(np.float32)
    else:
        tone = noise(rng, height, width, width / 2, 4)
        out = shade(flat(hsv(rng.random(), rng.uniform(0, 0.6), 0.5), height, width), 0.7 * tone)
    margin = max(1, int(min(height, width) * rng.choice([0.0, 0.08, 0.18])))
    framed = flat(hsv(0.1, 0.03, 0.93), height, width)
    framed[margin:-margin, margin:-margin] = out[margin:-margin, margin:-margin]
    return framed


def books(rng: Rng, height: int, width: int) -> Picture:
    """Spines on a shelf, dark gap above them."""
    out = flat((0.05, 0.04, 0.04), height, width)
    x = 0
    while x < width:
        w = int(rng.integers(max(2, width // 40), max(4, width // 14)))
        top = int(height * rng.uniform(0.05, 0.35))
        colour = hsv(rng.random(), rng.uniform(0, 0.8) ** 1.6, rng.uniform(0.1, 0.9))
        if rng.random() < 0.93:
            out[top:, x : x + w] = colour
            out[top + height // 8 : top + height // 5, x : x + w] = np.clip(colour + 0.3, 0, 1)
            out[top:, x] *= 0.5
        x += w
    return out


def screen(rng: Rng, height: int, width: int) -> Picture:
    """A television or monitor: mostly off."""
    if rng.random() < 0.6:
        return flat((0.03, 0.03, 0.035), height, width)
    return painting(rng, height, width) * 0.9


def outside(rng: Rng, height: int, width: int) -> Picture:
    """Sky, far houses or hills, trees; seamless to left and right. Night in one of six."""
    night = rng.random() < 0.16
    y = np.linspace(0, 1, height, dtype=np.float32)[:, None, None]
    zenith = hsv(rng.uniform(0.54, 0.62), rng.uniform(0.05, 0.6), rng.uniform(0.7, 1.0))
    haze = hsv(rng.uniform(0.05, 0.6), rng.uniform(0.0, 0.15), rng.uniform(0.85, 1.0))
    out = (zenith * (1 - y) + haze * y) * np.ones((1, width, 1), np.float32)
    out = out + 0.12 * np.clip(noise(rng, height, width, height / 2, 5), 0, 1)[..., None]
    horizon = int(height * rng.uniform(0.48, 0.55))
    x = 0
    while x < width:
        w = int(rng.integers(max(3, width // 30), max(5, width // 8)))
        top = horizon - int(height * rng.uniform(0.02, 0.3) * (rng.random() < 0.7))
        wall = hsv(rng.uniform(0, 0.15), rng.uniform(0, 0.4), rng.uniform(0.3, 0.8))
        out[top:, x : x + w] = wall
        step = max(3, height // 40)
        out[top + 2 : horizon : step * 2, x + 1 : x + w : step * 2] = wall * 0.4
        x += w
    out[horizon:] = hsv(rng.uniform(0.2, 0.35), rng.uniform(0.1, 0.5), rng.uniform(0.25, 0.6))
    canopy = noise(rng, height, width, height / 8, 5)
    line = horizon - height * 0.1 + 0.35 * height * canopy[height // 2]
    rows = np.arange(height)[:, None]
    trees = (rows > line[None, :]) & (rows < horizon + height // 10)
    green = hsv(rng.uniform(0.18, 0.36), rng.uniform(0.3, 0.6), rng.uniform(0.2, 0.45))
    out[trees] = (green * (1 + 0.5 * canopy[..., None]))[trees]
    out = out * 0.06 if night else out
    return np.asarray(np.clip(out, 0, 1), np.float32)


def hazard_floor(rng: Rng, ppm: float, kind: str) -> Picture:
    """Floors that networks take for holes, steps or doorways: dark, shiny or patterned."""
    if kind != "patterned":
        plain = FLOORS[int(rng.integers(len(FLOORS)))](rng, ppm)
        return np.asarray(plain * (0.16 if kind == "dark" else 0.8), np.float32)
    size = int(2 * ppm) // 8 * 8
    y, x = np.mgrid[0:size, 0:size] // (size // int(rng.choice([2, 4, 8])))
    bright = (x % 2 == 0) if rng.random() < 0.5 else ((x + y) % 2 == 0)
    light = hsv(rng.uniform(0, 1), rng.uniform(0, 0.3), rng.uniform(0.75, 0.95))
    dark = hsv(rng.uniform(0, 1), rng.uniform(0, 0.6), rng.uniform(0.08, 0.35))
    return np.where(bright[..., None], light, dark).astype(np.float32)


Maker = Callable[[Rng, float], Picture]
FLOORS: tuple[Maker, ...] = (planks,) * 3 + (herringbone,)
FLOORS += (tiles, tiles, carpet, carpet, concrete)
WALLS: tuple[Maker, ...] = (plaster,) * 7 + (wallpaper,) * 2 + (brick,)
TILE_M = {"wood": 1.0, "fabric": 0.5, "curtain": 1.0}
"""How much furniture a tile covers."""
