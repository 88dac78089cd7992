"""The factor graph of bundle adjustment: observations, relative poses, priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.optimisation.sensor_model import CAUCHY_SIGMAS, Bundle, Observations, SensorModel

FIRST_POSE, FIRST_POINT = int(gtsam.symbol("x", 0)), int(gtsam.symbol("l", 0))
BASELINE_M = 0.1  # virtual: it only turns inverse depth into the disparity that gtsam measures
FIXED_SIGMA, LEAST_PRIOR_SIGMA = 1e-5, 1e-3  # rad, m


@dataclass(frozen=True)
class PosePrior:
    """Poses (K, 4, 4) that were given, and the standard deviations (6,) of their tangents.

    Rotation first, rad and m. ``fixed``: the poses stay where they are, whatever their noise.
    """

    T_world_camera: Array
    sigmas: Array
    fixed: bool

    def among(self, needed: NDArray[np.intp]) -> "PosePrior":
        """Of some of the poses."""
        return replace(self, T_world_camera=self.T_world_camera[needed])


@dataclass(frozen=True)
class BundleProblem:
    """Observations, relative poses of cameras that see too little, and their noise.

    ``prior`` is of all cameras; without one, the first camera is fixed.
    """

    seen: Observations
    edges: Sequence[Edge]
    model: SensorModel
    prior: PosePrior | None = None

    def measured_less(self, less: Array) -> "BundleProblem":
        """With pixels and inverse depths (M, 3) of all observations less by so much."""
        seen = self.seen.measured(self.seen.px - less[:, :2], self.seen.inverse_depth - less[:, 2])
        return replace(self, seen=seen)

    @property
    def cameras(self) -> NDArray[np.intp]:
        """Cameras that see anything or have an edge, ascending."""
        of_edges = np.array([[e.i, e.j] for e in self.edges], np.int32).ravel()
        return _distinct(np.concatenate([self.seen.camera, of_edges]))

    @property
    def landmarks(self) -> NDArray[np.intp]:
        """Landmarks that are seen, ascending."""
        return _distinct(self.seen.landmark)


def factor_graph(problem: BundleProblem, bundle: Bundle) -> tuple[Any, Any]:
    """Factors of a problem, and gtsam's values of a bundle."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k in problem.cameras:
        values.insert(pose_key(k), gtsam.Pose3(bundle.T_world_camera[k]))
    for n in problem.landmarks:
        values.insert(point_key(n), bundle.points_world[n])
    _add_priors(graph, problem, bundle)
    _add_observations(graph, problem.seen, problem.model)
    for e in problem.edges:
        noise = gtsam.noiseModel.Gaussian.Information(e.information)
        keys = pose_key(e.i), pose_key(e.j)
        graph.add(gtsam.BetweenFactorPose3(*keys, gtsam.Pose3(e.T_i_j), noise))
    return graph, values


def add_weak_priors(graph: Any, problem: BundleProblem, bundle: Bundle, sigma: float) -> None:
    """A prior of so many rad and m on every camera and landmark where it is, in place."""
    of_pose, of_point = (gtsam.noiseModel.Isotropic.Sigma(n, sigma) for n in (6, 3))
    for k in problem.cameras:
        pose = gtsam.Pose3(bundle.T_world_camera[k])
        graph.add(gtsam.PriorFactorPose3(pose_key(k), pose, of_pose))
    for n in problem.landmarks:
        graph.add(gtsam.PriorFactorPoint3(point_key(n), bundle.points_world[n], of_point))


def landmarks_first(problem: BundleProblem) -> Any:
    """Elimination order of the Schur complement: landmarks, then cameras."""
    ordering = gtsam.Ordering()
    for n in problem.landmarks:
        ordering.push_back(point_key(n))
    for k in problem.cameras:
        ordering.push_back(pose_key(k))
    return ordering


def pose_key(k: int) -> int:
    """Key of camera k."""
    return FIRST_POSE + int(k)


def point_key(n: int) -> int:
    """Key of landmark n."""
    return FIRST_POINT + int(n)


def _distinct(rows: NDArray[np.int32]) -> NDArray[np.intp]:
    """The rows (M,) that occur, ascending."""
    return np.flatnonzero(np.bincount(rows))


def _add_priors(graph: Any, problem: BundleProblem, bundle: Bundle) -> None:
    """A prior on all cameras where they have one, else on the first, which it fixes."""
    prior = problem.prior or PosePrior(bundle.T_world_camera, np.zeros(6), fixed=True)
    spread = np.full(6, FIXED_SIGMA) if prior.fixed else prior.sigmas.clip(LEAST_PRIOR_SIGMA)
    noise = gtsam.noiseModel.Diagonal.Sigmas(spread)
    for k in problem.cameras if problem.prior else problem.cameras[:1]:
        pose = gtsam.Pose3(prior.T_world_camera[k])
        graph.add(gtsam.PriorFactorPose3(pose_key(k), pose, noise))


def _add_observations(graph: Any, seen: Observations, model: SensorModel) -> None:
    """A stereo factor for each observation with depth, a projection factor for each without."""
    noise_px, noise_stereo = _noise(model)
    stereo = [gtsam.Cal3_S2Stereo(i.fx, i.fy, 0, i.cx, i.cy, BASELINE_M) for i in model.intrinsics]
    mono = [gtsam.Cal3_S2(i.fx, i.fy, 0, i.cx, i.cy) for i in model.intrinsics]
    disparity = model.focal_px[seen.camera] * BASELINE_M * seen.inverse_depth
    columns = seen.camera, seen.landmark, seen.px, disparity
    for c, landmark, (u, v), d in zip(*(column.tolist() for column in columns), strict=True):
        keys = pose_key(c), point_key(landmark)
        if math.isnan(d):
            pixel = np.array([u, v])
            graph.add(gtsam.GenericProjectionFactorCal3_S2(pixel, noise_px, *keys, mono[c]))
        else:
            both = gtsam.StereoPoint2(u, u - d, v)
            graph.add(gtsam.GenericStereoFactor3D(both, noise_stereo[c], *keys, stereo[c]))


def _noise(model: SensorModel) -> tuple[Any, list[Any]]:
    """Robust noise of a pixel, and of (left u, right u, v) for each camera."""
    cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY_SIGMAS)
    variance = model.pixel_sigma**2
    pixel = gtsam.noiseModel.Isotropic.Sigma(2, model.pixel_sigma)
    stereo = []
    for i in model.intrinsics:
        of_disparity = (i.fx * BASELINE_M * model.depth_sigma) ** 2
        right = variance + of_disparity
        covariance = np.array([[variance, variance, 0], [variance, right, 0], [0, 0, variance]])
        gaussian = gtsam.noiseModel.Gaussian.Covariance(covariance)
        stereo.append(gtsam.noiseModel.Robust.Create(cauchy, gaussian))
    return gtsam.noiseModel.Robust.Create(cauchy, pixel), stereo
