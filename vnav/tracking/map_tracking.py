"""Frames tracked against the keyframes that see the same, by patches: 003 cl.3, cl.4, S2."""

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Frame, PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.features.description import points_of, undescribed
from vnav.registration.correspondences import Correspondences
from vnav.registration.estimators.points3d import Points3dEstimator
from vnav.registration.image_filters import exposure_gain
from vnav.tracking.local_map import LocalMap, VisiblePoints, grey_image
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.patch_alignment import affine_warp, align_patches

GAIN_STRIDE_PX = 8  # between the pixels that tell how much brighter an image is


class MapTracker:
    """Holds the current frame against the local map, near the pose that it has been given."""

    def __init__(self, config: Config, motion: ConstantVelocity) -> None:
        self._config = config
        self._motion = motion
        self._map = LocalMap(config.registration.depth_sigma_per_m2)

    def add(
        self, keyframe: FrameFeatures, frame: Frame, estimates: dict[int, PoseEstimate]
    ) -> None:
        """Take a new keyframe; ``estimates``: its motions from earlier frames, by their rows."""
        if self._config.odometry.against_map:
            self._map.add(keyframe, frame, estimates)

    def track(self, row: int, frame: Frame, probability: float) -> list[Edge]:
        """An edge to a frame whose pose is known, from the nearest keyframe that sees the same.

        All patches that are found again tell it together; its ``probability`` is that of the pose,
        near which they were sought. Empty where too few are found, or where the setting is off.
        """
        if not self._config.odometry.against_map:
            return []
        found = _aligned(self._map.visible(self._poses_from(row), frame.intrinsics), frame)
        estimate = self._refined(found, row, frame) if found else None
        if estimate is None:
            return []
        for points in found:
            self._map.count_matched(points.keyframe, points.rows)
        first = found[0].keyframe.row
        return [Edge(first, row, estimate.T_a_b, estimate.information, probability)]

    def _poses_from(self, row: int) -> dict[int, Array]:
        """How the frame stands to the keyframes of its track, by their rows."""
        rows = [keyframe.row for keyframe in self._map.keyframes]
        T_camera_keyframe = {k: self._motion.between(row, k) for k in rows}
        return {k: T for k, T in T_camera_keyframe.items() if T is not None}

    def _refined(self, found: list[VisiblePoints], row: int, frame: Frame) -> PoseEstimate | None:
        """The pose from the nearest keyframe, by robust reprojection and inverse depth."""
        T_camera_a, a_row = found[0].T_camera_keyframe, found[0].keyframe.row
        T_a_camera, points_a = se3.inverse(T_camera_a), []
        for of in found:
            points = of.keyframe.frame.points_camera[of.rows]
            points_a.append(se3.transform(T_a_camera @ of.T_camera_keyframe, points))
        px = np.concatenate([of.px for of in found])
        config = self._config.registration
        a = undescribed(a_row, px, np.concatenate(points_a))
        b = undescribed(row, px, points_of(px.astype(np.float32), frame, self._config))
        matches = np.repeat(np.arange(len(px), dtype=np.int32)[:, None], 2, 1)
        cameras = frame.intrinsics, frame.intrinsics
        correspondences = Correspondences(a, b, matches, cameras, config)
        estimate = Points3dEstimator(config).refine(T_a_camera, correspondences)
        return estimate if isinstance(estimate, PoseEstimate) else None


def _aligned(seen: list[VisiblePoints], frame: Frame) -> list[VisiblePoints]:
    """The points whose patches are found in the frame, with the pixels where: S24 to S252."""
    grey = grey_image(frame)
    found = [_found(points, grey, frame.intrinsics) for points in seen]
    return [points for points in found if len(points.rows)]


def _found(points: VisiblePoints, grey: Array, camera: Intrinsics) -> VisiblePoints:
    keyframe, T = points.keyframe, points.T_camera_keyframe
    px = keyframe.frame.features.keypoints_px[points.rows].astype(np.float64)
    warp = affine_warp(T, px, keyframe.surface[points.rows], camera)
    few = slice(None, None, GAIN_STRIDE_PX)
    gain = exposure_gain(keyframe.grey[few, few], grey[few, few])
    found_px = align_patches(keyframe.grey, grey, px, points.px, warp, gain)
    return VisiblePoints(keyframe, points.rows, found_px, T).only(np.isfinite(found_px[:, 0]))
