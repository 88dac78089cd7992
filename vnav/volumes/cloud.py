"""Depth images to one cloud: refuse what cannot be trusted, then merge by voxels (claim 3, S8)."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import FuseConfig
from vnav.core.point_cloud import PointCloud
from vnav.volumes.voxel_table import NONE, VoxelTable, doubled, keys_of, number_of, table_for

LIKE_NEIGHBOURS = 3  # of 8: fewer make a pixel an isolated one; a line two pixels wide stays
KEY_BITS = 21  # a voxel's key holds three coordinates of 21 bits: 10 km either way at 1 cm
MIDDLE = 1 << KEY_BITS - 1
VOXELS = 1 << 14  # room to begin with


def filter_depth(depth_m: NDArray[np.float32], config: FuseConfig) -> NDArray[np.float32]:
    """Depth (H, W) with 0 for pixels that are out of range, on a depth edge, or isolated.

    A plane is linear in inverse depth, whatever its slope, and a stereo or pattern sensor's noise
    is the same at every depth there. So an edge is where inverse depth bends by more than
    ``edge_per_m`` from one pixel to the next, and a neighbour is like its pixel where it differs
    by less.
    """
    in_range = (depth_m > 0) & (depth_m <= config.max_range_m)
    inverse = np.divide(1, depth_m, out=np.full_like(depth_m, np.nan), where=in_range)
    isolated = _like_neighbours(inverse, config.edge_per_m) < LIKE_NEIGHBOURS
    refused = isolated | _on_edge(inverse, config.edge_per_m)
    return np.where(in_range & ~refused, depth_m, np.float32(0))


def voxels_of(
    points: NDArray[np.floating], voxel_m: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Voxels that have any of points (N, 3), ordered by their corners: (V,) and (N,).

    Row of the first point in each voxel, and the voxel of each point.
    """
    if not len(points):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    corners = np.floor(np.ascontiguousarray(points.T) / voxel_m).astype(np.int64)
    x, y, z = corners - corners.min(1, keepdims=True)
    key = (x * (y.max() + 1) + y) * (z.max() + 1) + z
    bits = len(key).bit_length()  # beside a key that counts from the corner: sorted as one number
    order = np.sort(key << bits | np.arange(len(key)))
    key, row = order >> bits, order & ((1 << bits) - 1)
    first = np.r_[True, key[1:] != key[:-1]]
    voxel = np.empty_like(row)
    voxel[row] = np.cumsum(first) - 1
    return row[first], voxel


class VoxelCloud:
    """A cloud that keeps one point a voxel: the mean of the positions and colours put into it.

    Its memory is bounded by the voxels, not by the points put in.
    """

    def __init__(self, voxel_m: float) -> None:
        self._voxel_m = voxel_m
        self._table = table_for(VOXELS)
        self._sum = np.zeros((VOXELS, 7))  # of x, y, z, red, green, blue and count

    def add(self, points_world: NDArray[np.floating], colors: NDArray[np.uint8]) -> None:
        """Put in points (N, 3) in metres with their colours (N, 3)."""
        points, done = np.asarray(points_world, float), 0
        while done < len(points):
            done = _add(self._table, self._sum, points, colors, self._voxel_m, done)
            if done < len(points):
                self._double()

    def cloud(self) -> PointCloud:
        """What was put in, ordered by voxel."""
        total = self._sum[: len(keys_of(self._table))]
        points = (total[:, :3] / total[:, 6:]).astype(np.float32)
        colors = np.rint(total[:, 3:6] / total[:, 6:]).astype(np.uint8)
        order = np.argsort(keys_of(self._table))
        return PointCloud(points[order], colors[order])

    def _double(self) -> None:
        self._table, total = doubled(self._table), self._sum
        self._sum = np.zeros((2 * len(total), 7))
        self._sum[: len(total)] = total


@compiled
def _add(
    table: VoxelTable,
    total: NDArray[np.float64],
    points: NDArray[np.float64],
    colors: NDArray[np.uint8],
    voxel_m: float,
    first: int,
) -> int:
    """Put in points (N, 3) from the first on; the first one that there is no room for, or N."""
    for n in range(first, len(points)):
        key = 0
        for axis in range(3):
            key = key << KEY_BITS | int(np.floor(points[n, axis] / voxel_m)) + MIDDLE
        voxel = number_of(table, key)
        if voxel == NONE:
            return n
        for axis in range(3):
            total[voxel, axis] += points[n, axis]
            total[voxel, 3 + axis] += colors[n, axis]
        total[voxel, 6] += 1
    return len(points)


def _on_edge(inverse: NDArray[np.float32], edge_per_m: float) -> NDArray[np.bool_]:
    edge = np.zeros(inverse.shape, bool)
    for image, found in ((inverse, edge), (inverse.T, edge.T)):
        bend = image[:-2] - 2 * image[1:-1] + image[2:]
        found[1:-1] |= np.abs(bend) > edge_per_m
    return edge


def _like_neighbours(inverse: NDArray[np.float32], edge_per_m: float) -> NDArray[np.uint8]:
    height, width = inverse.shape
    padded = np.pad(inverse, 1, constant_values=np.nan)
    count = np.zeros(inverse.shape, np.uint8)
    for dy, dx in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        neighbour = padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        count += np.abs(neighbour - inverse) < edge_per_m
    return count
