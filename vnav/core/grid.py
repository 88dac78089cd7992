"""A 2D occupancy grid on the floor."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core.arrays import frozen

FREE, OCCUPIED, UNKNOWN, WALKED = 0, 1, 2, 3  # walked: unseen, but the camera was carried there
STATES = {"free": FREE, "occupied": OCCUPIED, "unknown": UNKNOWN, "walked": WALKED}


@dataclass(frozen=True)
class Grid:
    """Square cells of the real floor.

    Parameters
    ----------
    origin
        World x, y in metres of the outer corner of cell [0, 0].
    resolution_m
        Edge of a cell.
    cells
        (rows, columns) uint8 of FREE, OCCUPIED, UNKNOWN, WALKED; rows run along +y, columns along
        +x.
    """

    origin: tuple[float, float]
    resolution_m: float
    cells: NDArray[np.uint8]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cells", frozen(self.cells, np.uint8, (None, None)))

    def cells_at(self, points_xy: ArrayLike) -> NDArray[np.intp]:
        """Row and column (..., 2) of the cells that hold world points (..., 2); may lie outside."""
        p = (np.asarray(points_xy, float) - self.origin) / self.resolution_m
        return np.floor(p[..., ::-1]).astype(np.intp)

    def centres_of(self, cells: ArrayLike) -> NDArray[np.float64]:
        """World x, y (..., 2) of the centres of cells (..., 2) given as row, column."""
        rc = np.asarray(cells, float)
        return np.asarray((rc[..., ::-1] + 0.5) * self.resolution_m + self.origin)

    def contains(self, cells: ArrayLike) -> NDArray[np.bool_]:
        """Whether cells (..., 2) lie inside."""
        rc = np.asarray(cells)
        return np.asarray(((rc >= 0) & (rc < self.cells.shape)).all(-1))

    def touched(self, polygon_m: ArrayLike) -> NDArray[np.bool_]:
        """Which cells (rows, columns) a polygon (N, 2) holds, or its edges pass through.

        What lies inside is told by the even-odd rule, for the cells' centres.
        """
        corners = np.asarray(polygon_m, float)
        inside = self._holds(corners)
        along = self.cells_at(_outline(corners, self.resolution_m / 4))
        inside[tuple(along[self.contains(along)].T)] = True
        return inside

    def blocked(self, polygons_m: Iterable[ArrayLike]) -> "Grid":
        """The grid with every cell occupied that one of the polygons (N, 2) touches."""
        cells = self.cells.copy()
        for polygon in polygons_m:
            cells[self.touched(polygon)] = OCCUPIED
        return replace(self, cells=cells)

    def _holds(self, corners: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which centres (rows, columns) have an odd number of edges between them and +x."""
        x, y = np.moveaxis(self.centres_of(np.moveaxis(np.indices(self.cells.shape), 0, -1)), -1, 0)
        inside = np.zeros(self.cells.shape, bool)
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, 0), strict=True):
            passes = (ay > y) != (by > y)
            with np.errstate(
                divide="ignore", invalid="ignore", over="ignore"
            ):  # along x: passes nowhere
                inside ^= passes & (x < ax + (y - ay) * (bx - ax) / (by - ay))
        return inside

    def area_m2(self, state: int) -> float:
        """Floor area of the cells in one state, to a square centimetre: alike wherever shown."""
        return round(float((self.cells == state).sum() * self.resolution_m**2), 4)


def _outline(corners: NDArray[np.float64], spacing_m: float) -> NDArray[np.float64]:
    """Points (M, 2) along the edges of a closed polygon (N, 2), so far apart at most."""
    parts = []
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        steps = int(np.ceil(np.hypot(*(b - a)) / spacing_m))
        parts.append(a + (b - a) * np.linspace(0, 1, steps + 1)[:, None])
    return np.concatenate(parts)
