"""Non-linear refinement of a camera's pose, and of its focal length where that is unknown."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.localisation.view import MIN_DEPTH_M, View

Array = NDArray[np.float64]

MAX_ITERATIONS = 15
HUBER_SIGMAS = 1.5
CONVERGED = 1e-4  # relative gain of a step
ASSUMED = 20.0  # residuals that the assumed variances count for


@dataclass(frozen=True)
class Lens:
    """What is known of a camera: its intrinsics, and how well its focal length is known.

    ``focal_sigma``: relative standard deviation; 0: exact, inf: nothing is known.
    """

    intrinsics: Intrinsics
    focal_sigma: float


@dataclass(frozen=True)
class Sightings:
    """Points (N, 3) of the map, the pixels (N, 2) they are seen at, and the variance (N,) of both.

    ``variance_px2`` adds the keypoint's noise and the projected noise of the landmark.
    """

    points_world: NDArray[np.float32]
    px: NDArray[np.float32]
    variance_px2: Array

    def __getitem__(self, chosen: NDArray[np.bool_]) -> "Sightings":
        """The chosen rows."""
        return Sightings(self.points_world[chosen], self.px[chosen], self.variance_px2[chosen])


@dataclass(frozen=True)
class Refined:
    """A view, the information (6, 6) of its parameters, and how far residuals exceed it.

    Tangent of ``T_world_camera``, rotation first; (7, 7) with the log focal length. ``spread``:
    the residuals' variance by what was told of it.
    """

    view: View
    information: Array
    spread: float

    @property
    def covariance(self) -> Array:
        """Of the same parameters."""
        inverse = np.linalg.pinv(self.information, hermitian=True)
        return np.asarray(inverse * self.spread, float)


def refine(view: View, seen: Sightings, lens: Lens) -> Refined:
    """The most likely view near the given one, and its focal length unless exact (claim 4, 2.10).

    Levenberg-Marquardt on the reprojection errors under Huber's kernel. The covariance is the
    inverse information, scaled to what the residuals show of their variances: the more residuals
    there are, the less counts what was assumed.
    """
    damping = 1e-4
    H, g, cost = _normal(view, seen, lens)
    for _ in range(MAX_ITERATIONS):
        step = np.linalg.solve(H + damping * np.diag(H.diagonal() + 1e-12), g)
        trial = view.moved(np.asarray(-step, float))
        H_trial, g_trial, trial_cost = _normal(trial, seen, lens)
        if trial_cost > cost:
            damping *= 10
            continue
        converged = cost - trial_cost < CONVERGED * cost
        view, H, g, cost, damping = trial, H_trial, g_trial, trial_cost, damping / 10
        if converged:
            break
    freedom = max(0, 2 * len(seen.px) - len(H))
    return Refined(view, H, (ASSUMED + cost) / (ASSUMED + freedom))


def _normal(view: View, seen: Sightings, lens: Lens) -> tuple[Array, Array, float]:
    """Information matrix, gradient and cost, each point weighted by Huber's kernel."""
    J, r = _linearised(view, seen, lens.focal_sigma > 0)
    size = np.sqrt(r[0] * r[0] + r[1] * r[1])
    near = np.minimum(size, HUBER_SIGMAS)
    weighted = J * (HUBER_SIGMAS / np.maximum(size, HUBER_SIGMAS))
    weighted, J = weighted.reshape(len(J), -1), J.reshape(len(J), -1)
    H, g = weighted @ J.T, weighted @ r.reshape(-1)
    cost = float((near * (2 * size - near)).sum())
    if lens.focal_sigma > 0:
        off = np.log(view.intrinsics.fx / lens.intrinsics.fx) / lens.focal_sigma
        H[6, 6] += lens.focal_sigma**-2
        g[6] += off / lens.focal_sigma
        cost += off**2
    return H, g, cost


def _linearised(view: View, seen: Sightings, with_focal: bool) -> tuple[Array, Array]:
    """Residuals (2, N) over their standard deviation, and their Jacobian (6 or 7, 2, N).

    ``T_world_camera @ exp(xi)`` moves a point p in the camera by hat(p) rotation - translation.
    """
    k = view.intrinsics
    p = view.T_camera_world[:3, :3] @ seen.points_world.T + view.T_camera_world[:3, 3:]
    inverse_z = 1 / np.maximum(p[2], MIN_DEPTH_M)
    x, y = p[0] * inverse_z, p[1] * inverse_z
    weight = 1 / np.sqrt(seen.variance_px2)
    u, v = k.fx * weight, k.fy * weight
    r = np.stack([k.fx * x + k.cx - seen.px[:, 0], k.fy * y + k.cy - seen.px[:, 1]]) * weight
    J = np.zeros((7 if with_focal else 6, 2, len(x)))
    J[0, 0], J[1, 0], J[2, 0] = x * y * u, (-1 - x * x) * u, y * u
    J[0, 1], J[1, 1], J[2, 1] = (1 + y * y) * v, -x * y * v, -x * v
    J[3, 0], J[5, 0] = -inverse_z * u, x * inverse_z * u
    J[4, 1], J[5, 1] = -inverse_z * v, y * inverse_z * v
    if with_focal:
        J[6, 0], J[6, 1] = x * u, y * v
    return J, r
