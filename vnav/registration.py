"""Two frames to the transformation between them: claim 3, S3 to S5."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features, PoseEstimate, Rejected
from vnav.core.mapping import Keyframe

Array = NDArray[np.float64]
SAMPLE = 3  # matched points that fix a rigid transformation
BATCH = 64  # hypotheses tried at once
CONFIDENCE = 0.999
NEAREST_M = 0.05  # nothing is seen nearer than this
CONVERGED = 1e-5  # rad and m: a tenth of what the best pair of frames can tell
CAUCHY_SIGMAS = 2.0
INLIER_SIGMAS_SQUARED = 14.2  # chi-squared, 3 degrees of freedom: 99.7 % of the right matches
LINE_SIGMAS = 2.0  # of depth: points that spread less off a line do not fix the turn about it


class Matcher(Protocol):
    """Finds which features of two frames are the same: rows (M, 2) of a's and b's."""

    def everywhere(self, a: Features, b: Features) -> NDArray[np.int32]:
        """Matches over the whole image."""

    def near(
        self, a: Features, b: Features, predicted_px: Array, radius_px: float
    ) -> NDArray[np.int32]:
        """Matches close to where a's features are predicted in b, NaN for those with no place."""


@dataclass(frozen=True)
class Sensor:
    """The camera that took both frames, how far its measurements are trusted, and the matcher."""

    intrinsics: Intrinsics
    config: RegistrationConfig
    matcher: Matcher


def register(
    a: Keyframe,
    b: Keyframe,
    sensor: Sensor,
    rng: np.random.Generator,
    predicted: Array | None = None,
) -> PoseEstimate | Rejected:
    """How camera b stands to camera a, or why that cannot be told.

    Matches, RANSAC on three matched 3D points each, then robust non-linear refinement of
    reprojection and inverse depth with the sensor's noise. Where a motion ``T_a_b`` is
    ``predicted``, matches are first sought near the places that it gives, then everywhere by the
    ratio test. With the motion found, matches are sought once more, close to where it puts them.
    """
    verdict = Rejected("too few matches")
    for matches in _searches(a, b, sensor, predicted):
        estimate = _estimate(a, b, matches, sensor, rng)
        if isinstance(estimate, PoseEstimate):
            return estimate
        verdict = estimate
    return verdict


def _searches(
    a: Keyframe, b: Keyframe, sensor: Sensor, predicted: Array | None
) -> Iterator[NDArray[np.int32]]:
    """Matches near the predicted places, then those of the ratio test over the whole image."""
    config = sensor.config
    if predicted is not None:
        yield _near(a, b, predicted, sensor, config.search_radius_px)
    matches = sensor.matcher.everywhere(a.features, b.features)
    yield matches[a.has_depth[matches[:, 0]]]


def _near(
    a: Keyframe, b: Keyframe, T_a_b: Array, sensor: Sensor, radius_px: float
) -> NDArray[np.int32]:
    """Matches close to where a motion puts a's features in b."""
    seen_from_b = se3.transform(se3.inverse(T_a_b), a.points_camera)
    predicted_px = sensor.intrinsics.project(seen_from_b)
    return sensor.matcher.near(a.features, b.features, predicted_px, radius_px)


def _estimate(
    a: Keyframe,
    b: Keyframe,
    matches: NDArray[np.int32],
    sensor: Sensor,
    rng: np.random.Generator,
) -> PoseEstimate | Rejected:
    """The motion that matches agree on, refined on all that agree with it."""
    config = sensor.config
    if len(matches) < config.min_inliers:
        return Rejected("too few matches", len(matches))
    pairs = Pairs(a, b, matches, sensor)
    T_a_b = _ransac(pairs, config, rng)
    if T_a_b is None:
        return Rejected("no consistent motion", len(matches))
    T_a_b = _refine(T_a_b, pairs)
    found = _judge(T_a_b, pairs, matches, config)
    if isinstance(found, Rejected):
        return found
    closer = _near(a, b, T_a_b, sensor, config.polish_radius_px)
    if len(closer) <= len(found.inliers):
        return found
    pairs = Pairs(a, b, closer, sensor)
    polished = _judge(_refine(T_a_b, pairs), pairs, closer, config)
    return polished if isinstance(polished, PoseEstimate) else found


