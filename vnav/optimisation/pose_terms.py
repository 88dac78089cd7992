"""What a bundle knows of its cameras' poses beside landmarks: edges between them, and a prior."""

from dataclasses import dataclass

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.optimisation.bundle_problem import BundleProblem
from vnav.optimisation.sensor_model import Bundle


@dataclass(frozen=True)
class PoseTerms:
    """Relative poses ``T_i_j`` (E, 4, 4) of cameras ``i``, ``j`` (E,), information (E, 6, 6).

    Cameras are rows of a bundle. A prior is of the world, i = -1.
    """

    i: Rows
    j: Rows
    T_i_j: Array
    information: Array

    @staticmethod
    def of(problem: BundleProblem, initial: Bundle) -> "PoseTerms":
        """The edges of a problem; its prior, or one that holds the anchor where it is."""
        held, prior = problem.held(initial)
        edges, of_prior = problem.edges, np.tile(np.diag(prior.information), (len(held), 1, 1))
        return PoseTerms(
            np.array([*(e.i for e in edges), *(-1 for _ in held)], np.intp),
            np.array([*(e.j for e in edges), *held], np.intp),
            np.array([*(e.T_i_j for e in edges), *prior.T_world_camera[held]]),
            np.array([*(e.information for e in edges), *of_prior]),
        )

    def cost(self, bundle: Bundle) -> float:
        """Half the sum of squared deviations, in standard deviations."""
        off, _, _ = self._linearised(bundle)
        return float(np.einsum("ei,eij,ej", off, self.information, off) / 2)

    def equations(self, bundle: Bundle) -> tuple[Array, Array]:
        """Of both cameras' tangents: information (E, 12, 12), and right sides (E, 12)."""
        off, of_i, of_j = self._linearised(bundle)
        J = np.concatenate([of_i, of_j], 2)
        weighted = J.swapaxes(1, 2) @ self.information
        return weighted @ J, -(weighted @ off[..., None])[..., 0]

    def _linearised(self, bundle: Bundle) -> tuple[Array, Array, Array]:
        """Deviations (E, 6), and their derivatives (E, 6, 6) by both cameras' tangents."""
        T_world = np.concatenate([bundle.T_world_camera, np.eye(4)[None]])
        between = se3.inverse(T_world[self.i]) @ T_world[self.j]
        left = se3.inverse(self.T_i_j) @ between
        off, of_j = se3.deviation(left), np.zeros((len(left), 6, 6))
        turn = se3.hat(off[:, :3])
        of_j[:, :3, :3] = np.eye(3) + turn / 2 + turn @ turn / 12
        of_j[:, 3:, 3:] = left[:, :3, :3]
        return off, -of_j @ se3.adjoint(se3.inverse(between)), of_j
