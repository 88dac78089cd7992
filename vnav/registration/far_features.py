"""Features without depth: they tell how the camera turned, and by parallax how far away they are.

Depth ends some metres away, outdoors or in a hall before most of what is seen. A feature without it
is a point of unknown inverse depth, 0 where it is infinitely far; a second view tells it the better
the wider the baseline is. Source: Civera, Davison, Montiel 2008, "Inverse depth parametrization for
monocular SLAM".
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.core.camera import Intrinsics
from vnav.core.frame import PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import FEW

RADIUS_PX = 20.0  # around where a feature is expected whose parallax is not known yet
UNKNOWN = np.array([0.1, 10.0])  # inverse depth and standard deviation in 1/m: nothing is known
KNOWN = 0.05  # 1/m: standard deviation, below which parallax has told an inverse depth
FARTHEST = 0.01  # 1/m: what is farther away is taken to be there
MIN_AHEAD = 0.05  # depth in the other camera over the own one: what is less is not before both
BOTH = np.sqrt(2)  # both keypoints are as noisy


def count_without_depth(a: FrameFeatures, b: FrameFeatures) -> bool:
    """Whether features without depth are matched: where those with it are few in either frame."""
    return any(len(k.features) > 0 and k.has_depth.mean() < FEW for k in (a, b))


def inverse_depths(frame: FrameFeatures, rows: Rows | NDArray[np.int32]) -> Array:
    """Inverse depth in 1/m of some features without depth, and its standard deviation (M, 2)."""
    if frame.triangulated is None:
        return np.tile(UNKNOWN, (len(rows), 1))
    return frame.triangulated[rows]


def points(frame: FrameFeatures, rows: Rows | NDArray[np.int32], camera: Intrinsics) -> Array:
    """Where (M, 3) features without depth are in their camera, by their inverse depth."""
    w = np.maximum(inverse_depths(frame, rows)[:, 0], FARTHEST)
    return camera.unproject(frame.features.keypoints_px[rows], 1 / w)


def triangulated(
    a: FrameFeatures,
    b: FrameFeatures,
    estimate: PoseEstimate,
    cameras: tuple[Intrinsics, Intrinsics],
    pixel_sigma_px: float,
) -> tuple[FrameFeatures, FrameFeatures]:
    """Both frames with what the motion between them tells of the features without depth.

    In either frame a feature keeps the estimate with the least standard deviation: that of the
    widest baseline, which a new frame takes over from an earlier one.
    """
    of_a, of_b = estimate.far.T
    rays_a, rays_b = (
        camera.unproject(k.features.keypoints_px[rows], np.ones(len(rows)))
        for camera, k, rows in zip(cameras, (a, b), (of_a, of_b), strict=True)
    )
    T_b_a = se3.inverse(estimate.T_a_b)
    sigma = BOTH * pixel_sigma_px / cameras[1].fx
    far_a = _better(inverse_depths(a, of_a), _met(rays_a, rays_b, T_b_a, sigma))
    far_b = _better(inverse_depths(b, of_b), _carried(rays_a, far_a, T_b_a))
    far_a = _better(far_a, _carried(rays_b, far_b, estimate.T_a_b))
    return _with(a, of_a, far_a), _with(b, of_b, far_b)


def _met(rays_a: Array, rays_b: Array, T_b_a: Array, sigma: float) -> Array:
    """Inverse depths in a and their standard deviations (M, 2) where rays (M, 3) meet.

    Rays have z = 1; ``sigma``: of their x and y.
    """
    turned, t = rays_a @ T_b_a[:3, :3].T, T_b_a[:3, 3]
    along = rays_b[:, :2] * t[2] - t[:2]
    off = turned[:, :2] - rays_b[:, :2] * turned[:, 2:]
    baseline = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    w = (along * off).sum(1) / baseline**2
    z = turned[:, 2] + w * t[2]
    return np.stack([w, np.where(z > MIN_AHEAD, sigma * z / baseline, np.inf)], 1)


def _carried(rays: Array, far: Array, T: Array) -> Array:
    """Inverse depths and standard deviations (M, 2) of rays (M, 3) as another camera has them."""
    w, sigma = far.T
    turned = rays @ T[2, :3]
    z = turned + w * T[2, 3]
    is_ahead = z > MIN_AHEAD
    z = np.where(is_ahead, z, 1.0)
    return np.stack([w / z, np.where(is_ahead, sigma * np.abs(turned) / z**2, np.inf)], 1)


def _better(known: Array, found: Array) -> Array:
    """Of two estimates each (M, 2) that of the smaller standard deviation."""
    return np.where(found[:, 1:] < known[:, 1:], found, known)


def _with(frame: FrameFeatures, rows: NDArray[np.int32], far: Array) -> FrameFeatures:
    known = inverse_depths(frame, np.arange(len(frame.features)))
    known[rows] = far
    return replace(frame, triangulated=known)
