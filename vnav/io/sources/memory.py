"""Frames that are arrays in memory."""

import dataclasses
import hashlib
import json
from collections.abc import Sequence, Sized
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Camera, Intrinsics
from vnav.core.frame import Frame, no_depth
from vnav.core.trajectory import Trajectory
from vnav.errors import CameraError, CaptureError, TrajectoryError
from vnav.io.sources.rectify import StoredDepth, rectified, rectifier

Images = Sequence[NDArray[Any]] | NDArray[Any]

_ROUNDED = 1e-3  # how far a rotation may be from orthonormal


@dataclass(frozen=True)
class ArrayCapture:
    """What `frames` makes; ``cameras``: one a frame, as ``depth_stamps_s`` (N,)."""

    name: str
    stamps_s: Array
    color: Images
    depth: Images | None
    cameras: tuple[Camera, ...]
    depth_stamps_s: Array
    poses: Trajectory | None = None

    @property
    def camera(self) -> Camera:
        """The first frame's."""
        return self.cameras[0]

    @property
    def has_depth(self) -> bool:
        """Whether there are depth images."""
        return self.depth is not None

    def __len__(self) -> int:
        return len(self.cameras)

    def read(self, index: int) -> Frame:
        """One frame, undistorted and registered."""
        camera = self.cameras[index]
        lens = rectifier(camera)
        color = lens.color(np.ascontiguousarray(self.color[index]))
        depth_m = no_depth(*color.shape[:2])
        if self.depth is not None:
            depth_m = lens.depth_m(_stored(self.depth[index]))
        stamp_s, depth_stamp_s = float(self.stamps_s[index]), float(self.depth_stamps_s[index])
        shown = color, depth_m, rectified(camera)
        return Frame(0, index, stamp_s, *shown, depth_after_s=depth_stamp_s - stamp_s)

    def fingerprint(self) -> str:
        """A hash of the times, the images and the cameras."""
        with ThreadPoolExecutor() as pool:
            images = list(pool.map(self._digest, range(len(self))))
        cameras = [asdict(camera) for camera in self.cameras]
        stamps_s = [self.stamps_s.tolist(), self.depth_stamps_s.tolist()]
        text = json.dumps([stamps_s, cameras, images], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def _digest(self, index: int) -> str:
        digest = hashlib.sha256(np.asarray(self.color[index]).tobytes())
        if self.depth is not None:
            digest.update(_stored(self.depth[index]).tobytes())
        return digest.hexdigest()


def frames(
    color: Images,
    depth: Images | None,
    camera: Camera | Sequence[Camera],
    stamps_s: ArrayLike | None = None,
    *,
    depth_stamps_s: ArrayLike | None = None,
    name: str = "frames",
    poses: ArrayLike | None = None,
) -> ArrayCapture:
    """N frames of one recording from arrays, which are not copied: do not change them.

    Parameters
    ----------
    color
        (N, H, W, 3) uint8, RGB, or N images (H, W, 3).
    depth
        (N, H, W), or N images (H, W); 0 where there is none. float32: metres; uint16: as stored,
        ``units_per_metre`` of the camera. None: the recording has no depth.
    camera
        That of all frames, or one a frame; the map is made for the first.
    stamps_s
        (N,) ascending; 1/30 s apart where not given.
    depth_stamps_s
        (N,) ascending, where depth has times of its own; those of colour where not given.
    poses
        (N, 4, 4) camera to world where they are known, NaN where not.

    CaptureError, CameraError or TrajectoryError where these do not fit together.
    """
    count = _count_of(color)
    cameras = _cameras(camera, count)
    times_s = _times_s(stamps_s, count)
    for k in range(count):
        _require_color(k, np.asarray(color[k]), cameras[k])
    if depth is not None:
        cameras = _with_depth(cameras, depth)
    depth_s = times_s if depth_stamps_s is None else _times_s(depth_stamps_s, count)
    known = _trajectory(times_s, poses)
    return ArrayCapture(name, times_s, color, depth, cameras, depth_s, known)


def _stored(depth: NDArray[Any]) -> StoredDepth:
    """A depth image as the rectifier takes it: float64 becomes float32."""
    if depth.dtype == np.uint16:
        return np.ascontiguousarray(depth, np.uint16)
    return np.ascontiguousarray(depth, np.float32)


def _count_of(color: Images) -> int:
    if not isinstance(color, Sized):
        raise CaptureError(
            f"expected an array (N, H, W, 3) or a list of images, found a {type(color).__name__};"
            " list() makes one of what is read one by one"
        )
    if not len(color):
        raise CaptureError("expected colour images, found none")
    return len(color)


def _cameras(camera: Camera | Sequence[Camera], count: int) -> tuple[Camera, ...]:
    cameras = tuple(camera) if isinstance(camera, Sequence) else (camera,) * count
    for one in cameras:
        if not isinstance(one, Camera):
            raise CameraError(f"expected a Camera, or one a frame, found a {type(one).__name__}")
    if len(cameras) != count:
        raise CameraError(f"expected one camera or {count}, one a frame, found {len(cameras)}")
    return cameras


def _times_s(stamps_s: ArrayLike | None, count: int) -> Array:
    if stamps_s is None:
        return np.arange(count) / CaptureConfig().frame_rate_hz
    times_s = np.array(stamps_s, np.float64)
    if times_s.shape != (count,):
        raise CaptureError(f"expected {count} times, one a frame, found shape {times_s.shape}")
    wrong = np.flatnonzero(~np.isfinite(times_s) | (np.diff(times_s, prepend=-np.inf) <= 0))
    if len(wrong):
        raise CaptureError(
            f"expected times in seconds that increase, found {times_s[wrong[0]]} at frame"
            f" {wrong[0]}; sort the frames by time and leave out what occurs twice"
        )
    return times_s


def _require_color(k: int, image: NDArray[Any], camera: Camera) -> None:
    width, height = camera.color.size
    if image.dtype != np.uint8 or image.shape != (height, width, 3):
        raise CaptureError(
            f"expected colour as uint8 of shape ({height}, {width}, 3), the size that its camera"
            f" says, found {image.dtype} of shape {image.shape} at frame {k}"
        )


def _with_depth(cameras: tuple[Camera, ...], depth: Images) -> tuple[Camera, ...]:
    """The cameras, in metres where depth is; CaptureError where depth does not fit them."""
    if len(depth) != len(cameras):
        raise CaptureError(f"expected {len(cameras)} depth images, one a frame, found {len(depth)}")
    stored = np.asarray(depth[0]).dtype == np.uint16
    for k, camera in enumerate(cameras):
        _require_depth(k, np.asarray(depth[k]), camera.depth or camera.color, stored)
    if stored:
        return cameras
    return tuple(dataclasses.replace(camera, units_per_metre=1.0) for camera in cameras)


def _require_depth(k: int, image: NDArray[Any], sensor: Intrinsics, stored: bool) -> None:
    width, height = sensor.size
    kind = "uint16" if stored else "float32"
    fits = image.dtype == np.uint16 if stored else np.issubdtype(image.dtype, np.floating)
    if not fits or image.shape != (height, width):
        raise CaptureError(
            f"expected depth as {kind} of shape ({height}, {width}), the size that its camera says,"
            f" found {image.dtype} of shape {image.shape} at frame {k}; float32 is in metres,"
            " uint16 in units of the camera, all frames the same"
        )
    if not ((image >= 0) & (image < np.inf)).all():
        raise CaptureError(
            f"expected depth in metres, 0 where there is none, found NaN, infinity or less than 0"
            f" at frame {k}; np.nan_to_num(depth, posinf=0) makes NaN and infinity 0"
        )


def _trajectory(stamps_s: Array, poses: ArrayLike | None) -> Trajectory | None:
    if poses is None:
        return None
    T_world_camera = np.array(poses, np.float64)
    if T_world_camera.shape != (len(stamps_s), 4, 4):
        raise TrajectoryError(
            f"expected poses of shape ({len(stamps_s)}, 4, 4), one a frame, found"
            f" {T_world_camera.shape}; NaN where a pose is not known"
        )
    known = np.isfinite(T_world_camera).all((1, 2))
    for k in np.flatnonzero(known):
        if not se3.is_rigid(T_world_camera[k], _ROUNDED):
            raise TrajectoryError(
                f"expected a rotation and a translation as pose of frame {k}, camera to world,"
                f" found {T_world_camera[k].tolist()}"
            )
    return Trajectory(stamps_s[known], T_world_camera[known])
