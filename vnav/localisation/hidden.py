"""What stands before what: landmarks that a view cannot see though they lie in its direction."""

import numpy as np
from numpy.typing import NDArray

from vnav.core.voxels import Voxels
from vnav.localisation.view import View

FROM_M = 0.15  # the camera itself may touch what it stands on
BEFORE_M, BEFORE = 0.20, 0.05  # so near to the landmark, and this share of the way, is the landmark


def hidden(view: View, points_world: NDArray[np.float32], voxels: Voxels) -> NDArray[np.bool_]:
    """Which points (N, 3) stand behind something: the way to them is sampled once a voxel.

    Samples are left out where nothing can stand: nearer than what is known to be nearest.
    """
    way = points_world - view.centre_world
    distance = np.linalg.norm(way, axis=1)
    last = (distance * (1 - BEFORE) - BEFORE_M - FROM_M) / voxels.edge_m  # in voxels, from FROM_M
    start = (view.centre_world - voxels.origin)[:, None] / voxels.edge_m
    direction = (way / np.maximum(distance, FROM_M)[:, None]).T
    start = start + direction * (FROM_M / voxels.edge_m)
    blocked = np.zeros(len(way), bool)
    rays = np.flatnonzero(last > 0)
    start, direction, last, at = start[:, rays], direction[:, rays], last[rays], np.zeros(len(rays))
    while len(rays):
        away = voxels.away_from(np.floor(start + direction * at).astype(np.intp))
        blocked[rays[away == 0]] = True
        at += away
        on_way = np.flatnonzero((away > 0) & (at < last))
        rays, at, last = rays[on_way], at[on_way], last[on_way]
        start, direction = start[:, on_way], direction[:, on_way]
    return blocked
