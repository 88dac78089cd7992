"""What the filter estimates: the camera's pose and velocities, and features by inverse depth.

Source: [000 section 3.1]; Civera, Davison, Montiel, "Inverse depth parametrization for monocular
SLAM", 2008.
"""

from dataclasses import dataclass

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.tracking.ekf.quaternions import CONJUGATE, left_matrix, normalised

POSITION, ROTATION = slice(0, 3), slice(3, 7)
VELOCITY, SPIN = slice(7, 10), slice(10, 13)
POSE, MOTION, BEFORE = slice(0, 7), slice(0, 13), slice(13, 20)
CAMERA, FEATURE = 20, 6  # entries of the camera, and of each feature


@dataclass(frozen=True)
class FilterState:
    """Mean ``x`` (20 + 6 N,) and covariance ``P`` of a camera and N features.

    The camera: position and quaternion x, y, z, w, camera to world; velocity in the world, m/s, and
    angular velocity in the camera, rad/s; position and quaternion before. A feature: the position
    that it was first seen from, azimuth and elevation of its ray in the world, and the inverse of
    its distance along it, 1/m.
    """

    x: Array
    P: Array

    @property
    def features(self) -> Array:
        """Features (N, 6)."""
        return self.x[CAMERA:].reshape(-1, FEATURE)

    @property
    def T_world_camera(self) -> Array:
        """Pose (4, 4) of the camera."""
        return _pose(self.x[POSE])

    @property
    def T_before_camera(self) -> Array:
        """Pose (4, 4) of the camera in that before."""
        return np.asarray(se3.inverse(_pose(self.x[BEFORE])) @ self.T_world_camera)

    @property
    def step_covariance(self) -> Array:
        """Of the tangent (6, 6) at ``T_before_camera``, rotation first."""
        to_before = se3.adjoint(se3.inverse(self.T_before_camera)) @ _tangent(self.x[BEFORE])
        J = np.hstack([_tangent(self.x[POSE]), -to_before])
        entries = np.r_[POSE, BEFORE]
        return np.asarray(J @ self.P[np.ix_(entries, entries)] @ J.T)

    def remembered(self) -> "FilterState":
        """The state whose pose before is that of now."""
        J = np.eye(len(self.x))
        J[BEFORE] = J[POSE]
        return FilterState(J @ self.x, J @ self.P @ J.T)

    def keep(self, kept: Rows) -> "FilterState":
        """The state with the features of these rows only."""
        entries = np.append(np.arange(CAMERA), entries_of(kept))
        return FilterState(self.x[entries], self.P[np.ix_(entries, entries)])


def _pose(pose: Array) -> Array:
    """The transform (4, 4) of a position and a quaternion (7,)."""
    return se3.make(se3.rotation_from_quat(pose[3:]), pose[:3])


def _tangent(pose: Array) -> Array:
    """Derivative (6, 7) of the tangent on the right of a pose, by position and quaternion."""
    J = np.zeros((6, 7))
    J[:3, 3:] = 2 * left_matrix(pose[3:] * CONJUGATE)[:3]
    J[3:, :3] = se3.rotation_from_quat(pose[3:]).T
    return J


def entries_of(features: Rows) -> Rows:
    """Entries (6 N,) of the state that belong to features (N,)."""
    return (CAMERA + FEATURE * features[:, None] + np.arange(FEATURE)).reshape(-1)


def at_rest(velocity_sigma_m_s: float, spin_sigma_rad_s: float) -> FilterState:
    """A camera at the origin of its world that may move, and no features."""
    x = np.zeros(CAMERA)
    x[ROTATION] = x[BEFORE][3:] = 0, 0, 0, 1
    sigmas = np.zeros(CAMERA)
    sigmas[VELOCITY], sigmas[SPIN] = velocity_sigma_m_s, spin_sigma_rad_s
    return FilterState(x, np.diag(sigmas**2))


def with_unit_quaternion(x: Array, P: Array) -> FilterState:
    """The state whose quaternion has length 1 again; P follows by the Jacobian, made symmetric."""
    q, by_q = normalised(x[ROTATION])
    x, P = x.copy(), P.copy()
    x[ROTATION] = q
    P[ROTATION] = by_q @ P[ROTATION]
    P[:, ROTATION] = P[:, ROTATION] @ by_q.T
    return FilterState(x, (P + P.T) / 2)