class Pairs:
    """Matches as residuals: a's 3D points seen in b as pixel and, where b has depth, depth."""

    def __init__(
        self,
        a: Keyframe,
        b: Keyframe,
        matches: NDArray[np.int32],
        sensor: Sensor,
    ) -> None:
        intrinsics, config = sensor.intrinsics, sensor.config
        self.points_a = a.points_camera[matches[:, 0]].astype(float)
        self.points_b = b.points_camera[matches[:, 1]].astype(float)
        self.px_b = b.features.keypoints_px[matches[:, 1]].astype(float)
        self.both = np.isfinite(self.points_b[:, 2])
        self.inverse_depth_b = np.where(
            self.both, 1 / np.where(self.both, self.points_b[:, 2], 1), 0
        )
        self.focal = np.array([intrinsics.fx, intrinsics.fy])
        self.intrinsics = intrinsics
        self.variances = np.array(
            [config.pixel_sigma_px**2, config.pixel_sigma_px**2, config.depth_sigma_per_m2**2]
        )

        # Derivative (M, 3, 3) of a's points by their (u, v, 1/z).
        self.point_jacobian = np.zeros((len(self.points_a), 3, 3))
        self.point_jacobian[:, [0, 1], [0, 1]] = self.points_a[:, 2:] / self.focal
        self.point_jacobian[:, :, 2] = -self.points_a * self.points_a[:, 2:]

    def residuals(self, T_a_b: Array) -> Array:
        """Residuals (..., M, 3) in pixels, pixels, 1/m for one or many motions (..., 4, 4).

        Points behind b get an infinite residual; the third is 0 where b has no depth.
        """
        points = se3.transform(se3.inverse(T_a_b), self.points_a)
        z = points[..., 2]
        front = z > NEAREST_M
        inverse = 1 / np.where(front, z, 1.0)
        i = self.intrinsics
        u = i.fx * points[..., 0] * inverse + i.cx - self.px_b[:, 0]
        v = i.fy * points[..., 1] * inverse + i.cy - self.px_b[:, 1]
        w = np.where(self.both, inverse - self.inverse_depth_b, 0.0)
        return np.stack([np.where(front, u, np.inf), np.where(front, v, np.inf), w], -1)

    def whitening(self, T_a_b: Array) -> Array:
        """Matrices (M, 3, 3) that turn residuals into standard deviations near one motion.

        Both measurements count: b's own, and a's carried over by the motion.
        """
        points = self.points_b_from(T_a_b)
        J = self.pixel_jacobian(points) @ T_a_b[:3, :3].T @ self.point_jacobian
        covariance = (J * self.variances) @ np.swapaxes(J, -1, -2) + np.diag(self.variances)
        covariance[~self.both, 2, :] = covariance[~self.both, :, 2] = 0
        covariance[~self.both, 2, 2] = 1.0
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))

    def points_b_from(self, T_a_b: Array) -> Array:
        """Where b sees a's points (M, 3); (0, 0, 1) behind b, where residuals are infinite."""
        points = se3.transform(se3.inverse(T_a_b), self.points_a)
        return np.where(points[:, 2:] > NEAREST_M, points, [0.0, 0.0, 1.0])

    def pixel_jacobian(self, points: Array) -> Array:
        """Derivative (M, 3, 3) of (u, v, 1/z) by the point in the camera."""
        w = 1 / points[:, 2]
        J = np.zeros((len(points), 3, 3))
        J[:, 0, 0], J[:, 1, 1] = self.focal[0] * w, self.focal[1] * w
        J[:, 0, 2] = -self.focal[0] * points[:, 0] * w**2
        J[:, 1, 2] = -self.focal[1] * points[:, 1] * w**2
        J[:, 2, 2] = -(w**2)
        return J


