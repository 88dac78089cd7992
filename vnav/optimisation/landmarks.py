"""Landmarks: tracks of features over keyframes, adjusted together with the keyframes' poses."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from vnav.config import OptimiseConfig
from vnav.core.arrays import Array, Rows
from vnav.core.frame import Edge
from vnav.core.mapping import FrameFeatures, Landmarks
from vnav.core.tracks import merge
from vnav.optimisation.bundle import (
    Bundle,
    Observations,
    Prior,
    SensorModel,
    adjust,
    covariances,
    depth_offset,
)

OUTLIER_SIGMAS_SQUARED = 16.3  # chi-squared, 3 degrees of freedom: 99.9 %
FIRST_SLACK = 9.0  # the first poses' errors exceed the noise: outliers go step by step
OFTEN_SEEN = 4  # sightings
ROUGH_ITERATIONS = 4  # of a round that another one follows


class Tracks:
    """Every feature of every keyframe as an observation of its track's 3D point."""

    def __init__(self, keyframes: Sequence[FrameFeatures], matches: NDArray[np.int32]) -> None:
        counts = np.array([len(k.features) for k in keyframes], np.int32)
        camera = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        px = np.concatenate([k.features.keypoints_px for k in keyframes]).astype(float)
        self.points_camera = np.concatenate([k.points_camera for k in keyframes]).astype(float)
        self.feature = np.concatenate([np.arange(n, dtype=np.int32) for n in counts])
        track = merge(matches, counts)
        self.seen = Observations(track, camera, px, 1 / self.points_camera[:, 2])
        self.count = int(track.max(initial=-1)) + 1

    def less(self, offset: float) -> "Tracks":
        """The same with all inverse depths less by that, in 1/m."""
        tracks = copy.copy(self)
        tracks.points_camera = self.points_camera / (1 - offset * self.points_camera[:, 2:])
        tracks.seen = self.seen.less(offset)
        return tracks

    def lifted(self, T_world_camera: Array, rows: Rows) -> Array:
        """Points (L, 3): the mean of a track's lifted features, weighted by depth's precision.

        Only the given rows count; NaN for a track none of whose features has depth.
        """
        T = T_world_camera[self.seen.camera[rows]]
        points = (T[:, :3, :3] @ self.points_camera[rows, :, None])[..., 0] + T[:, :3, 3]
        good = np.isfinite(points[:, 0])
        track, points = self.seen.landmark[rows][good], points[good]
        weight = self.points_camera[rows, 2][good] ** -4
        total = np.bincount(track, weight, self.count)
        sums = [np.bincount(track, weight * p, self.count) for p in points.T]
        with np.errstate(invalid="ignore"):
            return np.stack(sums, 1) / total[:, None]


@dataclass(frozen=True)
class Adjusted:
    """FrameFeatures poses (K, 4, 4) and covariances (K, 6, 6), landmarks, and the error on the way.

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
    tracks: Tracks,
    joined: Sequence[Edge],
    model: SensorModel,
    config: OptimiseConfig,
    prior: Prior | None = None,
) -> Adjusted:
    """Bundle adjustment in rounds, each without the observations that stand out.

    The first takes the noise of the settings, which must do for any sensor; then the residuals tell
    it: the sharper it is known, the less do wrong matches weigh. What is said of the result, its
    covariances and which observations hold a landmark, stays with the settings.

    ``joined``: how odometry and closures joined keyframes, by number; where two share too few
    landmarks, this holds them, so that whatever was joined stays joined. ``prior``: see `adjust`.
    """
    rows = np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0])[tracks.seen.camera])
    points = tracks.lifted(T_world_camera, rows)
    rows = rows[np.isfinite(points[:, 0])[tracks.seen.landmark[rows]]]
    bundle = Bundle(T_world_camera, points)
    sharp, rms, offset = model, [], 0.0
    for k in range(config.bundle_rounds):
        if k > 0:
            all_shared = _shared(tracks.seen, _inliers(bundle, tracks, rows, model, 1.0))
            sharp = model.fitted(bundle, tracks.seen[all_shared])
        last = k == config.bundle_rounds - 1
        iterations = config.bundle_iterations if last else ROUGH_ITERATIONS
        inliers = _inliers(bundle, tracks, rows, sharp, FIRST_SLACK if k == 0 else 1.0)
        shared = _shared(tracks.seen, inliers)
        held = _weak(joined, len(T_world_camera), tracks.seen[shared], config.min_shared_landmarks)
        rms.append(model.rms_px(bundle, tracks.seen[shared]))
        if last and k > 0:
            offset = _depth_offset(bundle, tracks, shared, joined, sharp, config, prior)
            tracks = tracks.less(offset)
        bundle = adjust(bundle, tracks.seen[shared], held, sharp, iterations, prior)
        bundle = _lift_alone(bundle, tracks, inliers, shared)
    rows = _inliers(bundle, tracks, rows, model, 1.0)
    shared = _shared(tracks.seen, rows)
    rms.append(model.rms_px(bundle, tracks.seen[shared]))
    held = _weak(joined, len(T_world_camera), tracks.seen[shared], config.min_shared_landmarks)
    covariance = covariances(bundle, tracks.seen[shared], held, model, prior)
    landmarks = _landmarks(bundle, tracks, rows, model)
    poses = bundle.T_world_camera
    return Adjusted(poses, covariance, landmarks, len(shared), offset, rms[0], rms[-1])


def _depth_offset(
    bundle: Bundle,
    tracks: Tracks,
    rows: Rows,
    joined: Sequence[Edge],
    model: SensorModel,
    config: OptimiseConfig,
    prior: Prior | None,
) -> float:
    """What the landmarks that many keyframes see tell of it, nearly all that there is to tell."""
    seen = tracks.seen[rows]
    seen = seen[np.bincount(seen.landmark)[seen.landmark] >= OFTEN_SEEN]
    held = _weak(joined, len(bundle.T_world_camera), seen, config.min_shared_landmarks)
    return depth_offset(bundle, seen, held, model, prior)


def _inliers(bundle: Bundle, tracks: Tracks, rows: Rows, model: SensorModel, slack: float) -> Rows:
    squared = model.squared_residuals(bundle, tracks.seen[rows])
    return rows[squared < OUTLIER_SIGMAS_SQUARED * slack]


def _shared(seen: Observations, rows: Rows) -> Rows:
    """The rows of landmarks that several keyframes see, at least one of them with depth."""
    landmark = seen.landmark[rows]
    count = np.bincount(landmark)
    with_depth = np.bincount(landmark, np.isfinite(seen.inverse_depth[rows]))
    return rows[(count[landmark] > 1) & (with_depth[landmark] > 0)]


def _weak(joined: Sequence[Edge], cameras: int, seen: Observations, fewest: int) -> list[Edge]:
    """Those edges whose keyframes share too few landmarks to hold each other."""
    shape = cameras, int(seen.landmark.max(initial=-1)) + 1
    sees = csr_array((np.ones(len(seen)), (seen.camera, seen.landmark)), shape=shape)
    common = (sees @ sees.T).toarray()
    return [e for e in joined if common[e.i, e.j] < fewest]


def _lift_alone(bundle: Bundle, tracks: Tracks, rows: Rows, shared: Rows) -> Bundle:
    """Points that one keyframe alone sees follow its new pose."""
    points = tracks.lifted(bundle.T_world_camera, rows)
    together = np.unique(tracks.seen.landmark[shared])
    points[together] = bundle.points_world[together]
    return Bundle(bundle.T_world_camera, points)


def _landmarks(bundle: Bundle, tracks: Tracks, rows: Rows, model: SensorModel) -> Landmarks:
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
