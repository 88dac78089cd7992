"""What a moving sensor's errors make of edges between frames, and edges freed of that.

Points that are seen late lie elsewhere in the camera. A rigid motion fits part of that, and
registration takes it for the camera's own. How much depends on what both frames see of the scene,
so points of a keyframe are registered once more, as such a sensor shows them from known poses.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.features.lifting import inverse_depth_planes
from vnav.optimisation.linearisation import NEAREST_M
from vnav.optimisation.sensor_errors import MovingCamera, MovingSensor, MovingView, SensorErrors
from vnav.registration.refinement import CONVERGED, gauss_newton

MOST_PATCHES = 200  # of a keyframe
UNSURE = 0.5  # of a displacement's length, which edges keep: frames match other points
ROUNDS = 2  # to find the row, and so the time, at which a point is seen


@dataclass(frozen=True)
class Patches:
    """Surface around F points (F, 3) of a camera: a plane of the points X where ``plane @ X`` is 1.

    The inverse depth of a plane (F, 3) is linear in the pixel.
    """

    points: Array
    planes: Array

    @classmethod
    def of(cls, view: MovingView, config: RegistrationConfig) -> "Patches":
        """Those around some of a keyframe's features with depth."""
        camera, rows = view.camera.intrinsics, np.flatnonzero(view.keyframe.has_depth)
        few = rows[:: 1 + len(rows) // MOST_PATCHES]
        px = view.keyframe.features.keypoints_px[few].astype(float)
        found = inverse_depth_planes(px, view.depth_m, config)
        known = np.isfinite(found[:, 0])
        inverse, x, y = (found[known] * (1, camera.fx, camera.fy)).T
        rays = camera.unproject(px[known], np.ones(len(inverse)))
        planes = np.stack([x, y, inverse - x * rays[:, 0] - y * rays[:, 1]], 1)
        return cls(rays / inverse[:, None], planes)

    def seen_from(self, T_a_b: Array) -> "Patches":
        """The same in camera b, if they are in camera a."""
        away = 1 - self.planes @ T_a_b[:3, 3]
        points = se3.transform(se3.inverse(T_a_b), self.points)
        return Patches(points, self.planes @ T_a_b[:3, :3] / away[:, None])

    def measured(self, camera: MovingCamera, errors: SensorErrors) -> Array:
        """Pixel and inverse depth (F, 3) that the camera measures of them; NaN where it does not.

        Of each point a pixel, and the depth of its plane there.
        """
        front = self.points[:, 2] > NEAREST_M
        points = np.where(front[:, None], self.points, np.nan)
        at_stamp, inverse = camera.intrinsics.project(points), 1 / points[:, 2]
        px = at_stamp
        for _ in range(ROUNDS):
            px, _ = camera.moved(at_stamp, inverse, camera.rows(px) * errors.line_delay_s)
        late = self.seen_from(se3.exp(camera.depth_delay_s(errors) * camera.twist))
        depth = (late.planes * camera.intrinsics.unproject(px, np.ones(len(px)))).sum(1)
        last_px = np.array(camera.intrinsics.size) - 1
        seen = ((px >= 0) & (px <= last_px)).all(1) & (depth > 0)
        found = np.column_stack([px, depth + errors.depth_offset])
        return np.where(seen[:, None], found, np.nan)


def without_displacement(
    edges: Sequence[Edge],
    T_world_camera: Array,
    sensor: MovingSensor,
    errors: Sequence[SensorErrors],
) -> list[Edge]:
    """The edges between frames as sensors without these errors, one a capture, would measure them.

    ``T_world_camera`` (N, 4, 4) of all frames. What both frames see of the keyframe before tells;
    where that is too little, an edge stays as it is, and all do where there are no delays.
    """
    if not any(e.delayed for e in errors):
        return list(edges)
    rows = [keyframe.row for keyframe in sensor.keyframes]
    before = (np.searchsorted(rows, [e.i for e in edges], side="right") - 1).clip(0)
    freed = list(edges)

    def free(k: int) -> None:
        seen = _SeenKeyframe(sensor, errors, k, T_world_camera)
        for n in np.flatnonzero(before == k).tolist():
            freed[n] = seen.freed(edges[n])

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(free, np.unique(before).tolist()))
    return freed


class _SeenKeyframe:
    """What frames show of one keyframe, by sensors with errors, from poses (N, 4, 4)."""

    def __init__(
        self,
        sensor: MovingSensor,
        errors: Sequence[SensorErrors],
        keyframe: int,
        T_world_camera: Array,
    ) -> None:
        self._sensor, self._errors, self._T_world_camera = sensor, errors, T_world_camera
        self._T_keyframe_world = se3.inverse(T_world_camera[sensor.keyframes[keyframe].row])
        self._patches = Patches.of(sensor.view(keyframe), sensor.config)
        self._measured: dict[int, Array] = {}

    def freed(self, edge: Edge) -> Edge:
        """An edge without what the errors displace, and so much less sure."""
        T_i_j = se3.inverse(self._T_world_camera[edge.i]) @ self._T_world_camera[edge.j]
        cameras = [self._sensor.cameras[row].intrinsics for row in (edge.i, edge.j)]
        measured = self._of(edge.i), self._of(edge.j)
        found = _registered(T_i_j, measured, cameras, self._sensor.config)
        if found is None:
            return edge
        undo = se3.inverse(found) @ T_i_j
        unsure = UNSURE * np.sqrt((se3.deviation(undo).reshape(2, 3) ** 2).mean(1))  # along an axis
        return replace(edge, T_i_j=edge.T_i_j @ undo).with_added_noise(*unsure)

    def _of(self, row: int) -> Array:
        """What a frame measures (F, 3), computed once."""
        if row not in self._measured:
            T_keyframe_camera = self._T_keyframe_world @ self._T_world_camera[row]
            seen = self._patches.seen_from(T_keyframe_camera)
            camera = self._sensor.cameras[row]
            self._measured[row] = seen.measured(camera, self._errors[camera.capture])
        return self._measured[row]


def _registered(
    T_a_b: Array,
    measured: tuple[Array, Array],
    cameras: Sequence[Intrinsics],
    config: RegistrationConfig,
) -> Array | None:
    """The motion near ``T_a_b`` that fits what a and b measure (F, 3) best; None by too few."""
    known = np.isfinite(measured).all((0, 2))
    a, b = (found[known] for found in measured)
    if len(a) < config.min_inliers:
        return None
    source = cameras[0].unproject(a[:, :2], 1 / a[:, 2])
    pinholes = np.stack([camera.pinhole for camera in cameras])
    pixel, depth = config.pixel_sigma_px**2, config.depth_sigma_per_m2**2
    noise = np.array([pixel, pixel, depth]), np.full(len(a), depth)
    found, _, _ = gauss_newton(T_a_b, source, b, np.ones(len(a), bool), pinholes, *noise, CONVERGED)
    return np.asarray(found)