def _ransac(pairs: Pairs, config: RegistrationConfig, rng: np.random.Generator) -> Array | None:
    """The motion that most matches agree with, from minimal sets of matched 3D points."""
    usable = np.flatnonzero(pairs.both)
    if len(usable) < SAMPLE:
        return None
    best, best_cost, needed, tried = None, np.inf, config.ransac_iterations, 0
    while tried < needed:
        chosen = usable[rng.random((BATCH, len(usable))).argpartition(SAMPLE - 1, 1)[:, :SAMPLE]]
        T_a_b = se3.align(pairs.points_a[chosen], pairs.points_b[chosen])
        errors: Array = np.minimum(_squared_errors(pairs, T_a_b, config), 1.0)
        cost = errors.sum(1)
        k = int(cost.argmin())
        if cost[k] < best_cost:
            best, best_cost = T_a_b[k], float(cost[k])
            share = max(float((errors[k] < 1).mean()), 1e-3)
            needed = min(
                needed, int(np.log(1 - CONFIDENCE) / np.log(1 - share**SAMPLE + 1e-12)) + 1
            )
        tried += BATCH
    return best


def _squared_errors(pairs: Pairs, T_a_b: Array, config: RegistrationConfig) -> Array:
    """Squared residuals (..., M) in units of the threshold: 1 is where an inlier ends.

    The depth noise of both ends shows in the reprojection, so the threshold is meant in pixels
    and, for inverse depth, in as many standard deviations.
    """
    r = pairs.residuals(T_a_b)
    sigmas = config.ransac_threshold_px / config.pixel_sigma_px * np.sqrt(pairs.variances)
    return np.asarray(((r / sigmas) ** 2).sum(-1))


def _refine(T_a_b: Array, pairs: Pairs, iterations: int = 12) -> Array:
    """Gauss-Newton on whitened residuals with Cauchy weights; claim 3, S5."""
    W = pairs.whitening(T_a_b)
    for _ in range(iterations):
        H, g, _ = _normal_equations(T_a_b, pairs, W)
        step = -np.linalg.solve(H + 1e-9 * (1 + np.trace(H)) * np.eye(6), g)
        T_a_b = T_a_b @ se3.exp(step)
        if np.abs(step).max() < CONVERGED:
            break
    return T_a_b


def _normal_equations(T_a_b: Array, pairs: Pairs, W: Array) -> tuple[Array, Array, Array]:
    """Gauss-Newton matrix (6, 6), gradient (6,) and squared whitened residuals (M,)."""
    r, points = pairs.residuals(T_a_b), pairs.points_b_from(T_a_b)
    front = np.isfinite(r[:, 0])
    e = (W @ np.where(front[:, None], r, 0.0)[..., None])[..., 0]
    moved = np.concatenate([se3.hat(points), np.broadcast_to(-np.eye(3), (len(r), 3, 3))], -1)
    J = W @ pairs.pixel_jacobian(points) @ moved
    J[~pairs.both, 2] = 0
    squared = np.where(front, (e**2).sum(-1), np.inf)
    root_weight = 1 / np.sqrt(1 + squared / CAUCHY_SIGMAS**2)
    J = (root_weight[:, None, None] * J).reshape(-1, 6)
    return J.T @ J, J.T @ (root_weight[:, None] * e).ravel(), squared


def _judge(
    T_a_b: Array, pairs: Pairs, matches: NDArray[np.int32], config: RegistrationConfig
) -> PoseEstimate | Rejected:
    """The estimate, or why too little holds it."""
    H, _, squared = _normal_equations(T_a_b, pairs, pairs.whitening(T_a_b))
    inlier = squared < INLIER_SIGMAS_SQUARED
    count = int(inlier.sum())
    if count < config.min_inliers:
        return Rejected("too few inliers", len(matches), count)
    if count < config.min_inlier_share * len(matches):
        return Rejected("too small a share of inliers", len(matches), count)
    if _on_line(pairs.points_a[inlier], config):
        return Rejected("matches on a line", len(matches), count)
    r = pairs.residuals(T_a_b)
    rms = float(np.sqrt((r[inlier, :2] ** 2).sum(-1).mean()))
    return PoseEstimate(T_a_b, H, matches[inlier], len(matches), rms)


def _on_line(points: Array, config: RegistrationConfig) -> bool:
    """Whether points (M, 3) spread off a line by no more than noise; so do those on one spot."""
    variance = np.linalg.eigvalsh(np.cov(points.T, bias=True))[1]
    noise = config.depth_sigma_per_m2**2 * (points[:, 2] ** 4).mean()
    return bool(variance < LINE_SIGMAS**2 * noise)
