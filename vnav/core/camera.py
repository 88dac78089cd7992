"""The pinhole model: pixel centres at integer coordinates, x right, y down, z forward."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from vnav.core.arrays import Array

LEAST, MOST = 1e-3, 1e9  # of a focal length in pixels, of units a metre: nothing lies beyond
MOST_SIDE_PX = 65_535  # no image is wider or higher


@dataclass(frozen=True)
class Intrinsics:
    """Focal lengths and principal point in pixels; distortion is OpenCV's k1, k2, p1, p2, k3."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    @property
    def K(self) -> Array:
        """Calibration matrix (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    @property
    def pinhole(self) -> Array:
        """fx, fy, cx, cy (4,)."""
        return np.array([self.fx, self.fy, self.cx, self.cy], float)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height

    @property
    def is_possible(self) -> bool:
        """Whether a camera can have such sizes and lengths."""
        sizes = 0 < min(self.size) <= max(self.size) <= MOST_SIDE_PX
        focals = all(LEAST <= length < MOST for length in (self.fx, self.fy))
        return sizes and focals and all(abs(place) < MOST for place in (self.cx, self.cy))

    def project(self, points_camera: ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 3) in camera coordinates, distortion not applied.

        Points at or behind the camera plane give NaN.
        """
        p = np.asarray(points_camera, float)
        z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
        return np.stack([self.fx * p[..., 0] / z + self.cx, self.fy * p[..., 1] / z + self.cy], -1)

    def unproject(self, pixels: ArrayLike, depth_m: ArrayLike) -> Array:
        """Points (..., 3) in camera coordinates from undistorted pixels (..., 2) and z (...)."""
        px, z = np.asarray(pixels, float), np.asarray(depth_m, float)
        x = (px[..., 0] - self.cx) / self.fx * z
        y = (px[..., 1] - self.cy) / self.fy * z
        return np.stack([x, y, z], -1)

    def scaled(self, width: int, height: int) -> "Intrinsics":
        """The same camera's images resized to another size."""
        sx, sy = width / self.width, height / self.height
        return Intrinsics(
            width,
            height,
            self.fx * sx,
            self.fy * sy,
            (self.cx + 0.5) * sx - 0.5,
            (self.cy + 0.5) * sy - 0.5,
            self.distortion,
        )


@dataclass(frozen=True)
class Camera:
    """A colour camera and the depth sensor beside it.

    ``depth`` and ``T_color_depth`` (4x4 nested tuples, depth camera coordinates to colour camera
    coordinates) are None where each depth pixel lies on a colour pixel.
    """

    color: Intrinsics
    units_per_metre: float
    depth: Intrinsics | None = None
    T_color_depth: tuple[tuple[float, ...], ...] | None = None

    @property
    def is_registered(self) -> bool:
        """Whether depth has the axis and the view of colour, in as many pixels or others."""
        if self.depth is None:
            return True
        return self == registered_camera(self.color, self.units_per_metre, self.depth.size)


AT_COLOR = tuple(map(tuple, np.eye(4).tolist()))  # T_color_depth of depth that is registered


def registered_camera(
    color: Intrinsics, units_per_metre: float, depth_size: tuple[int, int]
) -> Camera:
    """The camera of depth with colour's axis and view, in images of this size (width, height)."""
    if depth_size == color.size:
        return Camera(color, units_per_metre)
    return Camera(color, units_per_metre, color.scaled(*depth_size), AT_COLOR)


@dataclass(frozen=True)
class CameraPrior:
    """What is known of a camera: its intrinsics, and how well.

    Standard deviations, 0: exact. ``focal_sigma``: relative, of the focal length, inf: not known at
    all. ``centre_sigma``: of the principal point, over the longer side of the image, inf: it may be
    anywhere, as in a cropped image. ``distortion_sigma``: of the first radial coefficient.
    """

    intrinsics: Intrinsics
    focal_sigma: float = 0.0
    centre_sigma: float = 0.0
    distortion_sigma: float = 0.0

    @property
    def is_exact(self) -> bool:
        """Whether nothing of the camera is left open."""
        return not (self.focal_sigma or self.centre_sigma or self.distortion_sigma)

    def scaled(self, width: int, height: int) -> "CameraPrior":
        """What is known of it where its images are resized to another size."""
        return replace(self, intrinsics=self.intrinsics.scaled(width, height))


@dataclass(frozen=True)
class PhotoCamera:
    """What is known of a photo's camera, and where that comes from."""

    prior: CameraPrior
    source: str

    @property
    def intrinsics(self) -> Intrinsics:
        """Those to start from."""
        return self.prior.intrinsics
