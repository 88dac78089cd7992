"""Which observations a bundle is adjusted to, and with what noise and edges."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from vnav.core.arrays import Rows
from vnav.core.frame import Edge
from vnav.optimisation.bundle_problem import BundleProblem, PosePrior
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.sensor_model import Bundle, Observations, SensorModel

OUTLIER_SIGMAS_SQUARED = 16.3  # chi-squared, 3 degrees of freedom: 99.9 %


@dataclass(frozen=True)
class ObservationSelection:
    """Of the ``rows`` of the tracks, whose landmarks and cameras are known.

    ``model``: with the noise of the settings; ``edges`` hold keyframes that share fewer than
    ``min_shared`` landmarks; ``prior``: see `BundleProblem`.
    """

    rows: Rows
    model: SensorModel
    edges: Sequence[Edge]
    prior: PosePrior | None
    min_shared: int

    def noise(self, bundle: Bundle, tracks: FeatureTracks) -> SensorModel:
        """The noise that the residuals of a bundle show."""
        shared = tracks.shared(self.inliers(bundle, tracks, self.model))
        return self.model.fitted(bundle, tracks.seen[shared])

    def inliers(
        self, bundle: Bundle, tracks: FeatureTracks, noise: SensorModel, slack: float = 1.0
    ) -> Rows:
        """Rows whose residuals the noise explains."""
        squared = noise.squared_residuals(bundle, tracks.seen[self.rows])
        return self.rows[squared < OUTLIER_SIGMAS_SQUARED * slack]

    def problem(self, seen: Observations, noise: SensorModel) -> BundleProblem:
        """The problem of these observations, with the edges of keyframes that share too few."""
        shape = len(self.model.intrinsics), int(seen.landmark.max(initial=-1)) + 1
        sees = csr_array((np.ones(len(seen)), (seen.camera, seen.landmark)), shape=shape)
        shared = (sees @ sees.T).toarray()
        weak = [e for e in self.edges if shared[e.i, e.j] < self.min_shared]
        return BundleProblem(seen, weak, noise, self.prior)


def of_long_tracks(
    tracks: FeatureTracks, selection: ObservationSelection
) -> tuple[FeatureTracks, ObservationSelection]:
    """Those alone that tell of the sensor, a part of all."""
    rows = tracks.long(selection.rows)
    return tracks.among(rows), replace(selection, rows=np.arange(len(rows)))


def move_unshared_points(bundle: Bundle, tracks: FeatureTracks, rows: Rows, shared: Rows) -> Bundle:
    """Points of other rows than the shared ones, which were adjusted, follow their keyframes."""
    points = tracks.points_world(bundle.T_world_camera, rows)
    adjusted = np.unique(tracks.seen.landmark[shared])
    points[adjusted] = bundle.points_world[adjusted]
    return Bundle(bundle.T_world_camera, points)
