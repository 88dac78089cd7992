"""What finding a photo is held against: exhaustive matching, and other solvers of absolute pose."""

import importlib
from types import ModuleType
from typing import Any

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array, Floats
from vnav.core.camera import CameraPrior
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.features.matching import match
from vnav.io.store.artifacts import load_odometry, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.hypotheses.ransac import RansacOptions, estimate_absolute_pose
from vnav.localisation.matches import Correspondences2D3D
from vnav.localisation.verdict.answer import PhotoAnswer

RATIO, BEST_KEYFRAMES = 0.8, 12


class Exhaustive:
    """Every keyframe's features with depth, to be matched one keyframe after the other."""

    def __init__(self, folder: MapFolder) -> None:
        poses = load_optimised(folder).T_world_camera
        self._views = [_with_depth(k, poses[k.row]) for k in load_odometry(folder).keyframes]

    def locate(self, answer: PhotoAnswer, config: Config) -> Array | None:
        """T_world_camera of a photo whose features are known; None where there is no pose."""
        photo, views = answer.photo, []
        for features, points in self._views:
            rows = match(features, photo.features, RATIO)
            views.append((len(rows), points[rows[:, 0]], photo.features.keypoints_px[rows[:, 1]]))
        views = sorted(views, key=lambda view: -view[0])[:BEST_KEYFRAMES]
        points, px = (np.concatenate([view[k] for view in views]) for k in (1, 2))
        threshold_px = config.locate.ransac_threshold_px * photo.pixel_scale
        matched = Correspondences2D3D(points, px, np.full(len(px), photo.pixel_scale**2))
        if poselib := optional("poselib"):
            return by_poselib(poselib, matched, photo.camera, threshold_px)
        min_inliers, iterations = config.locate.min_inliers, config.locate.ransac_iterations
        options = RansacOptions(threshold_px, min_inliers, iterations, "p3p")
        rng = np.random.default_rng(config.seed)
        found = estimate_absolute_pose(matched, photo.camera, options, rng)
        return found.view.T_world_camera if found else None


def _with_depth(keyframe: FrameFeatures, T_world_camera: Array) -> tuple[Features, Floats]:
    rows = np.flatnonzero(keyframe.has_depth)
    points = se3.transform(T_world_camera, keyframe.points_camera[rows])
    return keyframe.features[rows], points.astype(np.float32)


def optional(name: str) -> ModuleType | None:
    """A solver that need not be installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def by_poselib(
    poselib: Any, matched: Correspondences2D3D, prior: CameraPrior, threshold_px: float
) -> Array | None:
    """T_world_camera; None where nothing agrees."""
    k = prior.intrinsics
    camera = {"model": "PINHOLE", "width": k.width, "height": k.height}
    camera["params"] = [k.fx, k.fy, k.cx, k.cy]
    px, points = matched.px.astype(float), matched.points_world.astype(float)
    options = {"max_reproj_error": threshold_px}
    pose, found = poselib.estimate_absolute_pose(px, points, camera, options, {})
    if found["num_inliers"] < 4:
        return None
    return se3.inverse(np.vstack([pose.Rt, [0, 0, 0, 1]]))


def by_pycolmap(
    pycolmap: Any, matched: Correspondences2D3D, prior: CameraPrior, threshold_px: float
) -> None:
    """The same by COLMAP's estimator with refinement."""
    k = prior.intrinsics
    params = [k.fx, k.fy, k.cx, k.cy]
    camera = pycolmap.Camera(model="PINHOLE", width=k.width, height=k.height, params=params)
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = threshold_px
    px, points = matched.px.astype(float), matched.points_world.astype(float)
    pycolmap.estimate_and_refine_absolute_pose(px, points, camera, options)
