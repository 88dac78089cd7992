"""Non-linear refinement of a camera's pose, and of its focal length where that is unknown."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.localisation.view import MIN_DEPTH_M, View

Array = NDArray[np.float64]

MAX_ITERATIONS = 15
HUBER_SIGMAS = 1.5
CONVERGED = 1e-4  # relative gain of a step


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
    """A view and the covariance of its parameters, (6, 6), or (7, 7) with the log focal length.

    Tangent of ``T_world_camera``, rotation first.
    """

    view: View
    covariance: Array


def refine(view: View, seen: Sightings, lens: Lens) -> Refined:
    """The most likely view near the given one, and its focal length unless exact (claim 4, 2.10).

    Levenberg-Marquardt on the reprojection errors under Huber's kernel. The covariance is the
    inverse information, widened where the residuals are larger than their variances say.
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
    spread = max(1.0, cost / max(1, 2 * len(seen.px) - len(H)))
    return Refined(view, np.asarray(np.linalg.pinv(H, hermitian=True) * spread, float))


def _normal(view: View, seen: Sightings, lens: Lens) -> tuple[Array, Array, float]:
    """Information matrix, gradient and cost, each point weighted by Huber's kernel."""
    J, r = _linearised(view, seen, lens.focal_sigma > 0)
    size = np.linalg.norm(r, axis=1)
    weight = HUBER_SIGMAS / np.maximum(size, HUBER_SIGMAS)
    weighted = (J * weight[:, None, None]).reshape(-1, J.shape[2])
    H, g = weighted.T @ J.reshape(-1, J.shape[2]), weighted.T @ r.reshape(-1)
    far = HUBER_SIGMAS * (2 * size - HUBER_SIGMAS)
    cost = float(np.where(size > HUBER_SIGMAS, far, size**2).sum())
    if lens.focal_sigma > 0:
        off = np.log(view.intrinsics.fx / lens.intrinsics.fx) / lens.focal_sigma
        H[6, 6] += lens.focal_sigma**-2
        g[6] += off / lens.focal_sigma
        cost += off**2
    return H, g, cost


def _linearised(view: View, seen: Sightings, with_focal: bool) -> tuple[Array, Array]:
    """Residuals (N, 2) over their standard deviation, and their Jacobian (N, 2, 6 or 7).

    ``T_world_camera @ exp(xi)`` moves a point p in the camera by hat(p) rotation - translation.
    """
    k = view.intrinsics
    p = se3.transform(view.T_camera_world, seen.points_world)
    inverse_z = 1 / np.maximum(p[:, 2], MIN_DEPTH_M)
    x, y = p[:, 0] * inverse_z, p[:, 1] * inverse_z
    r = np.stack([k.fx * x + k.cx - seen.px[:, 0], k.fy * y + k.cy - seen.px[:, 1]], 1)
    J = np.zeros((len(p), 2, 7 if with_focal else 6))
    J[:, 0, 0], J[:, 0, 1], J[:, 0, 2] = x * y, -1 - x * x, y
    J[:, 1, 0], J[:, 1, 1], J[:, 1, 2] = 1 + y * y, -x * y, -x
    J[:, 0, 3], J[:, 0, 5] = -inverse_z, x * inverse_z
    J[:, 1, 4], J[:, 1, 5] = -inverse_z, y * inverse_z
    if with_focal:
        J[:, 0, 6], J[:, 1, 6] = x, y
    weight = 1 / np.sqrt(seen.variance_px2)
    J *= np.stack([k.fx * weight, k.fy * weight], 1)[..., None]
    return J, r * weight[:, None]
