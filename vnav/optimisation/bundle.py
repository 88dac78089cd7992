"""Bundle adjustment of keyframes and landmarks, with reprojection and depth terms."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.robust import robust_sigma

FIRST_POSE, FIRST_POINT = int(gtsam.symbol("x", 0)), int(gtsam.symbol("l", 0))
BASELINE_M = 0.1  # virtual: it only turns inverse depth into the disparity that gtsam measures
CAUCHY_SIGMAS = 2.0
LONG_TRACK = 3  # sightings: two leave little over to tell noise from
ENOUGH = 100  # of them; fewer tell no noise
LEAST_PIXEL_SIGMA, LEAST_DEPTH_SIGMA = 0.1, 1e-4  # a perfect capture would divide by zero
EXACT_SIGMA, PRIOR_SIGMA = 1e-5, 1e-3  # rad, m: of poses that stay, and at least of a prior
OFFSET_SIGMA = 2e-4  # 1/m of inverse depth, 3 mm at 4 m: a sensor's prior, and what is tried
LARGEST_OFFSET = 3 * OFFSET_SIGMA
OFFSET_ITERATIONS = 8  # from one bundle for all that are tried, so that their costs compare
CONVERGED = 1e-3  # relative decrease of the error; a hundredth of it moves no pose by 0.1 mm


@dataclass(frozen=True)
class Observations:
    """M sightings of landmarks by cameras.

    ``landmark``, ``camera`` (M,) rows; ``px`` (M, 2); ``inverse_depth`` (M,) 1/m, NaN where the
    camera had no depth there.
    """

    landmark: NDArray[np.int32]
    camera: NDArray[np.int32]
    px: Array
    inverse_depth: Array

    def __getitem__(self, selection: Any) -> "Observations":
        """The selected observations."""
        return Observations(*(column[selection] for column in vars(self).values()))

    def __len__(self) -> int:
        return len(self.landmark)

    def less(self, offset: float) -> "Observations":
        """The same with all inverse depths less by that, in 1/m."""
        return Observations(self.landmark, self.camera, self.px, self.inverse_depth - offset)


@dataclass(frozen=True)
class Bundle:
    """Poses (K, 4, 4) and points (L, 3)."""

    T_world_camera: Array
    points_world: Array


@dataclass(frozen=True)
class Prior:
    """Poses (K, 4, 4) that were given, and the standard deviations (6,) of their tangents.

    Rotation first, rad and m. ``fixed``: the poses stay where they are, whatever their noise.
    """

    T_world_camera: Array
    sigmas: Array
    fixed: bool


class SensorModel:
    """The camera and its noise: residuals in standard deviations."""

    def __init__(self, intrinsics: Sequence[Intrinsics], config: RegistrationConfig) -> None:
        self.intrinsics = intrinsics  # one a camera row
        self.pixel_sigma = config.pixel_sigma_px
        self.depth_sigma = config.depth_sigma_per_m2
        self._table = np.array([(i.fx, i.fy, i.cx, i.cy) for i in intrinsics])
        self.focal_px = self._table[:, 0]

    def fitted(self, bundle: Bundle, seen: Observations) -> "SensorModel":
        """The same cameras with the noise that the residuals show, which is never taken for more.

        From the median absolute residual of landmarks with `LONG_TRACK` sightings or more,
        corrected for what their points take up. Too few of these: no change.
        """
        sightings = np.bincount(seen.landmark)[seen.landmark]
        long = sightings >= LONG_TRACK
        if long.sum() < ENOUGH:
            return self
        p, _ = self._in_camera(bundle, seen[long])
        left = np.sqrt(1 - (1 / sightings[long]).mean())
        off = self._reprojection(p, seen[long])
        d = 1 / p[:, 2] - seen.inverse_depth[long]
        pixel = max(float(robust_sigma(off)) / left, LEAST_PIXEL_SIGMA)
        depth = max(float(robust_sigma(d)) / left, LEAST_DEPTH_SIGMA)
        model = copy.copy(self)
        model.pixel_sigma = min(pixel, self.pixel_sigma)
        model.depth_sigma = min(depth, self.depth_sigma)
        return model

    def squared_residuals(self, bundle: Bundle, seen: Observations) -> Array:
        """Squared residuals (M,) in standard deviations; infinite behind the camera."""
        p, _ = self._in_camera(bundle, seen)
        front = p[:, 2] > 0.05
        w = 1 / np.where(front, p[:, 2], 1.0)
        off = self._reprojection(p, seen)
        d = np.nan_to_num(w - seen.inverse_depth)
        squared = (off**2).sum(1) / self.pixel_sigma**2 + (d / self.depth_sigma) ** 2
        return np.where(front, squared, np.inf)

    def cost(self, bundle: Bundle, seen: Observations) -> float:
        """Half the sum of squared residuals under the kernel that `adjust` makes least."""
        width = CAUCHY_SIGMAS**2
        return float(width / 2 * np.log1p(self.squared_residuals(bundle, seen) / width).sum())

    def rms_px(self, bundle: Bundle, seen: Observations) -> float:
        """Root mean square reprojection error; NaN without observations."""
        if not len(seen):
            return float("nan")
        off = self._reprojection(self._in_camera(bundle, seen)[0], seen)
        return float(np.sqrt((off**2).sum(1).mean()))

    def point_sigmas(self, bundle: Bundle, seen: Observations) -> Array:
        """Standard deviation (L,) of each point given the poses, root mean square over the axes.

        Infinite for a point that its observations do not fix.
        """
        p, R = self._in_camera(bundle, seen)
        w, k = 1 / p[:, 2], self._table[seen.camera]
        J = np.zeros((len(p), 3, 3))
        J[:, 0, 0], J[:, 1, 1], J[:, 2, 2] = k[:, 0] * w, k[:, 1] * w, -(w**2)
        J[:, :2, 2] = -k[:, :2] * p[:, :2] * w[:, None] ** 2
        J /= np.array([self.pixel_sigma, self.pixel_sigma, self.depth_sigma])[:, None]
        J[~np.isfinite(seen.inverse_depth), 2] = 0
        J = J @ R
        information = np.zeros((len(bundle.points_world), 3, 3))
        np.add.at(information, seen.landmark, np.swapaxes(J, 1, 2) @ J)
        fixed = np.linalg.eigvalsh(information)[:, 0] > 1.0  # a metre at the most
        safe = np.where(fixed[:, None, None], information, np.eye(3))
        variance = np.trace(np.linalg.inv(safe), axis1=1, axis2=2) / 3
        return np.asarray(np.where(fixed, np.sqrt(variance), np.inf))

    def _in_camera(self, bundle: Bundle, seen: Observations) -> tuple[Array, Array]:
        """Points (M, 3) in their cameras, and rotations (M, 3, 3) from the world."""
        T = se3.inverse(bundle.T_world_camera)[seen.camera]
        points = bundle.points_world[seen.landmark]
        return (T[:, :3, :3] @ points[:, :, None])[..., 0] + T[:, :3, 3], T[:, :3, :3]

    def _reprojection(self, points_camera: Array, seen: Observations) -> Array:
        k = self._table[seen.camera]
        z = np.where(points_camera[:, 2] > 0.05, points_camera[:, 2], 1.0)
        return np.asarray(k[:, :2] * points_camera[:, :2] / z[:, None] + k[:, 2:] - seen.px)


def adjust(
    initial: Bundle,
    seen: Observations,
    edges: Sequence[Edge],
    model: SensorModel,
    iterations: int,
    prior: Prior | None = None,
    tolerance: float = CONVERGED,
) -> Bundle:
    """Poses and points that explain all observations best; the first camera stays where it is.

    Where there is a ``prior``, it holds all cameras instead; if it is fixed, only points move.
    A stereo factor with a virtual baseline gives depth noise that grows with depth squared;
    observations without depth are plain projections. ``edges`` hold cameras that see little.
    Levenberg-Marquardt with a Cauchy kernel, until a step takes less than ``tolerance`` of the
    error; deterministic. Without observations and edges nothing moves.
    """
    if not len(_cameras(seen, edges)):
        return initial
    graph, values = _problem(initial, seen, edges, model, prior)
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(iterations)
    params.setRelativeErrorTol(tolerance)
    params.setOrdering(_points_first(seen, edges))
    values = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    poses, points = initial.T_world_camera.copy(), initial.points_world.copy()
    for k in () if prior and prior.fixed else _cameras(seen, edges):
        poses[k] = values.atPose3(_pose(k)).matrix()
    for n in _distinct(seen.landmark):
        points[n] = values.atPoint3(_point(n))
    return Bundle(poses, points)


def depth_offset(
    bundle: Bundle,
    seen: Observations,
    edges: Sequence[Edge],
    model: SensorModel,
    prior: Prior | None = None,
) -> float:
    """What all measured inverse depths (1/m) have too much; 0 where the images contradict it.

    Depth by triangulation, from structured light or stereo, errs by an offset of its disparity.
    That bends what is far against what is near, as no scale would, and landmarks seen from several
    places show it. Taken where the cost of the best bundle, a parabola of the offset, and the
    prior's are least together. A minimum beyond `LARGEST_OFFSET` is not that of an offset: such
    depth errs otherwise. Source: Herrera, Kannala, Heikkila 2012, "Joint depth and color camera
    calibration with distortion correction", whose c0 it is.
    """
    costs = []
    for offset in (-OFFSET_SIGMA, 0.0, OFFSET_SIGMA):
        shifted = seen.less(offset)
        best = adjust(bundle, shifted, edges, model, OFFSET_ITERATIONS, prior, tolerance=0.0)
        costs.append(model.cost(best, shifted))
    below, at, above = costs
    bend = max(below - 2 * at + above, 0.0) + 1.0  # the prior's
    offset = OFFSET_SIGMA * (below - above) / (2 * bend)
    return offset if abs(offset) < LARGEST_OFFSET else 0.0


def covariances(
    bundle: Bundle,
    seen: Observations,
    edges: Sequence[Edge],
    model: SensorModel,
    prior: Prior | None = None,
) -> Array:
    """Marginal covariance (K, 6, 6) of each camera's tangent, rotation first; NaN if unseen.

    Relative to the first camera, which is held, or to the world of the ``prior``; that of the prior
    itself where it is fixed.
    """
    if prior and prior.fixed:
        return np.tile(np.diag(prior.sigmas**2), (len(bundle.T_world_camera), 1, 1))
    result = np.full((len(bundle.T_world_camera), 6, 6), np.nan)
    cameras = _cameras(seen, edges)
    if not len(cameras):
        return result
    marginals = gtsam.Marginals(*_problem(bundle, seen, edges, model, prior))
    for k in cameras:
        result[k] = marginals.marginalCovariance(_pose(k))
    return result


def _problem(
    bundle: Bundle,
    seen: Observations,
    edges: Sequence[Edge],
    model: SensorModel,
    prior: Prior | None = None,
) -> tuple[Any, Any]:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    cameras = _cameras(seen, edges)
    for k in cameras:
        values.insert(_pose(k), gtsam.Pose3(bundle.T_world_camera[k]))
    for n in _distinct(seen.landmark):
        values.insert(_point(n), bundle.points_world[n])
    held = prior or Prior(bundle.T_world_camera, np.zeros(6), fixed=True)
    sigmas = np.full(6, EXACT_SIGMA) if held.fixed else np.maximum(held.sigmas, PRIOR_SIGMA)
    spread = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    for k in cameras if prior else cameras[:1]:
        graph.add(gtsam.PriorFactorPose3(_pose(k), gtsam.Pose3(held.T_world_camera[k]), spread))
    _add_observations(graph, seen, model)
    for e in edges:
        noise = gtsam.noiseModel.Gaussian.Information(e.information)
        graph.add(gtsam.BetweenFactorPose3(_pose(e.i), _pose(e.j), gtsam.Pose3(e.T_i_j), noise))
    return graph, values


def _points_first(seen: Observations, edges: Sequence[Edge]) -> Any:
    """Eliminate the points, each of which its cameras alone hold, then the cameras."""
    ordering = gtsam.Ordering()
    for n in _distinct(seen.landmark):
        ordering.push_back(_point(n))
    for k in _cameras(seen, edges):
        ordering.push_back(_pose(k))
    return ordering


def _cameras(seen: Observations, edges: Sequence[Edge]) -> NDArray[np.intp]:
    joined = np.array([[e.i, e.j] for e in edges], np.int32).ravel()
    return _distinct(np.concatenate([seen.camera, joined]))


def _distinct(rows: NDArray[np.int32]) -> NDArray[np.intp]:
    """The rows (M,) that occur, ascending."""
    return np.flatnonzero(np.bincount(rows))


def _add_observations(graph: Any, seen: Observations, model: SensorModel) -> None:
    noise_px, noise_stereo = _noise(model)
    stereo = [gtsam.Cal3_S2Stereo(i.fx, i.fy, 0, i.cx, i.cy, BASELINE_M) for i in model.intrinsics]
    mono = [gtsam.Cal3_S2(i.fx, i.fy, 0, i.cx, i.cy) for i in model.intrinsics]
    disparity = model.focal_px[seen.camera] * BASELINE_M * seen.inverse_depth
    rows = zip(
        seen.camera.tolist(),
        seen.landmark.tolist(),
        seen.px.tolist(),
        disparity.tolist(),
        strict=True,
    )
    for camera, landmark, (u, v), d in rows:
        keys = _pose(camera), _point(landmark)
        if d == d:
            measured = gtsam.StereoPoint2(u, u - d, v)
            graph.add(
                gtsam.GenericStereoFactor3D(measured, noise_stereo[camera], *keys, stereo[camera])
            )
        else:
            graph.add(
                gtsam.GenericProjectionFactorCal3_S2(
                    np.array([u, v]), noise_px, *keys, mono[camera]
                )
            )


def _noise(model: SensorModel) -> tuple[Any, list[Any]]:
    """Robust noise of a pixel, and of (left u, right u, v) for each camera."""
    robust = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY_SIGMAS)
    s2 = model.pixel_sigma**2
    pixel = gtsam.noiseModel.Isotropic.Sigma(2, model.pixel_sigma)
    stereo = []
    for i in model.intrinsics:
        d2 = (i.fx * BASELINE_M * model.depth_sigma) ** 2
        covariance = np.array([[s2, s2, 0], [s2, s2 + d2, 0], [0, 0, s2]])
        gaussian = gtsam.noiseModel.Gaussian.Covariance(covariance)
        stereo.append(gtsam.noiseModel.Robust.Create(robust, gaussian))
    return gtsam.noiseModel.Robust.Create(robust, pixel), stereo


def _pose(k: int) -> int:
    return FIRST_POSE + int(k)


def _point(n: int) -> int:
    return FIRST_POINT + int(n)
