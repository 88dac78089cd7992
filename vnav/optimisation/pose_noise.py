"""How noisy given poses are, as the closures between them show."""

from collections.abc import Sequence

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import off_edges
from vnav.core.robust import robust_sigma

MIN_CLOSURES = 10  # fewer tell no noise
MAX_SCATTER = np.array([0.1, 0.3])  # rad, m: poses farther off are not noisy but wrong


def pose_noise(T_world_camera: Array, closures: Sequence[Edge]) -> Array:
    """Standard deviations (6,) of given poses (N, 4, 4), rad and m, as closures show them.

    It is how far two poses stand otherwise to each other than closures say, in the median, which
    wrong closures do not reach; half of the variance is each pose's. Zero where the closures' own
    noise explains it, where they are too few, and where poses are too far off to be noisy.
    """
    if len(closures) < MIN_CLOSURES:
        return np.zeros(6)
    scatter, own = _scatter(T_world_camera, closures)
    if (scatter <= own).all() or (scatter > MAX_SCATTER).any():
        return np.zeros(6)
    return np.asarray(np.repeat(scatter, 3) / np.sqrt(2))


def _scatter(T_world_camera: Array, closures: Sequence[Edge]) -> tuple[Array, Array]:
    """How far two poses scatter about closures (2,), rad and m, and how far closures do alone."""
    off = se3.deviation(off_edges(T_world_camera, closures)).reshape(-1, 2, 3)
    covariance = np.linalg.inv(np.stack([e.information for e in closures]))
    variance = np.diagonal(covariance, axis1=1, axis2=2).reshape(-1, 2, 3)
    return robust_sigma(off, axis=(0, 2)), np.sqrt(np.median(variance, axis=(0, 2)))
