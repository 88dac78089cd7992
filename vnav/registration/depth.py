"""Two depth images to the motion between them, for frames whose colours show too little.

Points of one are held against the surface that the other has measured where they fall: direct
alignment of inverse depth, in which planes are exact and the noise of a structured-light sensor is
even. Source: the geometric part of Kerl, Sturm, Cremers 2013, "Dense visual SLAM for RGB-D
cameras".
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Rejected
from vnav.core.robust import robust_sigma
from vnav.registration.refinement import (
    CAUCHY_SIGMAS,
    CONVERGED,
    NEAREST_M,
    inverse,
    jacobian,
    transform,
)

Array = NDArray[np.float64]
Depth = NDArray[np.float32]

MOTION_SIGMAS = np.repeat([np.deg2rad(3.0), 0.05], 3)  # rad, m: of a predicted motion
LARGEST_SIGMAS = 3.0  # of it, that the motion found may be off the prediction
STRIDE_PX = 6  # between the points that are held against the surface
REACH_PX = 4  # of the plane that is fitted to the surface
SLOPE_PIXELS = 540.0  # variance of a pixel over that of such a plane's slope
EDGE_SIGMAS = 2.0  # root mean square off that plane, where the surface is no edge
ITERATIONS = 30
INLIER_SIGMAS = 3.0
MIN_OVERLAP = 0.4  # share of the points that fall on a surface of the other image
MIN_INLIERS = 0.8  # share of those that lie on it
CORRELATED = 9.0  # neighbouring pixels err alike: so many count for one


@dataclass(frozen=True)
class DepthEstimate:
    """How camera b stands to camera a, from depth and prediction; ``information`` as in `Edge`."""

    T_a_b: Array
    information: Array


def align_depth(
    depth_a_m: Depth,
    depth_b_m: Depth,
    intrinsics: Intrinsics,
    config: RegistrationConfig,
    predicted: Array,
) -> DepthEstimate | Rejected:
    """How camera b stands to a by the surfaces (H, W) that both measure, 0 where there is none.

    Gauss-Newton from the predicted ``T_a_b`` under Cauchy's kernel, which is as wide as the
    residuals are, and narrows with them. Where the surfaces leave a direction open, as a bare wall
    does along itself, the prediction decides, and the information says how little it knows.
    Rejected where too little overlaps or agrees, or where the prediction is contradicted.
    """
    surfaces = _Surfaces(depth_a_m, depth_b_m, intrinsics, config.depth_sigma_per_m2)
    T_a_b, spread = predicted, np.inf
    for _ in range(ITERATIONS):
        narrower = surfaces.spread(T_a_b)
        step = surfaces.step(T_a_b, predicted, narrower)
        T_a_b = T_a_b @ se3.exp(step)
        if np.abs(step).max() < CONVERGED and narrower == spread:
            break
        spread = narrower
    overlap, agreeing = surfaces.agreement(T_a_b)
    if overlap < MIN_OVERLAP:
        return Rejected("too little depth in common")
    if agreeing < MIN_INLIERS:
        return Rejected("surfaces do not agree")
    if np.abs(_off(T_a_b, predicted)).max() > LARGEST_SIGMAS:
        return Rejected("surfaces contradict the prediction")
    return DepthEstimate(T_a_b, surfaces.information(T_a_b))


class _Surfaces:
    """Points of a, the surface of b, and how well they fit under a motion."""

    def __init__(self, a_m: Depth, b_m: Depth, intrinsics: Intrinsics, sigma: float) -> None:
        self._points = _points(a_m, intrinsics)
        self._surface = _surface(b_m, sigma)
        self._camera = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy])
        self._sigma = np.sqrt(2) * sigma  # of a point and a surface

    def spread(self, T_a_b: Array) -> float:
        """Standard deviation of the residuals, no less than the sensor's, by their median."""
        residuals = self._normal_equations(T_a_b, self._sigma)[3]
        seen = residuals[np.isfinite(residuals)]
        return float(max(self._sigma, robust_sigma(seen)) if len(seen) else self._sigma)

    def step(self, T_a_b: Array, predicted: Array, scale: float) -> Array:
        """Gauss-Newton's step (6,), in directions that the surfaces fix, or to the prediction."""
        H, by_noise, g, _ = self._normal_equations(T_a_b, scale)
        known, axes = _known(H - by_noise)
        seeming = np.einsum("ik,ij,jk->k", axes, _scaled(H), axes)
        pull = known / np.maximum(seeming, 1e-9) * (axes.T @ (MOTION_SIGMAS * g)) / CORRELATED
        pull += axes.T @ _off(T_a_b, predicted)
        return np.asarray(-MOTION_SIGMAS * (axes @ (pull / (known + 1))))

    def agreement(self, T_a_b: Array) -> tuple[float, float]:
        """Share of points that fall on a surface, and of those that lie on it."""
        residuals = self._normal_equations(T_a_b, self._sigma)[3]
        on = np.isfinite(residuals)
        if not on.any():
            return 0.0, 0.0
        lie = np.abs(residuals[on]) < INLIER_SIGMAS * self._sigma
        return float(on.mean()), float(lie.mean())

    def information(self, T_a_b: Array) -> Array:
        """Of the surfaces (6, 6), and of the prediction."""
        H, by_noise, *_ = self._normal_equations(T_a_b, self._sigma)
        known, axes = _known(H - by_noise)
        scaled = (axes * (known + 1)) @ axes.T
        return np.asarray(scaled / np.outer(MOTION_SIGMAS, MOTION_SIGMAS))

    def _normal_equations(self, T_a_b: Array, scale: float) -> tuple[Array, Array, Array, Array]:
        found: tuple[Array, Array, Array, Array] = _normal_equations(
            np.asarray(T_a_b), self._points, self._surface, self._camera, scale, self._sigma
        )
        return found


