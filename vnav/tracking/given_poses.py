"""Odometry whose poses come from outside: motion capture, a phone's tracker, another SLAM."""

import itertools
from collections.abc import Mapping

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.association import associate, span
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Frame
from vnav.core.mapping import LOST, FrameFeatures, FrameTable, Odometry
from vnav.core.reduced_frame import ReducedFrame
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError, TrajectoryError
from vnav.features.matching import DescriptorMatcher
from vnav.masking.depth_delay import DepthDelay, TimedFrame
from vnav.masking.view import Blocks
from vnav.registration.points3d import PointRegistration
from vnav.tracking.frame_masks import FrameMasks
from vnav.tracking.keyframes import is_new_view
from vnav.tracking.pose_choice import TrackedFrame

NO_POSE = "no pose given"
MIN_SHARE = 0.1  # of the frames: with fewer, the clocks are not the same
JUMP_M, FASTEST_M_S = 10.0, 30.0  # farther and faster no camera goes from frame to frame
SIGMAS = np.repeat([0.001, 0.001], 3)  # rad, m: of the motion between neighbours


def poses_at(stamps_s: Array, given: Trajectory, largest_s: float) -> Array:
    """The given pose (N, 4, 4), camera to world, of each frame by its time; NaN where none is.

    A pose belongs to a frame that it is less than ``largest_s`` away from, one to one; nothing is
    interpolated. TrajectoryError where hardly any frame has one.
    """
    frames, poses = associate(stamps_s, given.stamps_s, largest_s).T
    if len(frames) < MIN_SHARE * len(stamps_s) or not len(frames):
        raise TrajectoryError(
            f"expected given poses within {largest_s:g} s of the frames, found them for"
            f" {len(frames)} of {len(stamps_s)}: frames are from {span(stamps_s)}, poses from"
            f" {span(given.stamps_s)}; give both the same clock, or allow more with"
            " --set capture.association_s"
        )
    T_world_camera = np.full((len(stamps_s), 4, 4), np.nan)
    T_world_camera[frames] = given.T_world_camera[poses]
    _require_motion(stamps_s[frames], T_world_camera[frames, :3, 3])
    return T_world_camera


def _require_motion(stamps_s: Array, positions: Array) -> None:
    """TrajectoryError where no camera can have moved from a position (N, 3) to the next."""
    step_m, step_s = np.linalg.norm(np.diff(positions, axis=0), axis=1), np.abs(np.diff(stamps_s))
    jumps = np.flatnonzero(step_m > JUMP_M + FASTEST_M_S * step_s)
    if len(jumps):
        n = int(jumps[0])
        raise TrajectoryError(
            f"expected given poses that a camera can follow, found {step_m[n]:.1f} m between those"
            f" at {stamps_s[n]:.6f} and {stamps_s[n + 1]:.6f} s; leave out the one that is wrong"
        )


class GivenPoses:
    """Takes every frame's pose (N, 4, 4) as it is given, and keeps what the later stages need.

    What moves is masked by views from where the camera is when depth is measured, after a delay, by
    the frames' twists (N, 6).
    """

    def __init__(
        self, T_world_camera: Array, twists: Array, delay: DepthDelay, config: Config
    ) -> None:
        self._config = config
        self._twists, self._delay = twists, delay
        self._matcher = DescriptorMatcher(config.registration)
        self._poses = T_world_camera.copy()
        self._masks = FrameMasks(config)
        self._keyframes: list[FrameFeatures] = []
        self._previous: FrameFeatures | None = None
        without = np.flatnonzero(np.isnan(T_world_camera[:, 0, 0]))
        self._reasons = {int(row): NO_POSE for row in without}

    def add(self, features: FrameFeatures, frame: Frame, image: ReducedFrame) -> bool:
        """Take the next frame; True where it becomes a keyframe."""
        if features.row in self._reasons:
            return False
        camera, moving = frame.intrinsics, image.moving(self._twists[features.row])
        timed = TimedFrame(moving, self._poses[features.row], frame.depth_after_s)
        T_world_depth = timed.T_world_depth(self._delay)  # of an image that is not late there
        seen = self._masks.look(TrackedFrame(features, image, camera), T_world_depth)
        current = seen.static.features
        has_features = current.has_depth.sum() >= self._config.registration.min_inliers
        is_keyframe = bool(has_features) and self._is_new_view(current, camera)
        self._masks.add(seen, T_world_depth, is_keyframe)
        if has_features:
            self._previous = current
        if is_keyframe:
            self._keyframes.append(current)
        return is_keyframe

    def skip(self, row: int, reason: str) -> None:
        """Leave a frame out, and say why."""
        self._reasons.setdefault(row, reason)
        self._poses[row] = np.nan

    @property
    def moving(self) -> Mapping[int, Blocks]:
        """Blocks (h, w) of keyframes that move, by row; final with the result."""
        return self._masks.moving

    def _is_new_view(self, current: FrameFeatures, camera: Intrinsics) -> bool:
        """From the last keyframe, by motion and by what both see, as in tracking."""
        if not self._keyframes or self._previous is None:
            return True
        keyframe = self._keyframes[-1]
        matches = self._count_matches(keyframe, current, camera)
        of_previous = self._count_matches(self._previous, current, camera)
        T_keyframe_current = self._motion(keyframe, current)
        return is_new_view(T_keyframe_current, matches / max(1, of_previous), self._config.odometry)

    def _count_matches(self, a: FrameFeatures, b: FrameFeatures, camera: Intrinsics) -> int:
        """How many of a's features are found close to where the poses put them in b."""
        config = self._config.registration
        pair = PointRegistration(camera, camera, config, self._matcher)
        return len(pair.match_guided(a, b, self._motion(a, b), config.search_radius_px))

    def _motion(self, a: FrameFeatures, b: FrameFeatures) -> Array:
        return np.asarray(se3.inverse(self._poses[a.row]) @ self._poses[b.row])

    def result(self, frames: FrameTable) -> Odometry:
        """All frames that have a pose, as one segment, whose frame of reference is the world."""
        if not self._keyframes:
            raise CaptureError(
                f"expected frames with a given pose and at least"
                f" {self._config.registration.min_inliers} features that have depth, found none in"
                f" {len(frames)} frames; run 'vnav check CAPTURE'"
            )
        self._masks.restart()
        posed = np.isfinite(self._poses[:, 0, 0])
        information = np.diag(SIGMAS**-2.0)
        edges = tuple(
            Edge(i, j, se3.inverse(self._poses[i]) @ self._poses[j], information)
            for i, j in itertools.pairwise(np.flatnonzero(posed).tolist())
        )
        return Odometry(
            frames,
            self._poses,
            np.where(posed, 0, LOST).astype(np.int32),
            tuple(self._reasons.get(row, "") for row in range(len(frames))),
            edges,
            tuple(self._masks.static(keyframe) for keyframe in self._keyframes),
            given=True,
            moving_share=self._masks.shares(len(frames)),
        )
