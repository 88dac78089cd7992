"""Whether a photo is whole, or was cropped off its centre: its file does not tell."""

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import CameraPrior
from vnav.localisation.hypotheses.pose_refinement import ANYWHERE, RefinedPose

CROPPED = 0.1  # share of the photos without a camera that are supposed to be
SURE = 3.0  # log-odds, beyond which what else speaks for a pose decides


def log_odds_of_cropped(free: RefinedPose, camera: CameraPrior) -> float:
    """Of a cropped photo against a whole one, by a principal point that was found freely.

    That of a whole photo is near the centre, that of a cropped one may be anywhere. At most
    `SURE`: a pose that is mistaken has a principal point far off, too.
    """
    found, known = free.view.intrinsics, camera.intrinsics
    off = np.array([found.cx - known.cx, found.cy - known.cy]) / max(known.size)
    fits = [_log_density(off, free.covariance[7:, 7:], s) for s in (ANYWHERE, camera.centre_sigma)]
    return min(SURE, fits[0] - fits[1] + float(np.log(CROPPED / (1 - CROPPED))))


def _log_density(off: Array, covariance: Array, sigma: float) -> float:
    """Of a normal vector, but for a constant; ``sigma`` of its own beside the covariance."""
    total = covariance + sigma**2 * np.eye(len(off))
    return float(-(off @ np.linalg.solve(total, off) + np.log(np.linalg.det(total))) / 2)