def _scaled(H: Array) -> Array:
    """Information of surfaces (6, 6) in units of the prediction's."""
    return np.asarray(H / CORRELATED * np.outer(MOTION_SIGMAS, MOTION_SIGMAS))


def _known(H: Array) -> tuple[Array, Array]:
    """What surfaces tell, in units of the prediction's information, none below 0, and the axes."""
    known, axes = np.linalg.eigh(_scaled(H))
    return np.maximum(known, 0), axes


def _off(T_a_b: Array, predicted: Array) -> Array:
    """How far (6,) a motion is off the prediction, in the prediction's standard deviations."""
    T = se3.inverse(predicted) @ T_a_b
    return np.asarray(np.concatenate([se3.log_so3(T[:3, :3]), T[:3, 3]]) / MOTION_SIGMAS)


def _points(depth_m: Depth, intrinsics: Intrinsics) -> Array:
    """Points (M, 3) in the camera, on a grid of pixels."""
    v, u = np.mgrid[: depth_m.shape[0] : STRIDE_PX, : depth_m.shape[1] : STRIDE_PX]
    z = depth_m[v, u]
    seen = z > 0
    px = np.stack([u[seen], v[seen]], -1)
    return np.asarray(intrinsics.unproject(px, z[seen]), np.float64)


def _surface(depth_m: Depth, sigma: float) -> Array:
    """Inverse depth and slopes (H, W, 3) by a plane around each pixel; NaN in holes, on edges."""
    seen = depth_m > 0
    inverse = np.where(seen, 1 / np.where(seen, depth_m, 1), 0).astype(np.float64)
    ramp = np.arange(-REACH_PX, REACH_PX + 1.0)
    even, across = np.full(len(ramp), 1 / len(ramp)), ramp / (ramp**2).sum()
    mean, du, dv, square = (
        cv2.sepFilter2D(image, cv2.CV_64F, x, y)
        for image, x, y in (
            (inverse, even, even),
            (inverse, across, even),
            (inverse, even, across),
            (inverse**2, even, even),
        )
    )
    off = square - mean**2 - (du**2 + dv**2) * (ramp**2).mean()
    whole = cv2.boxFilter(seen.astype(np.float64), -1, (len(ramp), len(ramp))) > 1 - 1e-9
    good = whole & (off < (EDGE_SIGMAS * sigma) ** 2)
    return np.asarray(np.where(good[..., None], np.stack([mean, du, dv], -1), np.nan))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _normal_equations(
    T_a_b: Array, points: Array, surface_b: Array, camera: Array, scale: float, sigma: float
) -> tuple[Array, Array, Array, Array]:
    """Normal matrix, how much of it noise of the slopes makes up, gradient, and residuals (M,).

    Each residual counts by ``sigma`` and under a kernel of the given scale; NaN off the surface.
    """
    H, by_noise, g = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    residuals, slope_variance = np.full(len(points), np.nan), CORRELATED * sigma**2 / SLOPE_PIXELS
    p, J, row = np.empty(3), np.empty((3, 6)), np.empty(6)
    height, width = surface_b.shape[:2]
    T_b_a = inverse(T_a_b)
    for m in range(len(points)):
        transform(p, T_b_a, points[m])
        if p[2] <= NEAREST_M:
            continue
        u = camera[0] * p[0] / p[2] + camera[2]
        v = camera[1] * p[1] / p[2] + camera[3]
        if not (0 <= u < width - 1 and 0 <= v < height - 1):
            continue
        x, y = int(np.rint(u)), int(np.rint(v))
        value, du, dv = surface_b[y, x]
        if not value > 0:  # NaN
            continue
        r = 1 / p[2] - value - du * (u - x) - dv * (v - y)
        residuals[m] = r
        jacobian(J, T_a_b, p, p, camera, True)
        weight = 1 / (1 + (r / (CAUCHY_SIGMAS * scale)) ** 2) / sigma**2
        for i in range(6):
            row[i] = J[2, i] - du * J[0, i] - dv * J[1, i]
        for i in range(6):
            g[i] += weight * row[i] * r
            for j in range(6):
                H[i, j] += weight * row[i] * row[j]
                of_slopes = J[0, i] * J[0, j] + J[1, i] * J[1, j]
                by_noise[i, j] += weight * slope_variance * of_slopes
    return H, by_noise, g, residuals
