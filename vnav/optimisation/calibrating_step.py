"""One Gauss-Newton step of a bundle together with what its sensor does wrong.

Landmarks are eliminated first (the Schur complement of Triggs et al. 2000), then cameras, which
leaves the sensor's errors and their covariance.
"""

from dataclasses import dataclass

import numpy as np

from vnav.core.arrays import Array
from vnav.optimisation.bundle_problem import FIXED_SIGMA, BundleProblem
from vnav.optimisation.normal_equations import NormalEquations, Numbering
from vnav.optimisation.sensor_model import Bundle

LOOSE_SIGMA = 0.1  # rad, m: how far a step may move a camera that too few landmarks hold
LOOSE_POINT_SIGMA = 100.0  # m: of a point


@dataclass(frozen=True)
class CalibratingStep:
    """The bundle after a step, the errors' change (E,), their standard deviations (E,).

    ``by_noise`` (E,): the change that there would be, did observations err by themselves alone.

    The standard deviations are of observations that err by themselves and systematically, or
    together where one camera made them (the sandwich estimator of Liang and Zeger 1986): flaws of
    the model and wrong matches widen them. The larger of the two counts, for few cameras tell the
    second too small.
    """

    bundle: Bundle
    change: Array
    by_noise: Array
    sigmas: Array


def calibrating_step(
    bundle: Bundle,
    problem: BundleProblem,
    by_error: Array,
    pull: Array,
    prior_sigmas: Array,
    systematic: Array | float = 0.0,
) -> CalibratingStep:
    """Cameras, landmarks and sensor's errors, all at once.

    ``by_error`` (M, 3, E): how pixel and inverse depth that are measured grow with the errors;
    ``pull`` (E,): the change that leads to their priors' means; ``systematic`` (E,): standard
    deviation of what all observations may err by in common, of each error's kind, so that no number
    of them tells it better. Observations weigh as under the kernel that `bundle.adjust` minimises.
    Edges are left out: they hold cameras that landmarks do not, and these tell nothing of the
    sensor. Without observations nothing changes.
    """
    if not len(problem.seen):
        return CalibratingStep(bundle, np.zeros_like(pull), np.zeros_like(pull), prior_sigmas)
    residuals, of_camera, of_point, root = problem.model.weighted(bundle, problem.seen)
    errors = by_error * root[:, None, None] / problem.model.sigmas[:, None]
    errors[~np.isfinite(problem.seen.inverse_depth), 2] = 0
    right = np.concatenate([errors, residuals[..., None]], 2)
    normal = NormalEquations(Numbering(problem), of_camera, of_point)
    held = _held(problem, len(normal.numbering.cameras))
    solved = normal.reduced(held, LOOSE_POINT_SIGMA**-2).solve(*normal.right(right))
    unexplained = right - normal.shown(solved)  # what no camera and no landmark explains
    design, residuals = unexplained[..., :-1], unexplained[..., -1]
    counts = 1 / (1 + systematic**2 * np.einsum("mik,mik->k", errors, errors))
    prior, drawn = np.diag(prior_sigmas**-2), pull / prior_sigmas**2
    information, gradient = (np.einsum("mik,mi...->k...", design, k) for k in (design, residuals))
    by_noise = np.linalg.solve(information + prior, gradient + drawn)
    covariance = np.linalg.inv(np.sqrt(np.outer(counts, counts)) * information + prior)
    change = covariance @ (counts * gradient + drawn)
    score = counts * np.einsum("mik,mi->mk", design, residuals - design @ change)
    numbering = normal.numbering
    by_camera = np.zeros((len(numbering.cameras), len(change)))
    np.add.at(by_camera, numbering.camera, score)
    together = covariance @ by_camera.T @ by_camera @ covariance
    sigmas = np.sqrt(np.maximum(np.diag(covariance), np.diag(together)))
    moved = normal.moved(bundle, solved, np.append(-change, 1.0))
    if problem.prior and problem.prior.fixed:
        moved = Bundle(bundle.T_world_camera, moved.points_world)
    return CalibratingStep(moved, change, by_noise, sigmas)


def _held(problem: BundleProblem, count: int) -> Array:
    """Information (K, 6) that keeps cameras where they are: of their prior, or of the first."""
    if problem.prior:
        return np.tile(problem.prior.information, (count, 1))
    held = np.full((count, 6), LOOSE_SIGMA**-2)
    held[:1] = FIXED_SIGMA**-2
    return held
