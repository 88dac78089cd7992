"""From an octree to a grid on the floor: claim 5, 3.1."""

import numpy as np
from numpy.typing import NDArray

from vnav.config import FuseConfig
from vnav.core.arrays import Array
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.errors import MapError

_ROUNDING_M = 1e-6  # heights that differ by less are the same
_SLAB_M = 0.10  # below the least drop: what is free deeper may be the storey below


def project(
    voxels_world: Array, occupied: NDArray[np.bool_], size_m: Array, config: FuseConfig
) -> Grid:
    """The grid of cells that a robot on the floor at z = 0 can, cannot, or may not drive on.

    A cell is occupied where an occupied voxel lies between ``obstacle_min_m`` and
    ``robot_height_m``, and where the floor drops: one sees deeper than ``obstacle_min_m``, and no
    floor; else free where floor (occupied, about z = 0) or a free voxel was seen within
    ``free_height_m``; else unknown. A voxel that straddles the lower limit counts where its centre
    lies above, so that the floor and its noise stay floor; at the upper limit one that touches it
    counts, since that surface may be as near as the limit.

    Parameters
    ----------
    voxels_world
        (N, 3) centres of the octree's leaves, metres, z up.
    occupied
        (N,) whether a leaf is occupied, else it is free.
    size_m
        (N,) edges; leaves larger than ``octree_m`` stand for all the voxels they hold.

    Returns
    -------
    Grid
        Cells of ``octree_m``, along the axes, just large enough for all that is known.

    Raises
    ------
    MapError
        Where no leaf says anything about the floor or an obstacle, as where there is no leaf.
    """
    voxels, size = np.asarray(voxels_world, float).reshape(-1, 3), np.asarray(size_m, float)
    low = voxels[:, 2] - (size - config.octree_m) / 2  # of the lowest voxel's centre
    high = voxels[:, 2] + (size - config.octree_m) / 2
    top = config.robot_height_m + config.octree_m / 2 + _ROUNDING_M
    obstacle = occupied & (high >= config.obstacle_min_m - _ROUNDING_M) & (low <= top)
    near_floor = (high >= -config.free_height_m) & (low <= config.free_height_m)
    floor = near_floor & ~obstacle
    if not (obstacle | floor).any():
        raise MapError(
            f"expected floor or obstacles up to {config.robot_height_m:g} m above it in the octree,"
            f" found none in {len(voxels)} leaves; see with 'vnav info' whether depth was fused and"
            " the floor was found"
        )
    lip = -config.obstacle_min_m - _ROUNDING_M
    deep = ~occupied & (low < lip) & (high > lip - _SLAB_M)
    first, last = _footprints(voxels, size, config.octree_m)
    corner = first[obstacle | floor].min(0)
    shape = last[obstacle | floor].max(0) - corner

    def holding(leaves: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which cells hold any of these leaves."""
        begin, end = (np.clip(edges[leaves] - corner, 0, shape) for edges in (first, last))
        return _covered(begin, end, shape)

    drop = holding(deep) & ~holding(floor & occupied)
    cells = np.full((shape[1], shape[0]), UNKNOWN, np.uint8)
    cells[holding(floor)] = FREE
    cells[holding(obstacle) | drop & holding(floor)] = OCCUPIED
    x, y = (float(c) for c in np.round(corner * config.octree_m, 9))
    return Grid((x, y), config.octree_m, cells)


def _footprints(
    voxels: Array, size: Array, cell_m: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Column and row (N, 2) of each leaf's first cell, and of the one after its last."""
    first = np.rint((voxels[:, :2] - size[:, None] / 2) / cell_m).astype(np.intp)
    return first, first + np.rint(size / cell_m).astype(np.intp)[:, None]


def _covered(
    first: NDArray[np.intp], last: NDArray[np.intp], shape: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Cells (rows, columns) under any of the rectangles, by sums over their corners."""
    corners = np.zeros((shape[1] + 1, shape[0] + 1), np.int32)
    for (x, y), sign in (
        ((first[:, 0], first[:, 1]), 1),
        ((last[:, 0], first[:, 1]), -1),
        ((first[:, 0], last[:, 1]), -1),
        ((last[:, 0], last[:, 1]), 1),
    ):
        np.add.at(corners, (y, x), sign)
    return np.asarray(corners.cumsum(0).cumsum(1)[:-1, :-1] > 0)
