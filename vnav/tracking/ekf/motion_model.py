"""The camera moves on as before, but for unknown accelerations: [000 eq 5, section 3.1].

Source: Davison, Reid, Molton, Stasse, "MonoSLAM", 2007, section 3.4.
"""

import numpy as np

from vnav.core.arrays import Array
from vnav.tracking.ekf.quaternions import from_rotation_vector, left_matrix, right_matrix
from vnav.tracking.ekf.state import (
    MOTION,
    POSITION,
    ROTATION,
    SPIN,
    VELOCITY,
    FilterState,
    with_unit_quaternion,
)


def predict(
    state: FilterState, step_s: float, sigma_m_s2: float, sigma_rad_s2: float
) -> FilterState:
    """The state after a time step: ``P = F P F' + G Q G'``, Q of the accelerations."""
    moved, F, G = move(state.x[MOTION], np.zeros(6), step_s)
    Q = np.repeat([sigma_m_s2**2, sigma_rad_s2**2], 3)
    x, P = state.x.copy(), state.P.copy()
    x[MOTION] = moved
    P[MOTION] = F @ P[MOTION]
    P[:, MOTION] = P[:, MOTION] @ F.T
    P[MOTION, MOTION] += G * Q @ G.T
    return with_unit_quaternion(x, P)


def move(camera: Array, acceleration: Array, step_s: float) -> tuple[Array, Array, Array]:
    """The camera (13,) after a time step; its derivatives F (13, 13) by the camera, G (13, 6).

    ``acceleration`` (6,): in the world, m/s2, and of the rotation in the camera, rad/s2. It changes
    the velocities at the beginning of the step.
    """
    q = camera[ROTATION]
    velocity = camera[VELOCITY] + acceleration[:3] * step_s
    spin = camera[SPIN] + acceleration[3:] * step_s
    turn, by_turn = from_rotation_vector(spin * step_s)
    moved = np.concatenate(
        [camera[POSITION] + velocity * step_s, left_matrix(q) @ turn, velocity, spin]
    )
    F, G = np.eye(13), np.zeros((13, 6))
    F[POSITION, VELOCITY] = step_s * np.eye(3)
    F[ROTATION, ROTATION] = right_matrix(turn)
    F[ROTATION, SPIN] = left_matrix(q) @ by_turn * step_s
    G[:, :3] = F[:, VELOCITY] * step_s
    G[:, 3:] = F[:, SPIN] * step_s
    return moved, F, G
