"""Space in cubes: where something stands."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core.arrays import frozen


@dataclass(frozen=True)
class Voxels:
    """Cubes of edge ``edge_m``, in which something stands or not.

    ``solid`` (X, Y, Z) bool; ``origin`` (3,) float64 in metres: the outer corner of the first.
    """

    solid: NDArray[np.bool_]
    origin: NDArray[np.float64]
    edge_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "solid", frozen(self.solid, bool, (None, None, None)))
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
        return cls(solid, origin, edge_m)

    def stands_at(self, points: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """Whether something stands at points (..., 3); outside of the voxels nothing does."""
        cell = np.floor((points - self.origin) / self.edge_m).astype(np.intp)
        inside = ((cell >= 0) & (cell < self.solid.shape)).all(-1)
        found = np.zeros(inside.shape, bool)
        found[inside] = self.solid[tuple(cell[inside].T)]
        return found
