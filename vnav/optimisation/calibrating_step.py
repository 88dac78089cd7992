"""One Gauss-Newton step of a bundle together with what its sensor does wrong.

Landmarks are eliminated first (the Schur complement of Triggs et al. 2000), then cameras, which
leaves the sensor's errors and their covariance.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csr_array
from scipy.sparse.linalg import splu

from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.optimisation.bundle_graph import FIXED_SIGMA, LEAST_PRIOR_SIGMA, BundleProblem
from vnav.optimisation.sensor_model import Bundle

LOOSE_SIGMA = 0.1  # rad, m: how far a step may move a camera that too few landmarks hold
LOOSE_POINT_SIGMA = 100.0  # m: of a point


@dataclass(frozen=True)
class CalibratingStep:
    """The bundle after a step, the errors' change (E,), their standard deviations (E,).

    Those are of observations that err by themselves, or together where one camera made them (the
    sandwich estimator of Liang and Zeger 1986): flaws of the model and wrong matches widen them.
    The larger of the two counts, for few cameras tell the second too small.
    """

    bundle: Bundle
    change: Array
    sigmas: Array


def calibrating_step(
    bundle: Bundle, problem: BundleProblem, by_error: Array, pull: Array, prior_sigmas: Array
) -> CalibratingStep:
    """Cameras, landmarks and sensor's errors, all at once.

    ``by_error`` (M, 3, E): how pixel and inverse depth that are measured grow with the errors;
    ``pull`` (E,): the change that leads to their priors' means. Observations weigh as under the
    kernel that `bundle.adjust` minimises. Edges are left out: they hold cameras that landmarks do
    not, and these tell nothing of the sensor. Without observations nothing changes.
    """
    if not len(problem.seen):
        return CalibratingStep(bundle, np.zeros_like(pull), prior_sigmas)
    normal, right = _normal_equations(bundle, problem, by_error)
    solved = normal.solve(right)
    unexplained = right - normal.shown(solved)  # what no camera and no landmark explains
    design, residuals = unexplained[..., :-1], unexplained[..., -1]
    information = np.einsum("mik,mil->kl", design, design) + np.diag(prior_sigmas**-2)
    covariance = np.linalg.inv(information)
    gradient = np.einsum("mik,mi->k", design, residuals) + pull / prior_sigmas**2
    change = covariance @ gradient
    score = np.einsum("mik,mi->mk", design, residuals - design @ change)
    of_camera = _summed(score, normal.camera, len(normal.cameras))
    together = covariance @ of_camera.T @ of_camera @ covariance
    sigmas = np.sqrt(np.maximum(np.diag(covariance), np.diag(together)))
    moved = normal.moved(bundle, solved, np.append(-change, 1.0))
    if problem.prior and problem.prior.fixed:
        moved = Bundle(bundle.T_world_camera, moved.points_world)
    return CalibratingStep(moved, change, sigmas)


class _NormalEquations:
    """Of cameras and landmarks, numbered by those that occur; J of M observations, 3 rows each."""

    def __init__(
        self,
        seen_by: NDArray[np.int32],
        landmark: NDArray[np.int32],
        of_camera: Array,
        of_point: Array,
    ) -> None:
        self.cameras, self.camera = np.unique(seen_by, return_inverse=True)
        self.landmarks, self.landmark = np.unique(landmark, return_inverse=True)
        self._of_camera, self._of_point = of_camera, of_point
        self.held = np.zeros((len(self.cameras), 6))  # information

    def solve(self, right: Array) -> tuple[Array, Array]:
        """Tangents (K, 6, R) and moves (L, 3, R) that explain right sides (M, 3, R) best."""
        A, P = self._of_camera.swapaxes(1, 2), self._of_point.swapaxes(1, 2)
        K, L = len(self.cameras), len(self.landmarks)
        cameras = _summed(A @ self._of_camera, self.camera, K)
        cameras[:, range(6), range(6)] += self.held
        loose = np.eye(3) / LOOSE_POINT_SIGMA**2
        points = np.linalg.inv(_summed(P @ self._of_point, self.landmark, L) + loose)
        of_cameras = _summed(A @ right, self.camera, K).reshape(6 * K, -1)
        of_points = _summed(P @ right, self.landmark, L)
        across = A @ self._of_point
        B, eliminated = self._sparse(across), self._sparse(across @ points[self.landmark])
        reduced = (block_diag(list(cameras)) - eliminated @ B.T).tocsc()
        tangents = splu(reduced).solve(of_cameras - eliminated @ of_points.reshape(3 * L, -1))
        moves = points @ (of_points - (B.T @ tangents).reshape(L, 3, -1))
        return tangents.reshape(K, 6, -1), moves

    def shown(self, solved: tuple[Array, Array]) -> Array:
        """What tangents and moves change in the observations: (M, 3, R)."""
        tangents, moves = solved
        return np.asarray(
            self._of_camera @ tangents[self.camera] + self._of_point @ moves[self.landmark]
        )

    def moved(self, bundle: Bundle, solved: tuple[Array, Array], weights: Array) -> Bundle:
        """The bundle moved by the sum of the R solutions, weighted."""
        tangents, moves = solved
        poses, points = bundle.T_world_camera.copy(), bundle.points_world.copy()
        poses[self.cameras] = poses[self.cameras] @ se3.exp(tangents @ weights)
        points[self.landmarks] += moves @ weights
        return Bundle(poses, points)

    def _sparse(self, blocks: Array) -> csr_array:
        """A matrix (6 K, 3 L) of the blocks (M, 6, 3) at their camera and landmark."""
        row = 6 * self.camera[:, None, None] + np.arange(6)[:, None] + np.zeros(3, int)
        column = 3 * self.landmark[:, None, None] + np.zeros((6, 1), int) + np.arange(3)
        shape = 6 * len(self.cameras), 3 * len(self.landmarks)
        return csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=shape)


def _normal_equations(
    bundle: Bundle, problem: BundleProblem, by_error: Array
) -> tuple[_NormalEquations, Array]:
    """Weighted by the kernel, and their right sides (M, 3, E + 1): the errors', then residuals."""
    seen, model = problem.seen, problem.model
    residuals, of_camera, of_point = model.linearised(bundle, seen)
    root = np.sqrt(model.weights((residuals**2).sum(1)))[:, None, None]
    errors = by_error / model.sigmas[:, None]
    errors[~np.isfinite(seen.inverse_depth), 2] = 0
    right = root * np.concatenate([errors, residuals[..., None]], 2)
    normal = _NormalEquations(seen.camera, seen.landmark, root * of_camera, root * of_point)
    normal.held += _held(problem, normal.cameras)
    return normal, right


def _held(problem: BundleProblem, cameras: NDArray[np.integer]) -> Array:
    """Information (K, 6) that keeps cameras where they are: of their prior, or of the first."""
    if problem.prior:
        fixed = problem.prior.fixed
        sigmas = FIXED_SIGMA if fixed else problem.prior.sigmas.clip(LEAST_PRIOR_SIGMA)
        return np.broadcast_to(1 / np.square(sigmas), (len(cameras), 6))
    held = np.full((len(cameras), 6), LOOSE_SIGMA**-2)
    held[:1] = FIXED_SIGMA**-2
    return held


def _summed(values: Array, group: Rows, count: int) -> Array:
    """Sums (count, ...) of the values (M, ...) of each group."""
    sums = np.zeros((count, *values.shape[1:]))
    np.add.at(sums, group, values)
    return sums
