"""Odometry by a filter over the camera and its features: [000 section 3], [001 section 4]."""

from collections.abc import Mapping

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge, Frame
from vnav.core.mapping import LOST, FrameFeatures, FrameTable, Odometry
from vnav.core.reduced_frame import ReducedFrame
from vnav.errors import CaptureError
from vnav.features.description import FrameDescriber
from vnav.masking.view import Blocks
from vnav.tracking.ekf.camera_filter import CameraFilter, FilterImage, Followed
from vnav.tracking.frame_masks import FrameMasks
from vnav.tracking.keyframes import is_new_view
from vnav.tracking.pose_choice import TrackedFrame
from vnav.tracking.trackers.grey import grey_of

SIGMA_LEAST = 1e-5  # rad, m: that a motion between two frames has at least


class FilterOdometry:
    """Follows frames one by one, and keeps what the later stages need."""

    def __init__(self, config: Config) -> None:
        self._config, self._describer = config, FrameDescriber(config)
        self._masks = FrameMasks(config)
        self._rng = np.random.default_rng(config.seed)
        self._filter: CameraFilter | None = None
        self._landmarks: list[Array] = []  # (N, 3) of each segment that has ended
        self._poses: dict[int, Array] = {}  # in the first frame of its segment, by row
        self._segments: list[list[int]] = []  # rows
        self._edges: list[Edge] = []
        self._reasons: dict[int, str] = {}
        self.followed: dict[int, Followed] = {}  # what frames told but the first, by row
        self._keyframes: list[FrameFeatures] = []
        self._in_keyframe: frozenset[int] = frozenset()
        self._last_s = self._tracked_s = 0.0

    def add(self, features: FrameFeatures, frame: Frame, image: ReducedFrame) -> bool:
        """Take the next frame; True where it becomes a keyframe."""
        row, seen = features.row, _filter_image(frame, image)
        followed = self._followed(row, seen, frame.stamp_s)
        if followed is None and not self._is_waiting(frame.stamp_s):
            followed = self._begin(row, seen, frame)
        self._last_s = frame.stamp_s
        if followed is None:
            return False
        self._tracked_s = frame.stamp_s
        is_keyframe = self._is_new_view(row, followed)
        if is_keyframe:
            features = self._describer.describe(row, frame)
        return self._mask(TrackedFrame(features, image, frame.intrinsics), followed, is_keyframe)

    @property
    def moving(self) -> Mapping[int, Blocks]:
        """Blocks (h, w) of keyframes that move, by row; final with the result."""
        return self._masks.moving

    def skip(self, row: int, reason: str) -> None:
        """Leave a frame out, and say why."""
        self._reasons[row] = reason

    def result(self, frames: FrameTable) -> Odometry:
        """All frames that were followed; landmarks of the longest segment, in its first frame."""
        self._end()
        if not self._keyframes:
            raise CaptureError(self._nothing(len(frames)))
        poses, segment = np.full((len(frames), 4, 4), np.nan), np.full(len(frames), LOST)
        for number, rows in enumerate(self._segments):
            segment[rows] = number
            poses[rows] = [self._poses[row] for row in rows]
        longest = max(range(len(self._segments)), key=lambda k: len(self._segments[k]))
        return Odometry(
            frames,
            poses,
            segment.astype(np.int32),
            tuple(self._reasons.get(row, "") for row in range(len(frames))),
            tuple(self._edges),
            tuple(self._masks.static(keyframe) for keyframe in self._keyframes),
            moving_share=self._masks.shares(len(frames)),
            has_scale=self._config.tracking.has_scale,
            landmarks=self._landmarks[longest].astype(np.float32),
        )

    def _followed(self, row: int, seen: FilterImage, stamp_s: float) -> Followed | None:
        """What the filter found in a frame, and the edge to it; None where it is lost."""
        if self._filter is None:
            return None
        found = self._filter.track(seen, stamp_s - self._last_s)
        if not isinstance(found, Followed):
            self._reasons[row] = found.reason
            return None
        state, rows = self._filter.state, self._segments[-1]
        covariance = state.step_covariance + SIGMA_LEAST**2 * np.eye(6)
        information = np.asarray(np.linalg.inv(covariance))
        self._edges.append(Edge(rows[-1], row, state.T_before_camera, information))
        self._poses[row] = state.T_world_camera
        self.followed[row] = found
        rows.append(row)
        return found

    def _is_waiting(self, stamp_s: float) -> bool:
        """Whether a lost camera may still be found again."""
        lost_s = stamp_s - self._tracked_s
        return self._filter is not None and lost_s <= self._config.tracking.ekf.max_lost_s

    def _begin(self, row: int, seen: FilterImage, frame: Frame) -> Followed | None:
        """A new segment with this frame as its first; None where it has too few corners."""
        begun = CameraFilter(seen, frame.intrinsics, self._config, self._rng)
        if not begun.can_follow:
            self._reasons.setdefault(row, "too few corners")
            return None
        self._end()
        self._filter = begun
        self._reasons.pop(row, None)
        self._segments.append([row])
        self._poses[row] = np.eye(4)
        return Followed(0, 0, (), (), 0)

    def _end(self) -> None:
        """Keep the landmarks of the segment, and let go what only it may see."""
        if self._filter is not None:
            self._landmarks.append(self._filter.finish())
        self._filter = None
        self._masks.restart()

    def _is_new_view(self, row: int, followed: Followed) -> bool:
        """From the last keyframe of the segment, by motion and by the features that both show."""
        last = self._keyframes[-1].row if self._keyframes else LOST
        if last < self._segments[-1][0]:
            return True
        matched = {*followed.low, *followed.high}
        T_keyframe_current = se3.inverse(self._poses[last]) @ self._poses[row]
        shared = len(matched & self._in_keyframe) / len(matched)
        return is_new_view(T_keyframe_current, shared, self._config.odometry)

    def _mask(self, current: TrackedFrame, followed: Followed, is_keyframe: bool) -> bool:
        """Hold a followed frame against those before; True where it is a keyframe after all."""
        T_segment_camera = self._poses[current.features.row]
        seen = self._masks.look(current, T_segment_camera)
        features = seen.static.features
        if is_keyframe and self._config.tracking.ekf.depth:
            is_keyframe = features.has_depth.sum() >= self._config.registration.min_inliers
        if is_keyframe:
            assert self._filter is not None
            self._keyframes.append(features)
            self._in_keyframe = self._filter.numbers
        self._masks.add(seen, T_segment_camera, bool(is_keyframe))
        return bool(is_keyframe)

    def _nothing(self, frames: int) -> str:
        wanted = f"{self._config.tracking.ekf.min_inliers} corners"
        if self._config.tracking.ekf.depth:
            wanted += f" and {self._config.registration.min_inliers} features that have depth"
        return (
            f"expected frames with at least {wanted}, found none in {frames} frames; run 'vnav"
            " check CAPTURE'"
        )


def _filter_image(frame: Frame, image: ReducedFrame) -> FilterImage:
    return FilterImage(frame.color, grey_of(frame.color), image.grey, frame.depth_m)
