"""Landmarks from merged tracks, adjusted in rounds together with the keyframes: claim 3, S7."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from vnav.config import OptimiseConfig
from vnav.core.arrays import Array, Rows
from vnav.core.frame import Edge
from vnav.core.mapping import Landmarks
from vnav.optimisation.bundle import adjust, covariances
from vnav.optimisation.bundle_graph import BundleProblem, PosePrior
from vnav.optimisation.depth_offset import depth_offset
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.sensor_model import Bundle, Observations, SensorModel

OUTLIER_SIGMAS_SQUARED = 16.3  # chi-squared, 3 degrees of freedom: 99.9 %
FIRST_SLACK = 9.0  # the first poses' errors exceed the noise: outliers go step by step
ROUGH_ITERATIONS = 4  # of a round that another one follows


@dataclass(frozen=True)
class AdjustedBundle:
    """Poses (K, 4, 4) and covariances (K, 6, 6) of keyframes, landmarks, the error on the way.

    ``depth_offset``: what measured inverse depths have too much, in 1/m; landmarks are without.
    """

    T_world_camera: Array
    covariance: Array
    landmarks: Landmarks
    observations: int
    depth_offset: float
    rms_px_before: float
    rms_px_after: float


def adjust_landmarks(
    T_world_camera: Array,
    tracks: FeatureTracks,
    edges: Sequence[Edge],
    model: SensorModel,
    config: OptimiseConfig,
    prior: PosePrior | None = None,
) -> AdjustedBundle:
    """Bundle adjustment in rounds, each without the observations that stand out.

    The first takes the noise of the settings, which must do for any sensor; then the residuals tell
    it: the sharper it is known, the less do wrong matches weigh. Before the last, depth is freed of
    its offset. What is said of the result, its covariances and which observations hold a landmark,
    stays with the settings.

    ``edges``: relative poses of keyframes, by number; where two share too few landmarks, theirs
    keeps them connected. ``prior``: see `BundleProblem`.
    """
    constraints = _Constraints(edges, prior, len(T_world_camera), config.min_shared_landmarks)
    bundle, rows = _initial_bundle(T_world_camera, tracks)
    rms_px, offset = [], 0.0
    for k in range(config.bundle_rounds):
        first, last = k == 0, k == config.bundle_rounds - 1
        noise = model if first else _fitted_noise(model, bundle, tracks, rows)
        inliers = _inliers(bundle, tracks, rows, noise, FIRST_SLACK if first else 1.0)
        shared = tracks.shared(inliers)
        rms_px.append(model.rms_px(bundle, tracks.seen[shared]))
        if last and not first:
            long = tracks.seen[tracks.long(shared)]
            offset = depth_offset(bundle, constraints.problem(long, noise))
            tracks = tracks.without_offset(offset)
        iterations = config.bundle_iterations if last else ROUGH_ITERATIONS
        bundle = adjust(bundle, constraints.problem(tracks.seen[shared], noise), iterations)
        bundle = _move_unshared_points(bundle, tracks, inliers, shared)
    inliers = _inliers(bundle, tracks, rows, model)
    shared = tracks.shared(inliers)
    rms_px.append(model.rms_px(bundle, tracks.seen[shared]))
    covariance = covariances(bundle, constraints.problem(tracks.seen[shared], model))
    landmarks = _landmarks(bundle, tracks, inliers, model)
    poses = bundle.T_world_camera
    return AdjustedBundle(poses, covariance, landmarks, len(shared), offset, rms_px[0], rms_px[-1])


@dataclass(frozen=True)
class _Constraints:
    """What holds keyframes beside landmarks: edges where they share too few, and a prior."""

    edges: Sequence[Edge]
    prior: PosePrior | None
    keyframes: int
    fewest: int

    def problem(self, seen: Observations, noise: SensorModel) -> BundleProblem:
        """The problem of these observations, with the edges of keyframes that share too few."""
        shape = self.keyframes, int(seen.landmark.max(initial=-1)) + 1
        sees = csr_array((np.ones(len(seen)), (seen.camera, seen.landmark)), shape=shape)
        shared = (sees @ sees.T).toarray()
        weak = [e for e in self.edges if shared[e.i, e.j] < self.fewest]
        return BundleProblem(seen, weak, noise, self.prior)


def _initial_bundle(T_world_camera: Array, tracks: FeatureTracks) -> tuple[Bundle, Rows]:
    """Points where the keyframes' depth has them, and the observations of those that have one."""
    rows = np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0])[tracks.seen.camera])
    points = tracks.points_world(T_world_camera, rows)
    rows = rows[np.isfinite(points[:, 0])[tracks.seen.landmark[rows]]]
    return Bundle(T_world_camera, points), rows


def _fitted_noise(
    model: SensorModel, bundle: Bundle, tracks: FeatureTracks, rows: Rows
) -> SensorModel:
    """The noise that the residuals of a bundle show."""
    shared = tracks.shared(_inliers(bundle, tracks, rows, model))
    return model.fitted(bundle, tracks.seen[shared])


def _inliers(
    bundle: Bundle, tracks: FeatureTracks, rows: Rows, model: SensorModel, slack: float = 1.0
) -> Rows:
    squared = model.squared_residuals(bundle, tracks.seen[rows])
    return rows[squared < OUTLIER_SIGMAS_SQUARED * slack]


def _move_unshared_points(
    bundle: Bundle, tracks: FeatureTracks, rows: Rows, shared: Rows
) -> Bundle:
    """Points that one keyframe alone sees follow its new pose."""
    points = tracks.points_world(bundle.T_world_camera, rows)
    adjusted = np.unique(tracks.seen.landmark[shared])
    points[adjusted] = bundle.points_world[adjusted]
    return Bundle(bundle.T_world_camera, points)


def _landmarks(bundle: Bundle, tracks: FeatureTracks, rows: Rows, model: SensorModel) -> Landmarks:
    """The landmarks that still have observations, renumbered in the order of their tracks."""
    sigma = model.point_sigmas(bundle, tracks.seen[rows])
    rows = rows[np.isfinite(sigma)[tracks.seen.landmark[rows]]]
    rows = rows[np.lexsort((tracks.seen.camera[rows], tracks.seen.landmark[rows]))]
    track, landmark = np.unique(tracks.seen.landmark[rows], return_inverse=True)
    return Landmarks(
        bundle.points_world[track].astype(np.float32),
        sigma[track].astype(np.float32),
        landmark.astype(np.int32),
        tracks.seen.camera[rows],
        tracks.feature[rows],
    )
