"""The keyframes that the current frame sees again, and their map points: 003 cl.3, S21 to S24."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.depth_planes import depth_noise
from vnav.core.frame import Frame, PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.registration.image_filters import SURFACE_REACH_PX, fitted_surface

MAX_REFERENCES = 10  # m of S21
MIN_COVISIBILITY = 15  # map points that a keyframe shares with the newest, as in ORB-SLAM
CELL_PX = 32  # edge of a cell, of which one point is taken
BORDER_PX = 8  # of the image, where no patch fits


@dataclass(frozen=True)
class MapKeyframe:
    """A keyframe with its brightness and its map points.

    ``grey`` (H, W); ``point`` (N,): number of each feature's map point; ``surface``
    (N, 3): inverse depth in 1/m at the feature and its slopes along u and v, NaN without depth.
    """

    frame: FrameFeatures
    grey: Array
    point: NDArray[np.intp]
    surface: Array

    @property
    def row(self) -> int:
        """In the frame table."""
        return self.frame.row


@dataclass(frozen=True)
class VisiblePoints:
    """Features (M,) of a keyframe, by row, and the pixels (M, 2) where a camera should see them."""

    keyframe: MapKeyframe
    rows: NDArray[np.intp]
    px: Array
    T_camera_keyframe: Array

    def only(self, which: NDArray[np.bool_]) -> "VisiblePoints":
        """Those of them (M,) that are wanted."""
        return VisiblePoints(
            self.keyframe, self.rows[which], self.px[which], self.T_camera_keyframe
        )


class LocalMap:
    """The newest keyframe, those that share map points with it, and how often each was matched."""

    def __init__(self, depth_sigma_per_m2: float) -> None:
        self._depth_sigma = depth_sigma_per_m2
        self._matched = np.zeros(0, np.intp)
        self.keyframes: list[MapKeyframe] = []

    def add(
        self, keyframe: FrameFeatures, frame: Frame, estimates: Mapping[int, PoseEstimate]
    ) -> None:
        """Take a new keyframe, whose motions from earlier frames are given by their rows.

        Their inliers see the map points of the earlier keyframes, other features are new points.
        Keyframes that share too few points with the new one are let go.
        """
        point = len(self._matched) + np.arange(len(keyframe.features))
        for earlier in self.keyframes:
            if earlier.row in estimates:
                theirs, its = estimates[earlier.row].inliers.T
                point[its] = earlier.point[theirs]
        self._matched = np.concatenate([self._matched, np.zeros_like(point)])
        self._matched[point] += 1
        new = MapKeyframe(keyframe, grey_image(frame), point, self._surface(keyframe, frame))
        self.keyframes = [k for k in self.keyframes if covisibility(k, new) >= MIN_COVISIBILITY]
        self.keyframes.append(new)

    def visible(
        self, T_camera_keyframe: Mapping[int, Array], camera: Intrinsics
    ) -> list[VisiblePoints]:
        """Points that a camera should see, one a cell, by keyframe, the nearest first.

        ``T_camera_keyframe``: how the camera stands to keyframes, by their rows; the others are
        left out. Of the ten with most points in view, each cell has the point that was matched
        most often, as the nearest of the keyframes that saw it shows it: S21 to S24.
        """
        seen = [
            _projected(keyframe, T_camera_keyframe[keyframe.row], camera)
            for keyframe in self.keyframes
            if keyframe.row in T_camera_keyframe
        ]
        references = sorted(seen, key=lambda s: -len(s.rows))[:MAX_REFERENCES]
        return self._one_a_cell(sorted(references, key=_distance_m))

    def count_matched(self, keyframe: MapKeyframe, rows: NDArray[np.intp]) -> None:
        """Map points, by rows of a keyframe's features, were matched once more."""
        self._matched[keyframe.point[rows]] += 1

    def _one_a_cell(self, nearest_first: Sequence[VisiblePoints]) -> list[VisiblePoints]:
        if not nearest_first:
            return []
        px = np.concatenate([s.px for s in nearest_first])
        point = np.concatenate([s.keyframe.point[s.rows] for s in nearest_first])
        _, sighting = np.unique(point, return_index=True)  # each point's first is the nearest
        best_first = sighting[np.lexsort((sighting, -self._matched[point[sighting]]))]
        _, in_cell = np.unique(px[best_first] // CELL_PX, axis=0, return_index=True)
        chosen = np.isin(np.arange(len(px)), best_first[in_cell])
        ends = np.cumsum([len(s.rows) for s in nearest_first])[:-1]
        parts = zip(nearest_first, np.split(chosen, ends), strict=True)
        return [s.only(which) for s, which in parts if which.any()]

    def _surface(self, keyframe: FrameFeatures, frame: Frame) -> Array:
        """Of each feature's 3D point; it faces the camera where it is too rough for a plane."""
        x, y = np.rint(keyframe.features.keypoints_px).astype(np.intp).T
        sigma = max(self._depth_sigma, depth_noise(frame.depth_m, SURFACE_REACH_PX))
        slopes = fitted_surface(frame.depth_m, sigma, SURFACE_REACH_PX)[y, x, 1:]
        inverse_depth = 1 / keyframe.points_camera[:, 2:].astype(np.float64)
        return np.concatenate([inverse_depth, np.nan_to_num(slopes)], 1)


def grey_image(frame: Frame) -> Array:
    """Brightness (H, W) of a frame."""
    return np.asarray(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY), np.float64)


def covisibility(a: MapKeyframe, b: MapKeyframe) -> int:
    """Number of map points that both see: 003 S2."""
    return int(np.isin(a.point, b.point).sum())


def _projected(
    keyframe: MapKeyframe, T_camera_keyframe: Array, camera: Intrinsics
) -> VisiblePoints:
    """The keyframe's points that fall into the image: S22."""
    px = camera.project(se3.transform(T_camera_keyframe, keyframe.frame.points_camera))
    limit_px = np.array(camera.size) - 1 - BORDER_PX
    inside = ((px >= BORDER_PX) & (px <= limit_px)).all(1)  # false for NaN
    return VisiblePoints(keyframe, np.flatnonzero(inside), px[inside], T_camera_keyframe)


def _distance_m(seen: VisiblePoints) -> float:
    """Between the two cameras."""
    return float(np.linalg.norm(seen.T_camera_keyframe[:3, 3]))
