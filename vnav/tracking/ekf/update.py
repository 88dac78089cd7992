"""What measured pixels tell of the state: [000 eq 6, eq 7]."""

import numpy as np

from vnav.core.arrays import Array
from vnav.tracking.ekf.measurement_model import Measurement
from vnav.tracking.ekf.state import CAMERA, FEATURE, POSE, FilterState, with_unit_quaternion


def updated(
    state: FilterState, measurement: Measurement, found_px: Array, sigma_px: float
) -> FilterState:
    """The state after pixels (N, 2) were found where h was expected, all at once."""
    return joseph(state, *_innovations(state, measurement, found_px, sigma_px))


def joseph(state: FilterState, HP: Array, S: Array, innovation: Array) -> FilterState:
    """``x + K (z - h)`` and ``(I - K H) P (I - K H)' + K R K'``, S = H P H' + R, K = P H' / S.

    The latter is Joseph's form taken apart, so that nothing larger than P is multiplied with P.
    """
    K = np.linalg.solve(S, HP).T
    KHP = K @ HP
    P = state.P - KHP - KHP.T + K @ S @ K.T
    return with_unit_quaternion(state.x + K @ innovation, P)


def moved_by(
    state: FilterState, measurement: Measurement, found_px: Array, sigma_px: float
) -> Array:
    """The mean only, updated by few pixels (N, 2): ``x + K_i (z_i - h_i)``."""
    HP, S, innovation = _innovations(state, measurement, found_px, sigma_px)
    return np.asarray(state.x + HP.T @ np.linalg.solve(S, innovation))


def _innovations(
    state: FilterState, measurement: Measurement, found_px: Array, sigma_px: float
) -> tuple[Array, Array, Array]:
    """H P (2 N, M), S (2 N, 2 N) and z - h (2 N,) of pixels (N, 2), all at once."""
    HP = measurement.times(state.P)
    S = measurement.times(HP.T) + sigma_px**2 * np.eye(len(HP))
    return HP, S, (found_px - measurement.pixels).reshape(-1)


def innovation_covariances(P: Array, measurement: Measurement, sigma_px: float) -> Array:
    """S (N, 2, 2) of each pixel alone."""
    n, features = len(measurement.features), (len(P) - CAMERA) // FEATURE
    HP = measurement.times(P).reshape(n, 2, len(P))
    by_feature = HP[:, :, CAMERA:].reshape(n, 2, features, FEATURE)
    blocks = by_feature[np.arange(n), :, measurement.features]
    S = HP[:, :, POSE] @ np.swapaxes(measurement.by_pose, 1, 2)
    S += blocks @ np.swapaxes(measurement.by_feature, 1, 2)
    return np.asarray(S + sigma_px**2 * np.eye(2))
