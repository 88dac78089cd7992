"""What cameras see of points, and how that changes with both: compiled."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array

NEAREST_M = 0.05  # what lies nearer, or behind the camera, is not seen


@compiled
def linearise(
    T_camera_world: Array,
    points_world: Array,
    camera: NDArray[np.int32],
    landmark: NDArray[np.int32],
    measured: Array,
    fx_fy_cx_cy: Array,
    sigmas: Array,
) -> tuple[Array, Array, Array]:
    """Residuals (M, 3) and derivatives (M, 3, 6), (M, 3, 3); see `SensorModel.linearised`.

    ``measured`` (M, 3): pixels and inverse depth, NaN where there is none. All is 0 where the
    point is not in front of its camera.
    """
    count = len(camera)
    residuals, of_camera = np.zeros((count, 3)), np.zeros((count, 3, 6))
    of_point = np.zeros((count, 3, 3))
    p, J = np.zeros(3), np.zeros((3, 3))
    for m in range(count):
        T, X, k = T_camera_world[camera[m]], points_world[landmark[m]], fx_fy_cx_cy[camera[m]]
        for a in range(3):
            p[a] = T[a, 0] * X[0] + T[a, 1] * X[1] + T[a, 2] * X[2] + T[a, 3]
        if p[2] <= NEAREST_M:
            continue
        w = 1 / p[2]
        for a in range(2):
            residuals[m, a] = (measured[m, a] - k[a] * p[a] * w - k[2 + a]) / sigmas[a]
            J[a, a], J[a, 2] = k[a] * w / sigmas[a], -k[a] * p[a] * w * w / sigmas[a]
        has_depth = np.isfinite(measured[m, 2])
        residuals[m, 2] = (measured[m, 2] - w) / sigmas[2] if has_depth else 0.0
        J[2, 2] = -w * w / sigmas[2] if has_depth else 0.0
        for a in range(3):
            of_camera[m, a, 0] = J[a, 1] * p[2] - J[a, 2] * p[1]
            of_camera[m, a, 1] = J[a, 2] * p[0] - J[a, 0] * p[2]
            of_camera[m, a, 2] = J[a, 0] * p[1] - J[a, 1] * p[0]
            for b in range(3):
                of_camera[m, a, 3 + b] = -J[a, b]
                of_point[m, a, b] = J[a, 0] * T[0, b] + J[a, 1] * T[1, b] + J[a, 2] * T[2, b]
    return residuals, of_camera, of_point
