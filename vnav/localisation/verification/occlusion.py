"""What stands before what: landmarks that a view cannot see though they lie in its direction."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.core.voxels import Voxels
from vnav.localisation.view import View

START_M = 0.15  # the camera itself may touch what it stands on
SURFACE_M, SURFACE_SHARE = 0.20, 0.05  # of the way: what stands so near is the landmark itself


def occluded(view: View, points_world: NDArray[np.float32], voxels: Voxels) -> NDArray[np.bool_]:
    """Which points (N, 3) stand behind something: the way to them is sampled once a voxel."""
    if not voxels.away.size:
        return np.zeros(len(points_world), bool)
    start = view.centre_world - voxels.origin
    ways = points_world - view.centre_world
    blocked: NDArray[np.bool_] = _blocked(start, ways, voxels.away, voxels.edge_m)
    return blocked


@compiled
def _blocked(
    start: Array, ways: Array, away: NDArray[np.uint8], edge_m: float
) -> NDArray[np.bool_]:
    """On which ways (N, 3) from the start something stands."""
    blocked = np.zeros(len(ways), np.bool_)
    direction, first = np.empty(3), np.empty(3)  # in voxels
    for n in range(len(ways)):
        x, y, z = ways[n]
        distance = np.sqrt(x * x + y * y + z * z)
        for k in range(3):
            direction[k] = ways[n, k] / max(distance, START_M)
            first[k] = start[k] / edge_m + direction[k] * (START_M / edge_m)
        at, last = 0.0, (distance * (1 - SURFACE_SHARE) - SURFACE_M - START_M) / edge_m
        while at < last and not blocked[n]:
            free = _free(first, direction, at, away)
            blocked[n] = free == 0
            at += free
    return blocked


@compiled
def _free(first: Array, direction: Array, at: float, away: NDArray[np.uint8]) -> int:
    """How far from there, in voxels, nothing stands: no sample is needed before.

    From outside of the voxels, as far as they begin.
    """
    row, outside = 0, 0
    for k in range(3):
        cell = int(np.floor(first[k] + direction[k] * at))
        inner = min(max(cell, 0), away.shape[k] - 1)
        outside = max(outside, abs(cell - inner))
        row = row * away.shape[k] + inner
    return outside if outside > 0 else int(away.flat[row])
