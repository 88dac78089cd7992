"""The reprojection error and its derivative."""

import numpy as np

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.registration.estimators.pnp import reprojection_jacobian

CAMERA = Intrinsics(640, 480, 525.0, 515.0, 319.5, 239.5)
STEP = 1e-6


def test_the_derivative_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(0)
    camera = np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])
    for point in rng.uniform([-1, -1, 0.5], [1, 1, 5], (50, 3)):
        J, numeric = np.empty((3, 6)), np.empty((2, 6))
        reprojection_jacobian(J, point, camera)
        for k in range(6):
            ends = []
            for step in (-STEP, STEP):
                tangent = np.zeros(6)
                tangent[(k + 3) % 6] = step  # here the translation is first
                ends.append(-CAMERA.project(se3.transform(se3.exp(tangent), point[None]))[0])
            numeric[:, k] = (ends[1] - ends[0]) / (2 * STEP)
        # the third derivative times the step squared, and rounding over the step: 1e-6 of 1e3 px
        np.testing.assert_allclose(J[:2], numeric, rtol=1e-5, atol=1e-3)
