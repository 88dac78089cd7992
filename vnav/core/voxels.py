"""Space in cubes: where something stands, and how far away it is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core.arrays import frozen

FARTHEST = 40  # voxels: what is farther away than that is not told apart


@dataclass(frozen=True)
class Voxels:
    """Cubes of edge ``edge_m``, in which something stands or not.

    ``away`` (X, Y, Z) uint8: how many voxels away, along the axis on which it is most, the nearest
    is in which something stands; 0: this one, `FARTHEST`: at least so many. ``origin`` (3,)
    float64 in metres: the outer corner of the first.
    """

    away: NDArray[np.uint8]
    origin: NDArray[np.float64]
    edge_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "away", frozen(self.away, np.uint8, (None, None, None)))
        object.__setattr__(self, "origin", frozen(self.origin, float, (3,)))

    @classmethod
    def filled(cls, centres: ArrayLike, sizes_m: ArrayLike, edge_m: float) -> "Voxels":
        """The voxels that cubes fill, with centres (N, 3) and edges (N,), multiples of the voxel's.

        N = 0 is legal.
        """
        low = np.asarray(centres, float) - np.asarray(sizes_m, float)[:, None] / 2
        origin = low.min(0, initial=np.inf)
        origin = np.where(np.isfinite(origin), origin, 0.0)
        first = np.rint((low - origin) / edge_m).astype(np.intp)
        count = np.rint(np.asarray(sizes_m, float) / edge_m).astype(np.intp)
        solid = np.zeros((first + count[:, None]).max(0, initial=0), bool)
        for size in np.unique(count):
            corners = first[count == size]
            for shift in np.ndindex(size, size, size):
                solid[tuple((corners + shift).T)] = True
        return cls(_away(solid), origin, edge_m)

    @property
    def solid(self) -> NDArray[np.bool_]:
        """In which voxels (X, Y, Z) something stands."""
        return np.asarray(self.away == 0)

    def stands_at(self, points: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """Whether something stands at points (..., 3); outside of the voxels nothing does."""
        cells = np.floor((points - self.origin) / self.edge_m).astype(np.intp)
        return np.asarray(self.away_from(np.moveaxis(cells, -1, 0)) == 0)

    def away_from(self, cells: NDArray[np.intp]) -> NDArray[np.intp]:
        """How many voxels away something stands at least from cells (3, ...) of the voxels.

        From outside, it is as far as the voxels begin.
        """
        if not self.away.size:
            return np.full(cells.shape[1:], FARTHEST)
        size = np.array(self.away.shape).reshape(-1, *[1] * (cells.ndim - 1))
        x, y, z = inner = np.minimum(np.maximum(cells, 0), size - 1)
        found = self.away.reshape(-1).take((x * self.away.shape[1] + y) * self.away.shape[2] + z)
        outside = np.abs(cells - inner).max(0)
        return np.asarray(np.where(outside > 0, outside, found))


def _away(solid: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """How far away the nearest solid voxel is: how often they must grow by one to reach there."""
    away, reached = np.zeros(solid.shape, np.uint8), solid.copy()
    for _ in range(FARTHEST):
        if reached.all():
            break
        away += ~reached
        for axis in range(3):
            last = np.moveaxis(reached, axis, 0)
            before = last.copy()
            last[1:] |= before[:-1]
            last[:-1] |= before[1:]
    return away
