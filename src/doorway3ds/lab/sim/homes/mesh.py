"""Small triangle meshes with normals and texture coordinates in metres."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]


@dataclass(frozen=True)
class Mesh:
    """vertices (N, 3) metres, unit normals (N, 3), uv (N, 2) metres, faces (M, 3)."""

    vertices: Float
    normals: Float
    uv: Float
    faces: Int

    def moved(self, xyz: tuple[float, float, float], yaw_deg: float = 0.0) -> Mesh:
        """Turned about z by `yaw_deg`, then shifted."""
        turned = self.turned(rotation_z(yaw_deg))
        return replace(turned, vertices=turned.vertices + np.asarray(xyz))

    def grain_up(self) -> Mesh:
        """Texture turned by a quarter: the grain of an upright board."""
        return replace(self, uv=self.uv[:, ::-1])

    def turned(self, matrix: Float) -> Mesh:
        return replace(self, vertices=self.vertices @ matrix.T, normals=self.normals @ matrix.T)


def rotation_z(yaw_deg: float) -> Float:
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_x(angle_deg: float) -> Float:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def join(meshes: list[Mesh]) -> Mesh:
    """One mesh of several; they keep their own vertices."""
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.normals for m in meshes]),
        np.concatenate([m.uv for m in meshes]),
        np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]),
    )


def sheet(origin: Float, u_axis: Float, v_axis: Float, us: Float, vs: Float, normal: Float) -> Mesh:
    """A flat grid with corners at every (u, v); uv are the grid's own metres."""
    uu, vv = np.meshgrid(us, vs)
    flat = np.stack([uu.ravel(), vv.ravel()], -1)
    vertices = np.asarray(origin) + flat[:, :1] * u_axis + flat[:, 1:] * v_axis
    across, columns = len(us), len(us) - 1
    i, j = np.meshgrid(np.arange(columns), np.arange(len(vs) - 1))
    a = (j * across + i).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + across + 1], -1), np.stack([a, a + across + 1, a + across], -1)]
    )
    if np.dot(np.cross(u_axis, v_axis), normal) < 0:
        faces = faces[:, ::-1]
    return Mesh(vertices, np.tile(np.asarray(normal, float), (len(flat), 1)), flat, faces)


def steps(start: float, stop: float, pitch: float) -> Float:
    """Evenly spaced values from start to stop, at most `pitch` apart."""
    return np.linspace(start, stop, max(2, int(np.ceil((stop - start) / pitch)) + 1))


def box(size: tuple[float, float, float], centre: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    """A sharp box; texture runs along each face in metres, upright on the sides."""
    return rounded_box(size, 0.0, centre, 0)


@cache
def _unit_rounded(n: int) -> tuple[Float, Float, Int, Int]:
    """Of a rounded box: corner signs (N, 3), outward steps (N, 3), uv axes (N, 2), faces."""
    arc = np.sin(np.linspace(0, np.pi / 2, n + 1))
    steps_ = np.concatenate([-arc[::-1], arc])
    signs = np.repeat([-1.0, 1.0], n + 1)
    eye = np.eye(3)
    parts, corners, axes = [], [], []
    index = np.arange(2 * (n + 1), dtype=float)
    for axis, (u, v) in ((0, (1, 2)), (1, (0, 2)), (2, (0, 1))):
        for sign in (-1.0, 1.0):
            grid = sheet(np.zeros(3), eye[u], eye[v], index, index, eye[axis] * sign)
            i, j = grid.uv.astype(int).T
            out, corner = np.zeros((len(i), 3)), np.zeros((len(i), 3))
            out[:, axis] = corner[:, axis] = sign
            out[:, u], out[:, v] = steps_[i], steps_[j]
            corner[:, u], corner[:, v] = signs[i], signs[j]
            parts.append(Mesh(out, out, grid.uv, grid.faces))
            corners.append(corner)
            axes += [(u, v)] * len(i)
    whole = join(parts)
    return np.concatenate(corners), whole.vertices, np.array(axes), whole.faces


def rounded_box(
    size: tuple[float, float, float],
    radius: float,
    centre: tuple[float, float, float] = (0, 0, 0),
    n: int = 3,
) -> Mesh:
    """A box with edges rounded by `radius` (n rows of facets each): cushions, mattresses."""
    half = np.asarray(size, float) / 2
    radius = float(min(radius, *(half * 0.999)))
    corners, out, axes, faces = _unit_rounded(n)
    normals = out / np.linalg.norm(out, axis=1, keepdims=True)
    core = corners * (half - radius)
    uv = np.take_along_axis(core + out * radius + half, axes, axis=1)
    return Mesh(core + normals * radius + np.asarray(centre), normals, uv, faces)


def lathe(
    profile: list[tuple[float, float]],
    centre: tuple[float, float, float] = (0, 0, 0),
    n: int = 16,
    squash: float = 1.0,
) -> Mesh:
    """A (radius, z) profile turned about z; `squash` scales y (people, pillows)."""
    r, z = np.asarray(profile, float).T
    angle = np.linspace(0, 2 * np.pi, n + 1)
    ring = np.stack([np.cos(angle), np.sin(angle) * squash, np.zeros_like(angle)], -1)
    vertices = r[:, None, None] * ring + z[:, None, None] * np.array([0, 0, 1.0])
    dr, dz = np.gradient(r), np.gradient(z)
    out = np.stack([np.cos(angle), np.sin(angle) / squash, np.zeros_like(angle)], -1)
    normals = dz[:, None, None] * out - dr[:, None, None] * np.array([0, 0, 1.0])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    along = np.concatenate([[0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))])
    uv = np.stack(np.broadcast_arrays(angle[None, :] * max(r.max(), 1e-3), along[:, None]), -1)
    i, j = np.meshgrid(np.arange(n), np.arange(len(r) - 1))
    a = (j * (n + 1) + i).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + n + 2], -1), np.stack([a, a + n + 2, a + n + 1], -1)]
    )
    at = vertices.reshape(-1, 3) + np.asarray(centre)
    return Mesh(at, normals.reshape(-1, 3), uv.reshape(-1, 2), faces)


