"""Landmarks from merged tracks, adjusted in rounds together with the keyframes: claim 3, S7."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vnav.config import OptimiseConfig
from vnav.core.arrays import Array, Rows
from vnav.core.frame import Edge
from vnav.core.mapping import Landmarks
from vnav.optimisation.bundle import adjust, covariances
from vnav.optimisation.bundle_problem import PosePrior
from vnav.optimisation.camera_fit import CameraFit, camera_fits
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.observation_selection import ObservationSelection, move_unshared_points
from vnav.optimisation.self_calibration import SensorCalibration, calibrated
from vnav.optimisation.sensor_model import Bundle, SensorModel

FIRST_SLACK = 9.0  # the first poses' errors exceed the noise: outliers go step by step
ROUGH_ITERATIONS = 4  # of a round that another one follows


@dataclass(frozen=True)
class AdjustedBundle:
    """Poses (K, 4, 4) and covariances (K, 6, 6) of keyframes, landmarks, the error on the way.

    ``rounds``: of bundle adjustment, that led there.

    ``sensor``: what that of each capture does wrong; landmarks are without. ``camera_fits``: of
    cameras, where there was more than one round.
    """

    T_world_camera: Array
    covariance: Array
    landmarks: Landmarks
    observations: int
    sensor: SensorCalibration
    camera_fits: tuple[CameraFit, ...]
    rms_px_before: float
    rms_px_after: float
    rounds: int

    def of_all(self, numbers: NDArray[np.intp], count: int) -> "AdjustedBundle":
        """As of so many keyframes, of which these were adjusted; NaN for the others."""
        poses, covariance = np.full((count, 4, 4), np.nan), np.full((count, 6, 6), np.nan)
        poses[numbers], covariance[numbers] = self.T_world_camera, self.covariance
        keyframe = numbers[self.landmarks.keyframe].astype(np.int32)
        landmarks = replace(self.landmarks, keyframe=keyframe)
        return replace(self, T_world_camera=poses, covariance=covariance, landmarks=landmarks)


@dataclass(frozen=True)
class RoughBundle:
    """Keyframes and landmarks before the last round, by ``tracks`` without the sensor's errors.

    ``rms_px_before``: the error before all rounds.
    """

    bundle: Bundle
    tracks: FeatureTracks
    selection: ObservationSelection
    sensor: SensorCalibration
    config: OptimiseConfig
    rms_px_before: float

    def adjusted(self) -> AdjustedBundle:
        """After the last round; of none, as it is.

        What is said of the result, its covariances and which observations hold a landmark, stays
        with the noise of the settings.
        """
        tracks, selection, rounds = self.tracks, self.selection, self.config.bundle_rounds
        model, slack, fits = selection.model, 1.0, tuple[CameraFit, ...]()
        if rounds > 1:
            fits = camera_fits(self.bundle, tracks, selection)
        if rounds:
            iterations = self.config.bundle_iterations
            bundle = _round(self.bundle, tracks, selection, iterations, first=rounds == 1)
        else:
            slack, none = FIRST_SLACK, selection.rows[:0]
            inliers = selection.inliers(self.bundle, tracks, model, slack)
            bundle = move_unshared_points(self.bundle, tracks, inliers, none)
        inliers = selection.inliers(bundle, tracks, model, slack)
        seen = tracks.seen[tracks.shared(inliers)]
        covariance = covariances(bundle, selection.problem(seen, model))
        landmarks = _landmarks(bundle, tracks, inliers, model)
        after_px = model.rms_px(bundle, seen)
        before_px = self.rms_px_before if rounds else after_px
        told = len(seen), self.sensor, fits, before_px, after_px, rounds
        return AdjustedBundle(bundle.T_world_camera, covariance, landmarks, *told)


def rough_bundle(
    T_world_camera: Array,
    tracks: FeatureTracks,
    edges: Sequence[Edge],
    model: SensorModel,
    config: OptimiseConfig,
    prior: PosePrior | None = None,
    known: SensorCalibration | None = None,
) -> RoughBundle:
    """Bundle adjustment in rounds, each without the observations that stand out, but for the last.

    The first takes the noise of the settings, which must do for any sensor; then the residuals tell
    it: the sharper it is known, the less do wrong matches weigh. Before the last, the sensor's
    errors are found and taken off.

    ``edges``: relative poses of keyframes, by number; where two share too few landmarks, theirs
    keeps them connected. ``prior``: see `BundleProblem`. What is ``known`` of each capture's
    sensor, by default of one that nothing is, is taken off before the first round, too.
    """
    sensor = known or SensorCalibration.unknown(1)
    measured, tracks = tracks, tracks.corrected(sensor.errors)
    bundle, rows = _initial_bundle(T_world_camera, tracks, model)
    selection = ObservationSelection(rows, model, edges, prior, config.min_shared_landmarks)
    near = tracks.shared(selection.inliers(bundle, tracks, model, FIRST_SLACK))
    rms_px = model.rms_px(bundle, tracks.seen[near])
    for k in range(config.bundle_rounds - 1):
        bundle = _round(bundle, tracks, selection, ROUGH_ITERATIONS, first=k == 0)
    if config.bundle_rounds > 1:
        near = selection.inliers(bundle, tracks, model)
        sensor, bundle = calibrated(bundle, measured, selection, sensor)
        tracks = measured.corrected(sensor.errors)
        bundle = move_unshared_points(bundle, tracks, near, tracks.long(rows))
    return RoughBundle(bundle, tracks, selection, sensor, config, rms_px)


def _round(
    bundle: Bundle,
    tracks: FeatureTracks,
    selection: ObservationSelection,
    iterations: int,
    first: bool,
) -> Bundle:
    """A bundle adjusted to the observations that do not stand out."""
    noise = selection.model if first else selection.noise(bundle, tracks)
    inliers = selection.inliers(bundle, tracks, noise, FIRST_SLACK if first else 1.0)
    shared = tracks.shared(inliers)
    bundle = adjust(bundle, selection.problem(tracks.seen[shared], noise), iterations)
    return move_unshared_points(bundle, tracks, inliers, shared)


def _initial_bundle(
    T_world_camera: Array, tracks: FeatureTracks, model: SensorModel
) -> tuple[Bundle, Rows]:
    """Points where the keyframes' depth has them, and the observations of those that have one.

    Without depth they are where rays meet.
    """
    rows = np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0])[tracks.seen.camera])
    points = tracks.points_world(T_world_camera, rows)
    points = np.where(np.isfinite(points), points, tracks.met(T_world_camera, rows, model))
    rows = rows[np.isfinite(points[:, 0])[tracks.seen.landmark[rows]]]
    return Bundle(T_world_camera, points), rows


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
