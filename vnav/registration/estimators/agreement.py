"""Which motions are taken: those that enough matches agree on, and that these fix."""

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.registration.correspondences import Correspondences

LINE_SIGMAS = 2.0  # of depth: points that spread less off a line do not fix the turn about it


def agreed(
    T_a_b: Array,
    information: Array,
    inlier: NDArray[np.bool_],
    correspondences: Correspondences,
    config: RegistrationConfig,
) -> PoseEstimate | Rejected:
    """The estimate, with those matches (M,) that agree; Rejected where these do not fix it."""
    matches, count = correspondences.matches, int(inlier.sum())
    if (inlier & correspondences.fixes_scale).sum() < config.min_inliers:
        return Rejected("too few inliers", len(matches), count)
    far, near = inlier & correspondences.far, inlier & ~correspondences.far
    shares = (count, len(matches)), (near.sum(), len(matches) - correspondences.far.sum())
    if any(agree < config.min_inlier_share * asked for agree, asked in shares):
        return Rejected("too small a share of inliers", len(matches), count)
    points = correspondences.points_a(T_a_b)[near]
    if far.sum() < config.min_inliers and _are_collinear(points, config):
        return Rejected("matches on a line", len(matches), count)
    return PoseEstimate(T_a_b, information, matches[near], len(matches), far=matches[far])


def _are_collinear(points: Array, config: RegistrationConfig) -> bool:
    """Whether points (M, 3) spread off a line by no more than noise; so do those on one spot."""
    off = points - points.mean(0)
    variance = np.linalg.eigvalsh(off.T @ off / len(points))[1]
    noise = config.depth_sigma_per_m2**2 * (points[:, 2] ** 4).mean()
    return bool(variance < LINE_SIGMAS**2 * noise)
