"""What the sensor does wrong, found together with the bundle: self-calibration."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.optimisation.calibrating_step import calibrating_step
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.observation_selection import (
    ObservationSelection,
    move_unshared_points,
    of_long_tracks,
)
from vnav.optimisation.sensor_errors import SensorErrors
from vnav.optimisation.sensor_model import Bundle
from vnav.registration.pixel_evidence import DEPTH_DELAY_SIGMA_S, LINE_DELAY_SIGMA_S

PRIOR_SIGMAS = np.array([2e-4, DEPTH_DELAY_SIGMA_S, LINE_DELAY_SIGMA_S, 1.0])  # 3 mm at 4 m first
LARGEST = np.array([6e-4, 0.05, 1e-4, np.inf])  # what is found beyond is no such error
SYSTEMATIC = np.array([1.2e-5, 0.0, 0.0, 0.0])  # 1/m: what a map's inverse depths err by together
RIGHT_SHARE = 0.5  # of what depth's stamps vary, by which images bear them out
SURE_SIGMAS = np.array([0.0, 5.0, 5.0, 5.0])  # with fewer from 0, a delay is not determined
STEPS = 2  # in a pass, which chooses its observations, and measures them without the errors
LAST_PASSES = (1.0,) * 10  # at the most, by how many times the noise
FIRST_PASSES = 4.0, 2.0  # before: errors that are not known exceed the noise
CONVERGED_SIGMAS, CONVERGED_SHARE = 1.0, 0.03  # a pass that changes errors less is the last
HELD = 1e-6  # times the prior's: noise of an error that is not free


@dataclass(frozen=True)
class SensorCalibration:
    """What each capture's sensor does wrong, and standard deviations (C, 4) in the same order.

    Those of an error that is 0 say what it would have had to exceed; infinite where nothing tells.
    """

    errors: tuple[SensorErrors, ...]
    sigmas: Array

    @classmethod
    def unknown(cls, captures: int) -> "SensorCalibration":
        """Of so many captures, of which nothing is known."""
        return cls((SensorErrors(),) * captures, np.full((captures, 4), np.inf))

    @property
    def values(self) -> Array:
        """The errors (C, 4)."""
        return np.array([e.vector for e in self.errors])

    @property
    def delayed(self) -> bool:
        """Whether anything is seen later than stamped."""
        return any(e.delayed for e in self.errors)


def calibrated(
    bundle: Bundle,
    tracks: FeatureTracks,
    selection: ObservationSelection,
    known: SensorCalibration,
) -> tuple[SensorCalibration, Bundle]:
    """Those errors of the sensor that the images determine, and the bundle of tracks without them.

    Landmarks that few keyframes see tell nothing of it, and stay as they are. Each capture has
    errors of its own: it may be by another sensor.

    A delay is determined where it is at least `SURE_SIGMAS` from 0. What is found beyond `LARGEST`
    is no such error: the data err otherwise. Either is 0 while the others are found again, from the
    bundle as it was given: what a wrong error bent and dropped is not to stay so. ``known``: found
    before, and what the bundle is without; where it has errors, these are found once more, from
    there, and no others. What depth's own stamps vary against colour's is taken for so, unless
    images show less than half of it.

    Depth by triangulation, from structured light or stereo, errs by an offset of its disparity.
    That bends what is far against what is near, as no scale would, and landmarks seen from several
    places show it: c0 of Herrera, Kannala, Heikkila 2012, "Joint depth and color camera calibration
    with distortion correction". Where all is about as far, it hardly differs from a scale, and
    small errors that observations have in common look like one: see `SYSTEMATIC`.

    A rolling shutter skews what a turning camera sees: Hedborg et al. 2012, "Rolling shutter bundle
    adjustment". Late depth is of another view than colour's.
    """
    start = known.values
    long, of_long = of_long_tracks(tracks, selection)
    free, uneven = start != 0, tracks.uneven_captures
    free[:, 3] = False
    if start.any():
        return _sure(bundle, long, of_long, start, free, known.sigmas, LAST_PASSES)
    free[:, :3] = True, *[tracks.sensor is not None] * 2
    start[uneven, 3] = 1
    of_settings, passes = np.where(free, PRIOR_SIGMAS, np.inf), (*FIRST_PASSES, *LAST_PASSES)
    found, adjusted = _sure(bundle, long, of_long, start, free, of_settings, passes)
    wrong = _wrong_stamps(adjusted, long, of_long, found, uneven)
    if len(wrong):
        start[wrong, 3] = 0
        found, adjusted = _sure(bundle, long, of_long, start, free, of_settings, passes)
    return found, adjusted


def _sure(
    bundle: Bundle,
    tracks: FeatureTracks,
    selection: ObservationSelection,
    start: Array,
    free: NDArray[np.bool_],
    sigmas: Array,
    passes: Sequence[float],
) -> tuple[SensorCalibration, Bundle]:
    """Those of the free errors that are determined; the share of depth's stamps is held."""
    while True:
        start = np.column_stack([start[:, :3] * free[:, :3], start[:, 3]])
        moving = free[:, 1:].any() or start[:, 3].any()
        measured = tracks if moving else tracks.at_rest()
        found, adjusted = _converged(bundle, measured, selection, start, free, passes)
        sigmas = np.where(free, found.sigmas, sigmas)
        size = np.abs(found.values)
        beyond, unsure = free & (size >= LARGEST), free & (size < SURE_SIGMAS * sigmas)
        if beyond.any():  # it ended early: other captures' errors may be larger than they were then
            unsure &= beyond.any(1, keepdims=True)
        if not (beyond | unsure).any():
            return SensorCalibration(found.errors, sigmas), adjusted
        free = free & ~beyond & ~unsure


