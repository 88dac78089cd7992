"""The walked corridor: floor that nobody saw, but over which the camera was carried."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.config import FuseConfig
from vnav.core.arrays import Array
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid

STRIDE_M = 0.5  # what lies between two frames farther apart than this is not known
REACH_M = 2.0  # above the floor: nobody who stands on it holds a camera higher
SAME_FLOOR_M = 0.4  # from the usual height: a chair and two steps of a stair are more


def add_walked(
    grid: Grid, paths: Sequence[Array], points_world: NDArray[np.floating], config: FuseConfig
) -> Grid:
    """The grid with the cells WALKED that are unknown and near where somebody walked.

    Who carried a camera from one seen floor to another, or began or ended a capture beside it,
    walked between. A stretch over unseen floor counts only where nothing speaks against that: it
    passes over no occupied cell and nothing lower than the robot, its frames are near each other,
    and the camera was as high above the floor as one who stands on it holds it.

    Parameters
    ----------
    grid
        As `project` gives it. The result has its cells, and room for those walked outside it.
    paths
        For each capture, centres (F, 3) of its camera in the order of time, metres, z up; NaN where
        they are not known.
    points_world
        (N, 3) all points that depth showed. No cell that has one below ``robot_height_m`` is
        walked, whether the octree has it occupied or not.
    config
        Cells within ``walked_radius_m`` of the camera's path are walked.
    """
    ways = [_way(path, grid.resolution_m / 2) for path in paths]
    on_foot = np.concatenate([np.zeros((0, 2)), *(points[steady] for points, steady in ways)])
    roomy = _with_room(grid, on_foot, config.walked_radius_m)
    low = points_world[points_world[:, 2] < config.robot_height_m, :2]
    shown = _cells_of(roomy, low)
    stretches = [_walked(roomy, shown | (roomy.cells == OCCUPIED), *way) for way in ways]
    walked = np.concatenate([np.zeros((0, 2)), *stretches])
    unseen = np.argwhere((roomy.cells == UNKNOWN) & ~shown)
    cells = roomy.cells.copy()
    cells[tuple(unseen[_near(roomy.centres_of(unseen), walked, config.walked_radius_m)].T)] = WALKED
    return _cropped(Grid(roomy.origin, roomy.resolution_m, cells))


def _way(path: Array, spacing_m: float) -> tuple[Array, NDArray[np.bool_]]:
    """Points (S, 2) along a camera's path, and whether it may have been carried on foot there."""
    path = path[np.isfinite(path).all(1)]
    if len(path) < 2:
        return np.zeros((0, 2)), np.zeros(0, bool)
    height_m = path[:, 2]
    on_foot = (height_m > 0) & (height_m <= REACH_M)
    usual_m = np.median(height_m[on_foot]) if on_foot.any() else 0.0
    on_foot &= np.abs(height_m - usual_m) <= SAME_FLOOR_M
    steps_m = np.hypot(*np.diff(path[:, :2], axis=0).T)
    steady = on_foot[1:] & on_foot[:-1] & (steps_m <= STRIDE_M)
    counts = np.ceil(steps_m / spacing_m).astype(np.intp) + 1
    step = np.repeat(np.arange(len(counts)), counts)
    first = np.cumsum(counts) - counts
    along = (np.arange(len(step)) - first[step]) / np.maximum(counts[step] - 1, 1)
    points = path[step, :2] + along[:, None] * (path[step + 1, :2] - path[step, :2])
    return points, steady[step]


def _walked(
    grid: Grid, standing: NDArray[np.bool_], points: Array, steady: NDArray[np.bool_]
) -> Array:
    """Those points (S, 2) of a way that lie on stretches over unseen floor with nothing on it."""
    cells = grid.cells_at(points)
    inside = grid.contains(cells)
    row, column = np.where(inside, cells.T, 0)
    seen = inside & (grid.cells[row, column] == FREE)
    doubtful = ~seen & (~steady | inside & standing[row, column])
    stretch = np.cumsum(seen)  # points on seen floor part the stretches
    refused = np.unique(stretch[doubtful])
    return np.asarray(points[~seen & ~np.isin(stretch, refused)])


def _cells_of(grid: Grid, points_xy: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Which cells (rows, columns) hold any of the points (N, 2)."""
    cells = grid.cells_at(points_xy)
    row, column = cells[grid.contains(cells)].T
    held = np.zeros(grid.cells.shape, bool)
    held[row, column] = True
    return held


def _near(points: Array, path: Array, within_m: float) -> NDArray[np.bool_]:
    """Which points (N, 2) are nearer to any of a path (S, 2) than a distance."""
    from scipy.spatial import cKDTree

    if not len(path):
        return np.zeros(len(points), bool)
    away_m, _ = cKDTree(path).query(points, distance_upper_bound=within_m)
    return np.asarray(np.isfinite(away_m))


def _with_room(grid: Grid, points: Array, margin_m: float) -> Grid:
    """The grid, enlarged by unknown cells so that all points (S, 2) have a margin."""
    if not len(points):
        return grid
    first = np.minimum(grid.cells_at(points.min(0) - margin_m), 0)
    last = np.maximum(grid.cells_at(points.max(0) + margin_m) + 1, grid.cells.shape)
    cells = np.full(last - first, UNKNOWN, np.uint8)
    rows, columns = grid.cells.shape
    cells[-first[0] : rows - first[0], -first[1] : columns - first[1]] = grid.cells
    return _shifted(grid, first, cells)


def _cropped(grid: Grid) -> Grid:
    """The grid without its outer rows and columns of unknown cells."""
    known = grid.cells != UNKNOWN
    rows, columns = (np.flatnonzero(known.any(axis)) for axis in (1, 0))
    first = np.array([rows[0], columns[0]])
    return _shifted(grid, first, grid.cells[first[0] : rows[-1] + 1, first[1] : columns[-1] + 1])


def _shifted(grid: Grid, first: NDArray[np.intp], cells: NDArray[np.uint8]) -> Grid:
    """Other cells, the first of which is where the grid has cell (row, column) ``first``."""
    corner = np.rint(np.array(grid.origin) / grid.resolution_m) + first[::-1]
    x, y = (float(c) for c in np.round(corner * grid.resolution_m, 9))
    return Grid((x, y), grid.resolution_m, cells)
