"""Which focal length, principal point and distortion the images fit, beside those given."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.optimisation.calibrating_step import calibrating_step
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.observation_selection import ObservationSelection, of_long_tracks
from vnav.optimisation.sensor_model import Bundle

PRIORS = 0.3, 0.1, 0.1, 0.3  # shares of the focal length, of itself and of the principal point; k1
PASSES = 10  # each chooses its observations anew: a wrong camera makes right ones stand out
CONVERGED_SIGMAS = 0.3


@dataclass(frozen=True)
class CameraFit:
    """What was given of a camera, what its images fit, and standard deviations of that.

    All are ``fx``, ``cx``, ``cy`` in pixels, and ``k1``: radial distortion of images that are
    taken for undistorted. ``corner``: tangent of the angle between the axis and a corner.
    """

    given: Sequence[float]
    fitted: Sequence[float]
    sigma: Sequence[float]
    corner: float

    @property
    def off(self) -> Array:
        """By how much of the focal length each shifts a pixel (4,), that of a corner by ``k1``."""
        wrong = np.abs(np.subtract(self.fitted, self.given))
        return np.append(wrong[:3] / self.given[0], wrong[3] * self.corner**3)

    @property
    def off_sigmas(self) -> Array:
        """The same in standard deviations."""
        return np.abs(np.subtract(self.fitted, self.given)) / self.sigma


def camera_fits(
    bundle: Bundle, tracks: FeatureTracks, selection: ObservationSelection
) -> tuple[CameraFit, ...]:
    """One for each camera of the keyframes; with those that a bundle was adjusted by.

    Inverse depth tells how large the scene is, landmarks seen from several places how wide a view
    is, and those seen by a camera that turns where its axis is, and how it is bent off that. Where
    these do not tell, the standard deviations are those of the prior.
    """
    tracks, selection = of_long_tracks(tracks, selection)
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
) -> CameraFit:
    """Of one camera, by what it saw alone.

    A shorter lens shows all nearer to the principal point by one share, another axis shifts all,
    and a distorting lens does as its first term says. Pixels that are moved back are linear in
    all of it, however wrong the camera is.
    """
    by_camera = _by_camera(tracks.seen.px, camera)
    wrong, priors = np.zeros(len(PRIORS)), np.array(PRIORS)
    for _ in range(PASSES):
        measured = tracks.measured(tracks.seen.px - by_camera @ wrong)
        noise = selection.noise(bundle, measured)
        inliers = selection.inliers(bundle, measured, noise)
        rows = measured.long(measured.shared(inliers))
        problem = selection.problem(measured.seen[rows], noise)
        off = noise.linearised(bundle, problem.seen)[0][:, :2] * noise.pixel_sigma
        by_error = np.zeros((len(rows), 3, len(wrong)))  # of what is shown: it has no noise
        by_error[:, :2] = _by_camera(tracks.seen.px[rows] - off, camera)
        step = calibrating_step(bundle, problem, by_error, -wrong, priors)
        bundle, wrong = step.bundle, wrong + step.change
        if (np.abs(step.change) <= CONVERGED_SIGMAS * step.sigmas).all():
            break
    unit = np.array([*[camera.fx / (1 - wrong[0])] * 3, 1.0])
    given = np.array([camera.fx, camera.cx, camera.cy, 0.0])
    corner = float(np.hypot(*camera.size) / (2 * camera.fx))
    fitted, sigma = given + unit * wrong, unit * step.sigmas
    return CameraFit(given.tolist(), fitted.tolist(), sigma.tolist(), corner)


def _by_camera(px: Array, camera: Intrinsics) -> Array:
    """How pixels (N, 2) grow with the camera's errors (N, 2, 4), in shares of its focal length."""
    from_center = px - (camera.cx, camera.cy)
    by_camera = np.zeros((len(px), 2, len(PRIORS)))
    by_camera[:, :, 0] = from_center
    by_camera[:, 0, 1] = by_camera[:, 1, 2] = camera.fx
    by_camera[:, :, 3] = from_center * ((from_center / camera.fx) ** 2).sum(1, keepdims=True)
    return by_camera
