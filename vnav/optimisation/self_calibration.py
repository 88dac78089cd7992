"""What the sensor does wrong, found together with the bundle: self-calibration."""

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

PRIOR_SIGMAS = np.array([2e-4, DEPTH_DELAY_SIGMA_S, LINE_DELAY_SIGMA_S])  # first: 3 mm at 4 m
LARGEST = np.array([6e-4, 0.05, 1e-4])  # what is found beyond is no such error
SURE_SIGMAS = np.array([0.0, 5.0, 5.0])  # with fewer from 0, a delay is not determined
PASSES, STEPS = 10, 2  # a pass chooses its observations, and measures them without the errors
FIRST_WIDTHS = 4.0, 2.0  # times the noise, of first passes: errors that are not known exceed it
CONVERGED_SIGMAS, CONVERGED_SHARE = 1.0, 0.03  # a pass that changes errors less is the last
HELD = 1e-6  # times the prior's: noise of an error that is not free


@dataclass(frozen=True)
class SensorCalibration:
    """What each capture's sensor does wrong, and standard deviations (C, 3) in the same order.

    Those of an error that is 0 say what it would have had to exceed; infinite where nothing tells.
    """

    errors: tuple[SensorErrors, ...]
    sigmas: Array

    @classmethod
    def unknown(cls, captures: int) -> "SensorCalibration":
        """Of so many captures, of which nothing is known."""
        return cls((SensorErrors(),) * captures, np.full((captures, 3), np.inf))

    @property
    def delayed(self) -> bool:
        """Whether anything is seen later than stamped."""
        return any(e.delayed for e in self.errors)

    @property
    def depth_delay_s(self) -> Array:
        """How long after colour each capture's depth is measured (C,)."""
        return np.array([e.depth_delay_s for e in self.errors])


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
    there, and no others.

    Depth by triangulation, from structured light or stereo, errs by an offset of its disparity.
    That bends what is far against what is near, as no scale would, and landmarks seen from several
    places show it: c0 of Herrera, Kannala, Heikkila 2012, "Joint depth and color camera calibration
    with distortion correction". A rolling shutter skews what a turning camera sees: Hedborg et al.
    2012, "Rolling shutter bundle adjustment". Late depth is of another view than colour's.
    """
    start = np.array([e.vector for e in known.errors])
    free, sigmas = start != 0, known.sigmas
    if not free.any():
        free[:] = True, *[tracks.sensor is not None] * 2
        sigmas = np.where(free, PRIOR_SIGMAS, np.inf)
    long, of_long = of_long_tracks(tracks, selection)
    while True:
        measured = long if free[:, 1:].any() else long.at_rest()
        found, adjusted = _converged(bundle, measured, of_long, start * free, free)
        sigmas = np.where(free, found.sigmas, sigmas)
        size = np.abs([e.vector for e in found.errors])
        beyond, unsure = free & (size >= LARGEST), free & (size < SURE_SIGMAS * sigmas)
        if beyond.any():  # it ended early: other captures' errors may be larger than they were then
            unsure &= beyond.any(1, keepdims=True)
        if not (beyond | unsure).any():
            return SensorCalibration(found.errors, sigmas), adjusted
        free = free & ~beyond & ~unsure


def _converged(
    bundle: Bundle,
    measured: FeatureTracks,
    selection: ObservationSelection,
    start: Array,
    free: NDArray[np.bool_],
) -> tuple[SensorCalibration, Bundle]:
    """The free errors (C, 3), found in passes from a start, and the bundle without them.

    From 0, what tells most of a delay stands out, and would be left out for it. So the first passes
    take more for noise: the graduated non-convexity of Blake and Zisserman 1987.
    """
    errors, priors = start, np.where(free, PRIOR_SIGMAS, HELD * PRIOR_SIGMAS)
    tracks, by_error = measured.without(_of_captures(errors))
    widths = () if start.any() else FIRST_WIDTHS
    for width in (*widths, *[1.0] * PASSES):
        before, noise = errors, selection.noise(bundle, tracks).wider(width)
        inliers = selection.inliers(bundle, tracks, noise)
        rows = tracks.long(tracks.shared(inliers))
        problem = selection.problem(tracks.seen[rows], noise)
        grows = _by_capture(by_error[rows], tracks.captures[tracks.seen.camera[rows]], len(errors))
        for _ in range(STEPS):
            step = calibrating_step(bundle, problem, grows, -errors.ravel(), priors.ravel())
            bundle, errors = step.bundle, errors + step.change.reshape(errors.shape) * free
            problem = problem.measured_less(grows @ step.change)
        tracks, by_error = measured.without(_of_captures(errors))
        bundle = move_unshared_points(bundle, tracks, inliers, rows)
        sigmas = step.sigmas.reshape(errors.shape)
        enough = np.maximum(CONVERGED_SIGMAS * sigmas, CONVERGED_SHARE * np.abs(errors))
        settled = width == 1 and (np.abs(errors - before) <= enough).all()
        if settled or (np.abs(errors) > LARGEST).any():
            break
    return SensorCalibration(_of_captures(errors), sigmas), bundle


def _of_captures(errors: Array) -> tuple[SensorErrors, ...]:
    """Errors (C, 3) of each capture."""
    return tuple(SensorErrors(*row) for row in errors.tolist())


def _by_capture(by_error: Array, captures: NDArray[np.int32], count: int) -> Array:
    """How what is measured (M, 3, 3) grows with the errors of all captures (M, 3, 3 C)."""
    grows = np.zeros((len(by_error), 3, count, 3))
    grows[np.arange(len(by_error)), :, captures] = by_error
    return grows.reshape(len(by_error), 3, 3 * count)
