"""Coloured points and surfaces in the world."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import frozen


@dataclass(frozen=True)
class PointCloud:
    """``points_world`` (N, 3) float32 in metres, ``colors`` (N, 3) uint8 RGB; N = 0 is legal."""

    points_world: NDArray[np.float32]
    colors: NDArray[np.uint8]

    def __post_init__(self) -> None:
        n = len(self.points_world)
        object.__setattr__(self, "points_world", frozen(self.points_world, np.float32, (n, 3)))
        object.__setattr__(self, "colors", frozen(self.colors, np.uint8, (n, 3)))

    def __len__(self) -> int:
        return len(self.points_world)


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh; no vertices are legal.

    Parameters
    ----------
    vertices_world, normals_world
        (N, 3) float32: positions in metres, and unit vectors towards the seen side.
    colors
        (N, 3) uint8, RGB.
    triangles
        (M, 3) int32: rows of the vertices, anticlockwise seen from outside.
    """

    vertices_world: NDArray[np.float32]
    normals_world: NDArray[np.float32]
    colors: NDArray[np.uint8]
    triangles: NDArray[np.int32]

    def __post_init__(self) -> None:
        n, m = len(self.vertices_world), len(self.triangles)
        for name in ("vertices_world", "normals_world"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float32, (n, 3)))
        object.__setattr__(self, "colors", frozen(self.colors, np.uint8, (n, 3)))
        object.__setattr__(self, "triangles", frozen(self.triangles, np.int32, (m, 3)))
