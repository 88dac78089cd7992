"""What a bundle is adjusted to: observations, relative poses, priors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.optimisation.sensor_model import Bundle, Observations, SensorModel

FIXED_SIGMA, LEAST_PRIOR_SIGMA = 1e-5, 1e-3  # rad, m


@dataclass(frozen=True)
class PosePrior:
    """Poses (K, 4, 4) that were given, and the standard deviations (6,) of their tangents.

    Rotation first, rad and m. ``fixed``: the poses stay where they are, whatever their noise.
    """

    T_world_camera: Array
    sigmas: Array
    fixed: bool

    def among(self, needed: NDArray[np.intp]) -> "PosePrior":
        """Of some of the poses."""
        return replace(self, T_world_camera=self.T_world_camera[needed])

    @property
    def information(self) -> Array:
        """Information (6,) of a tangent."""
        spread = np.full(6, FIXED_SIGMA) if self.fixed else self.sigmas.clip(LEAST_PRIOR_SIGMA)
        return np.asarray(1 / np.square(spread))


@dataclass(frozen=True)
class BundleProblem:
    """Observations, relative poses of cameras that see too little, and their noise.

    ``prior`` is of all cameras; without one, the ``anchor`` is fixed, a number among `cameras`.
    """

    seen: Observations
    edges: Sequence[Edge]
    model: SensorModel
    prior: PosePrior | None = None
    anchor: int = 0

    @property
    def firmly_anchored(self) -> "BundleProblem":
        """With the camera fixed that sees the most landmarks."""
        cameras = self.cameras
        seen = np.bincount(self.seen.camera, minlength=cameras[-1] + 1)[cameras]
        return replace(self, anchor=int(seen.argmax()))

    def measured_less(self, less: Array) -> "BundleProblem":
        """With pixels and inverse depths (M, 3) of all observations less by so much."""
        seen = self.seen.measured(self.seen.px - less[:, :2], self.seen.inverse_depth - less[:, 2])
        return replace(self, seen=seen)

    @property
    def cameras(self) -> NDArray[np.intp]:
        """Cameras that see anything or have an edge, ascending."""
        of_edges = np.array([[e.i, e.j] for e in self.edges], np.int32).ravel()
        return _distinct(np.concatenate([self.seen.camera, of_edges]))

    @property
    def landmarks(self) -> NDArray[np.intp]:
        """Landmarks that are seen, ascending."""
        return _distinct(self.seen.landmark)

    def held(self, bundle: Bundle) -> tuple[NDArray[np.intp], PosePrior]:
        """Cameras that a prior holds, and the prior: of all, or of the anchor where it is."""
        if self.prior:
            return self.cameras, self.prior
        stays = PosePrior(bundle.T_world_camera, np.zeros(6), fixed=True)
        return self.cameras[[self.anchor]], stays


def _distinct(rows: NDArray[np.int32]) -> NDArray[np.intp]:
    """The rows (M,) that occur, ascending."""
    return np.flatnonzero(np.bincount(rows))
