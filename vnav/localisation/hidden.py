"""What stands before what: landmarks that a view cannot see though they lie in its direction."""

import numpy as np
from numpy.typing import NDArray

from vnav.core.voxels import Voxels
from vnav.localisation.view import View

FROM_M = 0.15  # the camera itself may touch what it stands on
BEFORE_M, BEFORE = 0.20, 0.05  # so near to the landmark, and this share of the way, is the landmark


def hidden(view: View, points_world: NDArray[np.float32], voxels: Voxels) -> NDArray[np.bool_]:
    """Which points (N, 3) stand behind something: the way to them is sampled once a voxel."""
    away = points_world - view.centre_world
    distance = np.linalg.norm(away, axis=1)
    last = distance * (1 - BEFORE) - BEFORE_M
    steps = np.arange(FROM_M, last.max(initial=0), voxels.edge_m)
    blocked = np.zeros(len(points_world), bool)
    for at in steps:
        on_way = np.flatnonzero((at < last) & ~blocked)
        way = view.centre_world + away[on_way] * (at / distance[on_way])[:, None]
        blocked[on_way] = voxels.stands_at(way)
    return blocked