def cylinder(
    radius: float,
    height: float,
    base: tuple[float, float, float] = (0, 0, 0),
    top_radius: float | None = None,
    n: int = 12,
) -> Mesh:
    """An upright closed cylinder or cone stump standing on `base`."""
    top = radius if top_radius is None else top_radius
    rim = 1e-4
    profile = [(0.0, 0.0), (radius - rim, 0.0), (radius, rim), (top, height - rim)]
    profile += [(top - rim, height), (0.0, height)]
    return lathe(profile, base, n)


def ball(
    radii: tuple[float, float, float], centre: tuple[float, float, float] = (0, 0, 0), n: int = 12
) -> Mesh:
    """An ellipsoid."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, n // 2 + 1)
    unit = lathe([(float(np.cos(a)), float(np.sin(a))) for a in angle], n=n)
    scale = np.asarray(radii, float)
    normals = unit.vertices / scale
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    at = unit.vertices * scale + np.asarray(centre)
    return Mesh(at, normals, unit.uv * scale.max(), unit.faces)


def rod(
    start: tuple[float, float, float], stop: tuple[float, float, float], radius: float, n: int = 8
) -> Mesh:
    """A round bar between two points."""
    a, b = np.asarray(start, float), np.asarray(stop, float)
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(z, x), z], -1)
    bar = cylinder(radius, length, n=n).turned(turn)
    return replace(bar, vertices=bar.vertices + a)


def extrude(outline: list[tuple[float, float]], y0: float, y1: float) -> Mesh:
    """A convex outline in (x, z), counter-clockwise seen from -y, from y0 to y1."""
    points = np.asarray(outline, float)
    count = len(points)
    parts = []
    for y, sign in ((y0, -1.0), (y1, 1.0)):
        v = np.stack([points[:, 0], np.full(count, y), points[:, 1]], -1)
        fan = np.array([[0, i, i + 1] for i in range(1, count - 1)])
        normals = np.tile([0.0, sign, 0.0], (count, 1))
        parts.append(Mesh(v, normals, points, fan if sign < 0 else fan[:, ::-1]))
    for i in range(count):
        a, b = points[i], points[(i + 1) % count]
        d = b - a
        length = float(np.hypot(*d))
        if length < 1e-9:
            continue
        normal = np.array([d[1], 0.0, -d[0]]) / length
        start, run = np.array([a[0], y0, a[1]]), np.array([d[0], 0.0, d[1]]) / length
        us, vs = np.array([0.0, length]), np.array([0.0, y1 - y0])
        parts.append(sheet(start, run, np.array([0.0, 1.0, 0.0]), us, vs, normal))
    return join(parts)
