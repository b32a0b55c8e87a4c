"""Pictures for a room's walls, floor and ceiling, soft light and contact shadows painted in."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.homes.apartment import Room
from doorway3ds.lab.sim.homes.furnish import Furnished, footprint
from doorway3ds.lab.sim.homes.furniture import X, Y, Z
from doorway3ds.lab.sim.homes.shell import INWARD
from doorway3ds.lab.sim.render import textures

Rng = np.random.Generator
Picture = NDArray[np.float32]
Face = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Where a face begins, its two axes and its normal."""


def repeat(tile: Picture, height: int, width: int) -> Picture:
    """A seamless tile laid over (height, width)."""
    rows = np.arange(height) % tile.shape[0]
    columns = np.arange(width) % tile.shape[1]
    return np.asarray(tile[rows][:, columns])


Glow = list[tuple[tuple[float, float, float], float]]


def glow_of(furnished: Furnished, room: Room) -> Glow:
    """Points (x, y, z) where a room's light comes from, each with its strength."""
    home = furnished.home
    lamp = 1.6 * max(room.light)
    glow: Glow = [((x, y, home.ceiling_m - 0.25), lamp) for x, y in room.lamps]
    for portal in home.portals_of(room.index):
        x, y = portal.point(0.0, 0.3 * portal.side(room.index))
        z = (portal.sill + portal.height) / 2
        if -1 in portal.rooms:
            glow.append(((x, y, z), 1.8 * portal.width * home.style["day"] + 0.02))
        elif portal.is_open:
            other = portal.rooms[0] if portal.rooms[1] == room.index else portal.rooms[1]
            glow.append(((x, y, z), 0.5 * max(home.rooms[other].light)))
    return glow


def light_on(glow: Glow, points: NDArray[np.float64], normal: NDArray[np.float64]) -> Picture:
    """Brightness at (h, w, 3) points of one face, about 0.6..1.1."""
    total = np.zeros(points.shape[:2])
    for at, strength in glow:
        to = np.array(at) - points
        d2 = (to**2).sum(-1)
        facing = np.clip((to @ normal) / np.sqrt(d2 + 1e-6), 0.08, 1.0)
        total += strength * facing / (0.8 + d2)
    level = total / max(float(np.median(total)), 1e-3)
    return (0.62 + 0.3 * np.clip(level, 0, 2.0) ** 0.8).astype(np.float32)


def edge_shade(height: int, width: int, ppm: float) -> Picture:
    """Darkening towards the edges where faces meet; rows go up."""
    x = ((np.arange(width) + 0.5) / ppm)[None, :]
    y = ((np.arange(height) + 0.5) / ppm)[:, None]
    out = np.ones((height, width))
    for away in (x, width / ppm - x, y, height / ppm - y):
        out = out * (1 - 0.22 * np.exp(-away / 0.16) - 0.1 * np.exp(-away / 0.6))
    return out.astype(np.float32)


def _lit(
    tile: Picture, glow: Glow, face: Face, shape: tuple[int, int], ppm: float,
    shadow: Picture | float = 1.0,
) -> Picture:  # fmt: skip
    """A face laid out with tiles in a room's light; shadow: what is left of that."""
    start, u, v, normal = face
    rows, columns = (max(4, int(size / ppm * 8)) for size in shape)  # eight a metre
    b = (np.arange(rows) + 0.5) / rows * shape[0] / ppm
    a = (np.arange(columns) + 0.5) / columns * shape[1] / ppm
    points = start + a[None, :, None] * u + b[:, None, None] * v
    small = light_on(glow, points, normal)
    big = cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    light = np.asarray(big, np.float32) * edge_shade(*shape, ppm) * shadow
    return np.asarray(np.clip(repeat(tile, *shape) * light[..., None], 0, 1), np.float32)


