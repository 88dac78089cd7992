"""Bundle adjustment of keyframes and landmarks: the optimum and its covariance; claim 3, S7."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError

from vnav.core.arrays import Array
from vnav.optimisation.bundle_problem import BundleProblem
from vnav.optimisation.normal_equations import NormalEquations, Numbering, ReducedSystem
from vnav.optimisation.pose_terms import PoseTerms
from vnav.optimisation.sensor_model import Bundle

UNKNOWN_SIGMA = 1.0  # rad, m: of what nothing determines; all that is determined is far better
CONVERGED = 1e-3  # relative decrease of the error; a hundredth of it moves no pose by 0.1 mm
DAMPING, MOST_DAMPING, DAMPED_MORE = 1e-5, 1e5, 10.0  # information of rad and m; its growth


def adjust(
    initial: Bundle, problem: BundleProblem, iterations: int, tolerance: float = CONVERGED
) -> Bundle:
    """Poses and points that explain all observations best; the first camera stays where it is.

    With a prior on the cameras, none is fixed but by it; if the prior is fixed, only points move.
    Noise of inverse depth is the same at every depth; observations without depth are plain
    projections. Levenberg-Marquardt with a Cauchy kernel, until a step takes less than
    ``tolerance`` of the error; deterministic. Without observations and edges nothing moves.
    """
    if not len(problem.cameras):
        return initial
    search, bundle = _Search.of(problem, initial), initial
    cost, damping = search.cost(initial), DAMPING
    for _ in range(iterations):
        step = search.step(bundle, cost, damping)
        if step is None:
            break
        bundle, before, cost = step.bundle, cost, step.cost
        damping = max(step.damping / DAMPED_MORE, DAMPING)
        if before - cost <= tolerance * before:
            break
    if problem.prior and problem.prior.fixed:
        return Bundle(initial.T_world_camera, bundle.points_world)
    return bundle


def covariances(bundle: Bundle, problem: BundleProblem) -> Array:
    """Marginal covariance (K, 6, 6) of each camera's tangent, rotation first; NaN if unseen.

    Relative to the camera that sees most: one that hardly holds to the others makes none of these
    unsure. Or to the world of the prior; that of the prior itself where it is fixed. Where
    observations leave a landmark undetermined, as a far one along its ray, each is held by
    `UNKNOWN_SIGMA`. Where they leave a pose so, each pose is held as well, and has that in the
    directions that nothing tells.
    """
    cameras = len(bundle.T_world_camera)
    if problem.prior and problem.prior.fixed:
        return np.tile(np.diag(problem.prior.sigmas**2), (cameras, 1, 1))
    found = np.full((cameras, 6, 6), np.nan)
    if not len(problem.cameras):
        return found
    normal, _ = _Search.of(problem.firmly_anchored, bundle).equations(bundle)
    found[problem.cameras] = _determined(normal).cameras.covariance()
    return found


def _determined(normal: NormalEquations) -> ReducedSystem:
    """The system with nothing held, or else landmarks, or poses as well."""
    weak = UNKNOWN_SIGMA**-2
    for loose in (0.0, weak):
        with suppress(LinAlgError):
            system = normal.reduced(0.0, loose)
            if system.cameras.determined and (loose or system.knows_landmarks):
                return system
    return normal.reduced(weak, weak)


@dataclass(frozen=True)
class _Search:
    """For the optimum of a problem."""

    problem: BundleProblem
    numbering: Numbering
    terms: PoseTerms

    @staticmethod
    def of(problem: BundleProblem, initial: Bundle) -> "_Search":
        return _Search(problem, Numbering(problem), PoseTerms.of(problem, initial))

    def cost(self, bundle: Bundle) -> float:
        """What is to be least: the cost of all residuals."""
        return self.problem.model.cost(bundle, self.problem.seen) + self.terms.cost(bundle)

    def step(self, bundle: Bundle, cost: float, damping: float) -> "_Step | None":
        """One that lessens the cost, damped as much as that takes; None where none does."""
        normal, right = self.equations(bundle)
        while damping <= MOST_DAMPING:
            with suppress(LinAlgError):
                solved = normal.reduced(damping, damping).solve(*right)
                moved = normal.moved(bundle, solved, np.ones(1))
                if (less := self.cost(moved)) < cost:
                    return _Step(moved, less, damping)
            damping *= DAMPED_MORE
        return None

    def equations(self, bundle: Bundle) -> tuple[NormalEquations, tuple[Array, Array]]:
        """The normal equations at a bundle, and their right sides (K, 6, 1) and (L, 3, 1)."""
        residuals, of_camera, of_point, _ = self.problem.model.weighted(bundle, self.problem.seen)
        normal = NormalEquations(self.numbering, of_camera, of_point)
        of_cameras, of_points = normal.right(residuals[..., None])
        of_cameras[..., 0] += normal.add(self.terms, bundle)
        return normal, (of_cameras, of_points)


@dataclass(frozen=True)
class _Step:
    """Where a step leads, what is left there, and the information by which it was damped."""

    bundle: Bundle
    cost: float
    damping: float
