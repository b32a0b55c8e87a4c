"""What stands where in a furnished home, seen from above."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.homes.furnish import Furnished, footprint
from doorway3ds.lab.sim.homes.mesh import Mesh
from doorway3ds.lab.sim.homes.shell import frame_parts, leaf_of

Float = NDArray[np.float64]
CELL_M = 0.01
LOW_M = 0.04


@dataclass(frozen=True)
class Plan:
    """Occupied ground of a furnished home, from the meshes that stand in it."""

    furnished: Furnished
    height_m: float = 1.3

    @cached_property
    def origin(self) -> Float:
        rooms = self.furnished.home.rooms
        return np.array([min(r.x0 for r in rooms), min(r.y0 for r in rooms)]) - 0.5

    @cached_property
    def occupied(self) -> NDArray[np.uint8]:
        """(rows, columns) of CELL_M: 1 where something stands between LOW_M and height_m, or
        where steps lead up or down."""
        grid = self._empty()
        for p in (*self.furnished.standing, *self.furnished.hung):
            placed = (mesh.moved((p.x, p.y, p.z), p.yaw_deg) for _, mesh in p.item.parts)
            self._draw(grid, placed)
            if p.item.name == "closet":  # one stands before it, not in it
                x0, y0, x1, y1 = footprint(p.item, p.x, p.y, p.yaw_deg)
                self._fill(grid, _rectangle(x0, y0, x1, y1), 1)
        for flight in self.furnished.home.flights:
            self._fill(grid, _rectangle(*flight.rect), 1)
        for portal in self.furnished.home.portals:
            leaf = leaf_of(self.furnished.home, portal)
            if leaf is not None:
                run = np.array(leaf.direction) * leaf.length / 2
                side = np.array([-leaf.direction[1], leaf.direction[0]]) * 0.02
                middle = np.array([leaf.x, leaf.y])
                box = [middle + a * run + b * side for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
                self._fill(grid, np.stack(box), 1)
        return grid

    @cached_property
    def walls(self) -> NDArray[np.uint8]:
        """(rows, columns) of CELL_M: 1 where a wall, a window or a door frame stands."""
        home = self.furnished.home
        grid = self._empty()
        half = home.wall_m / 2
        for room in home.rooms:
            ring = self._empty()
            self._fill(ring, _rectangle(*room.inner(-home.wall_m)), 1)
            self._fill(ring, _rectangle(*room.inner(home.wall_m)), 0)
            grid |= ring
        for portal in home.portals:
            if portal.is_open:
                # A cell more on each side: a wall that two rooms share is drawn by both.
                ends = [
                    portal.point(along, across)
                    for along in portal.free
                    for across in (-half - CELL_M, half + CELL_M)
                ]
                (x0, y0), (x1, y1) = np.min(ends, axis=0), np.max(ends, axis=0)
                self._fill(grid, _rectangle(x0, y0, x1, y1), 0)
        for portal in home.portals:
            self._draw(grid, (mesh for _, mesh in frame_parts(home, portal, "", "")))
        return grid

    @cached_property
    def _taken(self) -> NDArray[np.uint8]:
        return self.occupied | self.walls

    def taken_at(self, points: Float) -> NDArray[np.bool_]:
        """Whether plan points (..., 2) lie on something that stands, a wall or a frame."""
        cells = np.floor((points - self.origin) / CELL_M).astype(int)
        taken = self._taken
        rows = np.clip(cells[..., 1], 0, taken.shape[0] - 1)
        columns = np.clip(cells[..., 0], 0, taken.shape[1] - 1)
        return np.asarray(taken[rows, columns] > 0)

    def free_at(self, x: float, y: float, radius: float) -> bool:
        """Whether no thing stands around a place; walls are not asked."""
        column, row = ((np.array([x, y]) - self.origin) / CELL_M).astype(int)
        r = int(radius / CELL_M)
        patch = self.occupied[max(row - r, 0) : row + r + 1, max(column - r, 0) : column + r + 1]
        return not bool(patch.any())

    def _empty(self) -> NDArray[np.uint8]:
        rooms = self.furnished.home.rooms
        far = np.array([max(r.x1 for r in rooms), max(r.y1 for r in rooms)]) + 0.5
        columns, rows = np.ceil((far - self.origin) / CELL_M).astype(int)
        return np.zeros((rows, columns), np.uint8)

    def _draw(self, grid: NDArray[np.uint8], parts: Iterable[Mesh]) -> None:
        for mesh in parts:
            z = mesh.vertices[:, 2]
            # The whole part: the walls of a wardrobe alone would leave its inside free.
            if z.max() <= LOW_M or z.min() >= self.height_m:
                continue
            for triangle in self._cells(mesh.vertices[mesh.faces][:, :, :2]):
                cv2.fillConvexPoly(grid, triangle, 1, shift=4)

    def _fill(self, grid: NDArray[np.uint8], outline: Float, value: int) -> None:
        cv2.fillConvexPoly(grid, self._cells(outline), value, shift=4)

    def _cells(self, points: Float) -> NDArray[np.int32]:
        """Plan points as cells in sixteenths."""
        return np.round(((points - self.origin) / CELL_M - 0.5) * 16).astype(np.int32)


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> Float:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
