"""The camera of a capture, from sensor_msgs/CameraInfo and the frames of the robot."""

import numpy as np

from vnav.core.camera import Camera, Intrinsics
from vnav.errors import CameraError
from vnav.io.recordings.ros_messages import RosCameraInfo

_BROWN = ("plumb_bob", "rational_polynomial", "")  # k1, k2, p1, p2, k3, then what divides


def intrinsics_of(info: RosCameraInfo, topic: str, *, is_rectified: bool) -> Intrinsics:
    """The pinhole camera that a CameraInfo describes: of images as taken, or of rectified ones.

    CameraError where it is of a part of the pixels, not calibrated, or its distortion is not that
    of five coefficients.
    """
    if info.is_part:
        raise CameraError(
            f"expected a camera of all pixels in {topic}, found binning or a region of interest;"
            " record whole images, or write a camera.toml"
        )
    rows = info.P if is_rectified and any(info.P) else info.K
    step = len(rows) // 3
    distortion = () if is_rectified else _distortion(info, topic)
    fx, cx, fy, cy = rows[0], rows[2], rows[step + 1], rows[step + 2]
    camera = Intrinsics(info.width, info.height, fx, fy, cx, cy, distortion)
    if not camera.is_possible:
        raise CameraError(
            f"expected a calibrated camera in {topic}, found {info.width} x {info.height} pixels,"
            f" fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g}; calibrate it, or name another topic with"
            " --camera-info"
        )
    return camera


def camera_of(
    color: Intrinsics, depth: Intrinsics | None, T_color_depth: np.ndarray, units_per_metre: float
) -> Camera:
    """The colour camera and its depth sensor; without one where depth lies on the colour pixels."""
    if depth in (None, color) and np.allclose(T_color_depth, np.eye(4), rtol=0, atol=1e-9):
        return Camera(color, units_per_metre)
    rows = tuple(tuple(map(float, row)) for row in T_color_depth)
    return Camera(color, units_per_metre, depth or color, rows)


def _distortion(info: RosCameraInfo, topic: str) -> tuple[float, ...]:
    if not any(info.D):
        return ()
    known = info.distortion_model in _BROWN and len(info.D) in (4, 5, 8)
    if not known or any(info.D[5:]) or not np.isfinite(info.D).all():
        raise CameraError(
            f"expected distortion by k1, k2, p1, p2, k3 (plumb_bob) in {topic}, found"
            f" {info.distortion_model or 'no model'} with {len(info.D)} coefficients; rectify the"
            " images (image_proc) and name theirs with --color, --depth and --camera-info"
        )
    return info.D[:5]