def _wrong_stamps(
    bundle: Bundle,
    tracks: FeatureTracks,
    selection: ObservationSelection,
    found: SensorCalibration,
    uneven: NDArray[np.intp],
) -> NDArray[np.intp]:
    """Of captures with uneven stamps of depth, those in which images show less than half of it."""
    if not len(uneven):
        return uneven
    share = np.zeros(found.values.shape, bool)
    share[uneven, 3] = True
    asked, _ = _converged(bundle, tracks, selection, found.values, share, (*FIRST_PASSES, 1.0))
    wrong: NDArray[np.intp] = uneven[asked.values[uneven, 3] < RIGHT_SHARE]
    return wrong


def _converged(
    bundle: Bundle,
    measured: FeatureTracks,
    selection: ObservationSelection,
    start: Array,
    free: NDArray[np.bool_],
    passes: Sequence[float],
) -> tuple[SensorCalibration, Bundle]:
    """The free errors (C, 4), found in passes from a start, and the bundle without them.

    From 0, what tells most of a delay stands out, and would be left out for it. So the first passes
    take more for noise, each so many times: the graduated non-convexity of Blake and Zisserman
    1987.
    """
    errors, priors = start, np.where(free, PRIOR_SIGMAS, HELD * PRIOR_SIGMAS)
    tracks, by_error = measured.without(_of_captures(errors))
    for width in passes:
        before, noise = errors, selection.noise(bundle, tracks).wider(width)
        inliers = selection.inliers(bundle, tracks, noise)
        rows = tracks.long(tracks.shared(inliers))
        problem = selection.problem(tracks.seen[rows], noise)
        grows = _by_capture(by_error[rows], tracks.captures[tracks.seen.camera[rows]], len(errors))
        for _ in range(STEPS):
            pull = -errors * free
            of_errors = pull.ravel(), priors.ravel(), np.tile(SYSTEMATIC, len(errors))
            step = calibrating_step(bundle, problem, grows, *of_errors)
            by_noise = errors + step.by_noise.reshape(errors.shape) * free
            bundle, errors = step.bundle, errors + step.change.reshape(errors.shape) * free
            problem = problem.measured_less(grows @ step.change)
        tracks, by_error = measured.without(_of_captures(errors))
        bundle = move_unshared_points(bundle, tracks, inliers, rows)
        sigmas = step.sigmas.reshape(errors.shape)
        enough = np.maximum(CONVERGED_SIGMAS * sigmas, CONVERGED_SHARE * np.abs(errors))
        settled = width == 1 and (np.abs(errors - before) <= enough).all()
        beyond = np.abs(by_noise) > LARGEST
        errors = np.where(beyond, by_noise, errors)
        if settled or beyond.any():
            break
    return SensorCalibration(_of_captures(errors), sigmas), bundle


def _of_captures(errors: Array) -> tuple[SensorErrors, ...]:
    """Errors (C, 4) of each capture."""
    return tuple(SensorErrors(*row) for row in errors.tolist())


def _by_capture(by_error: Array, captures: NDArray[np.int32], count: int) -> Array:
    """How what is measured (M, 3, 4) grows with the errors of all captures (M, 3, 4 C)."""
    grows = np.zeros((len(by_error), 3, count, 4))
    grows[np.arange(len(by_error)), :, captures] = by_error
    return grows.reshape(len(by_error), 3, 4 * count)
