"""Depth images to one cloud: refuse what cannot be trusted, then merge by voxels (claim 3, S8)."""

import numpy as np
from numpy.typing import NDArray

from vnav.config import FuseConfig
from vnav.core.point_cloud import PointCloud

LIKE_NEIGHBOURS = 3  # of 8: fewer make a pixel an isolated one; a line two pixels wide stays
KEY_BITS = 21  # a voxel's key holds three coordinates of 21 bits: 10 km either way at 1 cm
NOTHING = np.zeros(0, np.int64), np.zeros((0, 7))


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
        self._key, self._sum = NOTHING  # sums of x, y, z, red, green, blue and count
        self._new: list[tuple[NDArray[np.int64], NDArray[np.float64]]] = []

    def add(self, points_world: NDArray[np.floating], colors: NDArray[np.uint8]) -> None:
        """Put in points (N, 3) in metres with their colours (N, 3)."""
        voxel = np.floor(points_world / self._voxel_m).astype(np.int64)
        x, y, z = (voxel + (1 << KEY_BITS - 1)).T
        key, total = _summed(
            (x << 2 * KEY_BITS) | (y << KEY_BITS) | z,
            np.hstack([points_world, colors, np.ones((len(voxel), 1))]),
        )
        row = np.searchsorted(self._key, key)
        known = np.r_[self._key, -1][row] == key
        self._sum[row[known]] += total[known]
        self._new.append((key[~known], total[~known]))
        if 2 * sum(len(new) for new, _ in self._new) > len(self._key):
            self._insert_new()

    def cloud(self) -> PointCloud:
        """What was put in, ordered by voxel."""
        self._insert_new()
        mean = self._sum[:, :6] / self._sum[:, 6:]
        return PointCloud(mean[:, :3].astype(np.float32), np.rint(mean[:, 3:]).astype(np.uint8))

    def _insert_new(self) -> None:
        keys, totals = zip(NOTHING, *self._new, strict=True)
        key, total = _summed(np.concatenate(keys), np.concatenate(totals))
        row = np.searchsorted(self._key, key)
        self._key = np.insert(self._key, row, key)
        self._sum = np.insert(self._sum, row, total, axis=0)
        self._new = []


def _summed(
    key: NDArray[np.int64], values: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Ascending distinct keys, and the sum of the rows of values that share each."""
    if not len(key):
        return NOTHING
    order = np.argsort(key, kind="stable")
    key = key[order]
    starts = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    return key[starts], np.add.reduceat(values[order], starts, axis=0)


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
