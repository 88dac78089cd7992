"""Frames described: their features, each with its 3D point where depth tells it."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array, Floats
from vnav.core.descriptor_space import UNDESCRIBED
from vnav.core.frame import Features, Frame
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import blocks_of
from vnav.features import front_end
from vnav.features.lifting import lift

NOWHERE, NOTHING = np.zeros((0, 2), np.float32), np.zeros((0, 3), np.float32)


class FrameDescriber:
    """Finds and describes features by the front-end of the settings; for several threads."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._front_end = front_end(config.features)

    def describe(self, row: int, frame: Frame) -> FrameFeatures:
        """The features of a frame, whose row in the frame table is given."""
        features = of_scene(self._front_end.extract(frame.color), frame)
        return FrameFeatures(row, features, points_of(features.keypoints_px, frame, self._config))

    def describe_coarsely(self, row: int, frame: Frame) -> FrameFeatures:
        """Those of the frame at half its size, in its own pixels; all where that is too small.

        So it is if it is narrower than the settings ask, or has too few features with depth.
        """
        least_px = self._config.features.sift.min_half_width_px
        if frame.intrinsics.width < 2 * least_px:
            return self.describe(row, frame)
        features = of_scene(doubled(self._front_end.extract(halved(frame.color))), frame)
        points = points_of(features.keypoints_px, frame, self._config)
        coarse = FrameFeatures(row, features, points, is_coarse=True)
        few = coarse.has_depth.sum() < self._config.tracking.min_points
        return self.describe(row, frame) if few else coarse


def halved(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image (H, W, 3) at half its size; a last row or column without a partner is cut."""
    height, width = (length // 2 for length in color.shape[:2])
    small = cv2.resize(
        color[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA
    )
    return np.asarray(small, np.uint8)


def doubled(features: Features) -> Features:
    """Features of an image at half its size, in the pixels of the whole one."""
    px = 2 * features.keypoints_px + np.float32(0.5)  # whole pixels' centres have whole numbers
    return replace(features, keypoints_px=px, scales_px=2 * features.scales_px)


def of_scene(features: Features, frame: Frame) -> Features:
    """Those that do not lie on what hides the scene."""
    if frame.hidden is None:
        return features
    return features[~blocks_of(frame.hidden, features.keypoints_px, frame.intrinsics.size)]


def points_of(
    keypoints_px: NDArray[np.float32], frame: Frame, config: Config
) -> NDArray[np.float32]:
    """3D points (N, 3) of keypoints (N, 2) as `lift` gives them; NaN beyond ``max_depth_m``."""
    farthest_m = config.odometry.max_depth_m
    return lift(keypoints_px, frame.depth_m, frame.intrinsics, config.registration, farthest_m)


def near_depth(depth_m: NDArray[np.float32], config: Config) -> NDArray[np.float32]:
    """Depth (H, W) without what is farther than ``max_depth_m``: 0 there."""
    return np.where(depth_m <= config.odometry.max_depth_m, depth_m, np.float32(0))


def undescribed(
    row: int, keypoints_px: Array | Floats = NOWHERE, points_camera: Array | Floats = NOTHING
) -> FrameFeatures:
    """Keypoints (N, 2) with their 3D points (N, 3) of a frame, without descriptors."""
    none = np.zeros(len(keypoints_px), np.float32)
    described = np.zeros((len(none), 0), np.uint8)
    px = keypoints_px.astype(np.float32)
    features = Features(px, described, none, none, none, UNDESCRIBED)
    return FrameFeatures(row, features, points_camera.astype(np.float32))
