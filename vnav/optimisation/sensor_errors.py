"""A depth sensor's offset, its delay and a rolling shutter: what they do to a keyframe's features.

A camera that moves by a twist sees a point move over its image: the optical flow of Longuet-Higgins
and Prazdny 1980. A row that is exposed later, or depth that is measured later, sees it elsewhere.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import RegistrationConfig
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.camera_motion import velocities
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.features.lifting import inverse_depth_planes

DepthOf = Callable[[int], NDArray[np.float32]]


@dataclass(frozen=True)
class SensorErrors:
    """What measured inverse depths of a capture have too much, 1/m, and what is seen late.

    ``depth_delay_s``: depth after colour; ``line_delay_s``: a row of colour after the row above.
    The stamp is that of the middle row. ``depth_stamp_share``: of what depth's own stamps vary
    against colour's, that is so: 1 where they are right, 0 where they tell nothing.
    """

    depth_offset: float = 0.0
    depth_delay_s: float = 0.0
    line_delay_s: float = 0.0
    depth_stamp_share: float = 0.0

    @property
    def delayed(self) -> bool:
        """Whether anything is seen later than stamped."""
        return bool(self.depth_delay_s or self.line_delay_s or self.depth_stamp_share)

    @property
    def vector(self) -> Array:
        """The four values (4,)."""
        return np.array(astuple(self))


@dataclass(frozen=True)
class Readings:
    """What F features show without the errors, as of their frame's stamp.

    ``px`` (F, 2); ``points_camera`` (F, 3), NaN without depth; ``by_error`` (F, 3, 4): how what is
    measured, pixel and inverse depth, grows with each error.
    """

    px: Array
    points_camera: Array
    by_error: Array


@dataclass(frozen=True)
class MovingCamera:
    """A camera that moves by a twist (6,) as it takes a frame: rad/s and m/s, rotation first.

    The twist is in the camera's own axes; ``capture``: the number of the one it takes;
    ``uneven_s``: how much later than its capture's median depth is stamped.
    """

    intrinsics: Intrinsics
    twist: Array
    capture: int = 0
    uneven_s: float = 0.0

    def depth_delay_s(self, errors: SensorErrors) -> float:
        """How long after colour its depth is measured."""
        return errors.depth_delay_s + errors.depth_stamp_share * self.uneven_s

    def rows(self, px: Array) -> Array:
        """Rows (F,) of pixels (F, 2) below the middle one."""
        return np.asarray(px[:, 1] - (self.intrinsics.height - 1) / 2)

    def moved(self, px: Array, inverse: Array, after_s: Array) -> tuple[Array, Array]:
        """Where points (F,) at a pixel and inverse depth are seen after a time (F,).

        To second order: the third is a fiftieth of a pixel after 30 ms at 120 degrees a second.
        """
        found = _moved(px, inverse, after_s, self.twist, self.intrinsics.pinhole)
        return found[:, :2], found[:, 2]

    def by_error(self, px: Array, inverse: Array, slopes: Array) -> Array:
        """How pixel and inverse depth (F, 3) that are measured grow with each error: (F, 3, 4).

        ``slopes`` (F, 2): of the inverse depth, which a depth image has under a pixel that lies
        elsewhere on the surface by then.
        """
        gained = _flow(px, inverse, self.twist, self.intrinsics.pinhole)
        flow, growth = gained[:, :2], gained[:, 2]
        along, rows = (slopes * flow).sum(1), self.rows(px)
        found = np.zeros((len(px), 3, 4))
        found[:, 2, 0] = 1
        found[:, 2, 1] = growth - along
        found[:, 2, 3] = self.uneven_s * found[:, 2, 1]
        found[:, :2, 2], found[:, 2, 2] = flow * rows[:, None], along * rows
        return found


@dataclass(frozen=True)
class MovingView:
    """A keyframe's features and depth image (H, W), and the camera that took it."""

    keyframe: FrameFeatures
    depth_m: NDArray[np.float32]
    camera: MovingCamera

    def readings(self, errors: SensorErrors, config: RegistrationConfig) -> Readings:
        """What its features would show, had the sensor no errors.

        A feature is looked up in the depth image where that shows it: at its own pixel, but for
        what the camera moves from the one exposure to the other.
        """
        px, camera = self.keyframe.features.keypoints_px.astype(float), self.camera
        row_s = camera.rows(px) * errors.line_delay_s
        delay_s = camera.depth_delay_s(errors)
        apart_s = delay_s - row_s
        guess = _filled(1 / self.keyframe.points_camera[:, 2].astype(float))
        depth_px, _ = camera.moved(px, guess, apart_s)
        planes = inverse_depth_planes(depth_px, self.depth_m, config)
        found = planes[:, 0] - errors.depth_offset
        there = np.where(np.isnan(found), guess, found)
        _, inverse = camera.moved(depth_px, there, -apart_s)
        px_at_stamp, _ = camera.moved(px, inverse, -row_s)
        _, at_stamp = camera.moved(depth_px, there, np.full(len(px), -delay_s))
        by_error = camera.by_error(px_at_stamp, at_stamp, np.nan_to_num(planes[:, 1:]))
        at_stamp[np.isnan(found)] = np.nan
        points = camera.intrinsics.unproject(px_at_stamp, 1 / at_stamp)
        return Readings(px_at_stamp, points, by_error)


