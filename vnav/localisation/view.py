"""A camera that looks at the map."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics

MIN_DEPTH_M = 1e-3


@dataclass(frozen=True)
class View:
    """Where a camera stands and how it sees: ``T_camera_world`` (4, 4) and its intrinsics."""

    T_camera_world: Array
    intrinsics: Intrinsics

    @property
    def T_world_camera(self) -> Array:
        """The pose (4, 4), camera to world."""
        return se3.inverse(self.T_camera_world)

    @property
    def centre_world(self) -> Array:
        """The camera's centre (3,)."""
        return self.T_world_camera[:3, 3]

    def project(self, points_world: NDArray[np.float32]) -> tuple[Array, Array]:
        """Pixels (N, 2) and depths (N,) in metres; pixels mean nothing where depth is not > 0."""
        p = se3.transform(self.T_camera_world, points_world)
        z = np.maximum(p[:, 2], MIN_DEPTH_M)
        k = self.intrinsics
        return np.stack([k.fx * p[:, 0] / z + k.cx, k.fy * p[:, 1] / z + k.cy], 1), p[:, 2]

    def squared_errors(self, points_world: NDArray[np.float32], px: NDArray[np.float32]) -> Array:
        """Squared reprojection errors (N,) in pixels, inf behind the camera."""
        projected, depth = self.project(points_world)
        return np.where(depth > MIN_DEPTH_M, ((projected - px) ** 2).sum(1), np.inf)

    def moved(self, step: Array) -> "View":
        """The view after ``T_world_camera @ exp(step[:6])``; more parameters change its camera.

        The seventh is of the log focal length, the eighth and ninth of the principal point, over
        the longer side of the image.
        """
        T = se3.exp(-step[:6]) @ self.T_camera_world
        if len(step) == 6:
            return View(T, self.intrinsics)
        k, scale = self.intrinsics, float(np.exp(step[6]))
        right, down = max(k.size) * step[7:] if len(step) == 9 else (0.0, 0.0)
        fx, fy, cx, cy = k.fx * scale, k.fy * scale, k.cx + right, k.cy + down
        return View(T, dataclasses.replace(k, fx=fx, fy=fy, cx=cx, cy=cy))