def floor_picture(furnished: Furnished, room: Room, tile: Picture, ppm: float) -> Picture:
    """The floor of a room, row 0 at its low-y side."""
    x0, y0, x1, y1 = room.inner(furnished.home.wall_m)
    shape = (max(8, int((y1 - y0) * ppm)), max(8, int((x1 - x0) * ppm)))
    mask = np.zeros(shape, np.float32)
    for p in furnished.standing:
        if p.room == room.index:
            a = footprint(p.item, p.x, p.y, p.yaw_deg)
            low, high = ((int((x - x0) * ppm), int((y - y0) * ppm)) for x, y in (a[:2], a[2:]))
            cv2.rectangle(mask, low, high, 1.0, -1)
    near = cv2.GaussianBlur(mask, (0, 0), max(0.07 * ppm, 0.5))
    wide = cv2.GaussianBlur(mask, (0, 0), max(0.22 * ppm, 0.5))
    face = (np.array([x0, y0, 0.0]), X, Y, Z)
    return _lit(tile, glow_of(furnished, room), face, shape, ppm, 1 - 0.35 * near - 0.3 * wide)


def ceiling_picture(furnished: Furnished, room: Room, colour: Picture, ppm: float) -> Picture:
    x0, y0, x1, y1 = room.inner(furnished.home.wall_m)
    shape = (max(8, int((y1 - y0) * ppm)), max(8, int((x1 - x0) * ppm)))
    face = (np.array([x0, y0, furnished.home.ceiling_m]), X, Y, -Z)
    return _lit(colour[None, None], glow_of(furnished, room), face, shape, ppm)


def wall_picture(
    furnished: Furnished,
    room: Room,
    side: int,
    start: NDArray[np.float64],
    length: float,
    tile: Picture,
    ppm: float,
) -> Picture:
    """One wall face, row 0 at the floor, with shadows behind what stands against it."""
    home = furnished.home
    shape = (max(8, int(home.ceiling_m * ppm)), max(8, int(length * ppm)))
    mask = np.zeros(shape, np.float32)
    axis = 1 if side < 2 else 0
    for p in furnished.standing:
        if p.room != room.index:
            continue
        r = footprint(p.item, p.x, p.y, p.yaw_deg)
        gap = (r[0] - start[0], start[0] - r[2], r[1] - start[1], start[1] - r[3])[side]
        if gap < 0.25:
            a, b = (r[axis] - start[axis]) * ppm, (r[axis + 2] - start[axis]) * ppm
            cv2.rectangle(mask, (int(a), 0), (int(b), int(p.item.size[2] * ppm)), 1.0, -1)
    for p in furnished.hung:
        if p.room == room.index and p.z < home.ceiling_m - 0.01:
            off = (p.x - start[0], p.y - start[1])[1 - axis]
            if abs(off) < 0.05:
                c = (p.x, p.y)[axis] - start[axis]
                w, h = p.item.size[0] / 2, p.item.size[2] / 2
                low = int((c - w) * ppm), int((p.z - h - 0.03) * ppm)
                cv2.rectangle(mask, low, (int((c + w) * ppm), int((p.z + h) * ppm)), 0.7, -1)
    dark = cv2.GaussianBlur(mask, (0, 0), max(0.06 * ppm, 0.5))
    face = (start, Y if side < 2 else X, Z, INWARD[side])
    return _lit(tile, glow_of(furnished, room), face, shape, ppm, 1 - 0.4 * dark)


def skybox(rng: Rng, size: int, day: bool) -> NDArray[np.uint8]:
    """Six faces stacked (6 * size, size, 3): right, left, up, down, front, back as MuJoCo wants."""
    panorama = textures.outside(rng, size, 4 * size)
    if not day:
        panorama = panorama * 0.12
    sides = [panorama[:, i * size : (i + 1) * size] for i in range(4)]
    up = np.broadcast_to(panorama[0].mean(0), (size, size, 3))
    down = np.broadcast_to(panorama[-1].mean(0), (size, size, 3))
    # Around the horizon: front, right, back, left.
    faces = [sides[1], sides[3], up, down, sides[0], sides[2]]
    return (np.concatenate(faces) * 255).astype(np.uint8)
