"""Where the camera sees features: [000 eq 6, eq 9, section 3.1]."""

from dataclasses import dataclass

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.core.camera import Intrinsics
from vnav.tracking.ekf.quaternions import derivative_of_turned_back
from vnav.tracking.ekf.state import CAMERA, FEATURE, POSE, POSITION, ROTATION, FilterState

MIN_Z = 0.05  # of a ray that is nearly 1 long: what lies more to the side is not seen


def pixels(x: Array, features: Rows, camera: Intrinsics) -> Array:
    """h: the pixels (N, 2) of some features at a state (20 + 6 M,), NaN behind the camera."""
    p, _ = _rays(x, features)
    return _projected(p, camera)


def directions(azimuth: Array, elevation: Array) -> Array:
    """m: the unit rays (N, 3) of angles (N,) in radians."""
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), -np.sin(elevation), flat * np.cos(azimuth)], -1)


def points(features: Array) -> Array:
    """Points (N, 3) in the world of features (N, 6) at a finite distance."""
    rays = directions(features[:, 3], features[:, 4])
    return np.asarray(features[:, :3] + rays / features[:, 5:])


@dataclass(frozen=True)
class Measurement:
    """The pixels h (N, 2) of some ``features`` (N,) and their derivatives.

    By position and quaternion of the camera (N, 2, 7), and by each feature (N, 2, 6): the blocks of
    H that are not 0. A row of H stands for one coordinate of one pixel, x before y.
    """

    features: Rows
    pixels: Array
    by_pose: Array
    by_feature: Array

    def __getitem__(self, rows: Rows) -> "Measurement":
        """Of some of the features."""
        return Measurement(
            self.features[rows], self.pixels[rows], self.by_pose[rows], self.by_feature[rows]
        )

    def times(self, P: Array) -> Array:
        """H P (2 N, M) of a matrix with a row for each entry of the state."""
        features = (len(P) - CAMERA) // FEATURE
        blocks = P[CAMERA:].reshape(features, FEATURE, P.shape[1])[self.features]
        product = self.by_pose @ P[POSE] + self.by_feature @ blocks
        return np.asarray(product.reshape(2 * len(self.features), P.shape[1]))


def measure(state: FilterState, features: Rows, camera: Intrinsics) -> Measurement:
    """Pixels h and Jacobian H of some features (N,) at a state."""
    x = state.x
    p, v = _rays(x, features)
    y = state.features[features]
    R_camera_world = se3.rotation_from_quat(x[ROTATION]).T
    by_ray = _derivative_of_projected(p, camera)
    by_point = by_ray @ R_camera_world  # (N, 2, 3)
    by_anchor = by_point * y[:, 5, None, None]
    by_quaternion = by_ray @ derivative_of_turned_back(x[ROTATION], v)
    by_angles = by_point @ _derivative_of_directions(y[:, 3], y[:, 4])
    by_inverse = by_point @ (y[:, :3] - x[POSITION])[:, :, None]
    return Measurement(
        features,
        _projected(p, camera),
        np.concatenate([-by_anchor, by_quaternion], 2),
        np.concatenate([by_anchor, by_angles, by_inverse], 2),
    )


def _rays(x: Array, features: Rows) -> tuple[Array, Array]:
    """Points (N, 3) times their inverse depth, in the camera and along the world's axes."""
    y = x[CAMERA:].reshape(-1, FEATURE)[features]
    v = y[:, 5:] * (y[:, :3] - x[POSITION]) + directions(y[:, 3], y[:, 4])
    return v @ se3.rotation_from_quat(x[ROTATION]), v


def _projected(p: Array, camera: Intrinsics) -> Array:
    return camera.project(np.where(p[:, 2:] > MIN_Z, p, np.nan))


def _derivative_of_projected(p: Array, camera: Intrinsics) -> Array:
    """(N, 2, 3)."""
    z = np.where(p[:, 2] > MIN_Z, p[:, 2], np.nan)
    J = np.zeros((len(p), 2, 3))
    J[:, 0, 0], J[:, 1, 1] = camera.fx / z, camera.fy / z
    J[:, 0, 2], J[:, 1, 2] = -camera.fx * p[:, 0] / z**2, -camera.fy * p[:, 1] / z**2
    return J


def _derivative_of_directions(azimuth: Array, elevation: Array) -> Array:
    """(N, 3, 2)."""
    sin_a, cos_a = np.sin(azimuth), np.cos(azimuth)
    sin_e, cos_e = np.sin(elevation), np.cos(elevation)
    by_azimuth = np.stack([cos_e * cos_a, np.zeros_like(sin_a), -cos_e * sin_a], -1)
    by_elevation = np.stack([-sin_e * sin_a, -cos_e, -sin_e * cos_a], -1)
    return np.stack([by_azimuth, by_elevation], -1)