class MovingSensor:
    """The keyframes' views, and the cameras (N,) of all frames as they move.

    ``depth_of`` reads the depth image of a row when it is asked for.
    """

    def __init__(
        self,
        keyframes: Sequence[FrameFeatures],
        cameras: Sequence[MovingCamera],
        depth_of: DepthOf,
        config: RegistrationConfig,
    ) -> None:
        self.keyframes, self.cameras = keyframes, cameras
        self._depth_of, self.config = depth_of, config

    @classmethod
    def along(
        cls,
        T_world_camera: Array,
        odometry: Odometry,
        cameras: Sequence[Intrinsics],
        depth_of: DepthOf,
        config: RegistrationConfig,
    ) -> "MovingSensor":
        """As poses (N, 4, 4) of all frames tell the motion; ``cameras``: one a capture."""
        frames = odometry.frames
        captures, twists = frames.capture.tolist(), velocities(T_world_camera, frames)
        intrinsics = [cameras[capture] for capture in captures]
        moving = map(MovingCamera, intrinsics, twists, captures, frames.uneven_s.tolist())
        return cls(odometry.keyframes, list(moving), depth_of, config)

    @property
    def uneven_captures(self) -> list[int]:
        """Those whose depth's stamps vary against colour's."""
        return sorted({camera.capture for camera in self.cameras if camera.uneven_s})

    def with_features(self, chosen: Sequence[NDArray[np.intp]]) -> "MovingSensor":
        """With some of the features of each keyframe."""
        keyframes = [k[features] for k, features in zip(self.keyframes, chosen, strict=True)]
        return MovingSensor(keyframes, self.cameras, self._depth_of, self.config)

    def view(self, k: int) -> MovingView:
        """A keyframe by its number."""
        keyframe = self.keyframes[k]
        return MovingView(keyframe, self._depth_of(keyframe.row), self.cameras[keyframe.row])

    def readings(self, errors: Sequence[SensorErrors]) -> Readings:
        """What the features of all keyframes would show, had no capture's sensor its errors."""

        def of_view(k: int) -> Readings:
            view = self.view(k)
            return view.readings(errors[view.camera.capture], self.config)

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            parts = list(pool.map(of_view, range(len(self.keyframes))))
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return Readings(*(np.concatenate(column) for column in columns))


def depth_delays(errors: Sequence[SensorErrors], frames: FrameTable) -> Array:
    """How long after colour each frame's depth is measured (N,), by its capture's errors."""
    constant, share = np.array([(e.depth_delay_s, e.depth_stamp_share) for e in errors]).T
    return np.asarray(constant[frames.capture] + share[frames.capture] * frames.uneven_s)


def _filled(inverse: Array) -> Array:
    """With the median of those known in place of NaN; 1/m, where none is."""
    known = inverse[np.isfinite(inverse)]
    return np.where(np.isfinite(inverse), inverse, np.median(known) if len(known) else 1.0)


@compiled
def _moved(px: Array, inverse: Array, after_s: Array, twist: Array, pinhole: Array) -> Array:
    """The loop of `MovingCamera.moved`: pixels and inverse depth (F, 3)."""
    fx, fy, cx, cy = pinhole
    found = np.empty((len(px), 3))
    for n in range(len(px)):
        z, after = 1 / inverse[n], after_s[n]
        x, y = (px[n, 0] - cx) / fx * z, (px[n, 1] - cy) / fy * z
        u, v, w = _turned(twist, x, y, z)
        u, v, w = u + twist[3], v + twist[4], w + twist[5]
        a, b, c = _turned(twist, u, v, w)
        x = x - after * u + after**2 / 2 * a
        y = y - after * v + after**2 / 2 * b
        z = z - after * w + after**2 / 2 * c
        seen = z if z > 0 else np.nan
        found[n] = fx * x / seen + cx, fy * y / seen + cy, 1 / z
    return found


@compiled
def _flow(px: Array, inverse: Array, twist: Array, pinhole: Array) -> Array:
    """Pixels and inverse depth (F, 3) that points gain in a second."""
    fx, fy, cx, cy = pinhole
    found = np.empty((len(px), 3))
    for n in range(len(px)):
        x, y, near = (px[n, 0] - cx) / fx, (px[n, 1] - cy) / fy, inverse[n]
        u, v, w = _turned(twist, x, y, 1.0)
        u, v, w = -u - twist[3] * near, -v - twist[4] * near, -w - twist[5] * near
        found[n] = fx * (u - x * w), fy * (v - y * w), -near * w
    return found


@compiled
def _turned(twist: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The spin of a twist across a point."""
    a, b, c = twist[0], twist[1], twist[2]
    return b * z - c * y, c * x - a * z, a * y - b * x
