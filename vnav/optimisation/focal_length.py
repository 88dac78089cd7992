"""Which focal length the images fit, held against the one that their camera was given."""

from dataclasses import dataclass, replace

import numpy as np

from vnav.core.camera import Intrinsics
from vnav.optimisation.calibrating_step import calibrating_step
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.observation_selection import ObservationSelection
from vnav.optimisation.sensor_model import Bundle

PRIOR_SHARE = 0.3  # of the focal length
PASSES = 10  # each chooses its observations anew: a wrong camera makes right ones stand out
CONVERGED_SIGMAS = 0.3


@dataclass(frozen=True)
class FocalLength:
    """Along x, in pixels: as given, as the images have it, the standard deviation of that."""

    given_px: float
    fitted_px: float
    sigma_px: float


def focal_lengths(
    bundle: Bundle, tracks: FeatureTracks, selection: ObservationSelection
) -> tuple[FocalLength, ...]:
    """One for each camera of the keyframes; with those that a bundle was adjusted by.

    Inverse depth tells how large the scene is, and landmarks seen from several places how wide a
    view is. Where these do not tell, the standard deviation is that of the prior.
    """
    intrinsics = selection.model.intrinsics
    cameras = list(dict.fromkeys(intrinsics))
    number = np.array([cameras.index(camera) for camera in intrinsics])
    of_rows = number[tracks.seen.camera[selection.rows]]
    return tuple(
        _fitted(camera, bundle, tracks, replace(selection, rows=selection.rows[of_rows == k]))
        for k, camera in enumerate(cameras)
    )


def _fitted(
    camera: Intrinsics, bundle: Bundle, tracks: FeatureTracks, selection: ObservationSelection
) -> FocalLength:
    """Of one camera, by what it saw alone.

    A shorter lens shows all nearer to the principal point, by one share, and pixels are scaled by
    what is left of it: that is linear, however wrong the camera is.
    """
    from_center = tracks.seen.px - (camera.cx, camera.cy)
    short = 0.0
    for _ in range(PASSES):
        measured = tracks.measured(tracks.seen.px - short * from_center)
        noise = selection.noise(bundle, measured)
        inliers = selection.inliers(bundle, measured, noise)
        rows = measured.long(measured.shared(inliers))
        by_share = np.zeros((len(rows), 3, 1))
        by_share[:, :2, 0] = from_center[rows]
        problem = selection.problem(measured.seen[rows], noise)
        pull, prior = np.array([-short]), np.array([PRIOR_SHARE])
        step = calibrating_step(bundle, problem, by_share, pull, prior)
        bundle, short = step.bundle, short + float(step.change[0])
        if abs(step.change[0]) <= CONVERGED_SIGMAS * step.sigmas[0]:
            break
    fitted = camera.fx / (1 - short)
    return FocalLength(camera.fx, fitted, fitted * float(step.sigmas[0]) / (1 - short))
