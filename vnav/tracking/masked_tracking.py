"""Frames tracked by the features of what stands still: 003 S4."""

from dataclasses import replace

import numpy as np

from vnav.config import Config
from vnav.core.frame import Frame
from vnav.core.reduced_frame import in_pixels
from vnav.tracking.feature_tracking import FeatureTracker
from vnav.tracking.frame_masks import FrameMasks, SeenFrame
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.pose_choice import ChosenMotions, TrackedFrame

LESS_MASKED = 0.1  # share of a view: from there on, a pose is borne out by what stands still
SECOND_LOOKS = 2  # at a frame, each without what moves by the motion before


class MaskedTracker:
    """Tracks features, masks what moves by the motion found, and tracks what is left."""

    def __init__(self, config: Config, features: FeatureTracker, motion: ConstantVelocity) -> None:
        self.masks = FrameMasks(config)
        self._features, self._motion = features, motion
        self._seen: SeenFrame | None = None

    def track(
        self, current: TrackedFrame, choice: ChosenMotions
    ) -> tuple[TrackedFrame, ChosenMotions]:
        """The frame without what moves, and its motions from earlier frames.

        ``choice``: those found with all that it shows.
        """
        choice = self._less_masked(current, choice)
        still, seen = current, self._look(current, choice)
        for _ in range(SECOND_LOOKS):
            if not seen.moving.any():
                break
            chosen = self._features.track(seen.static)
            if not chosen.estimates:
                break
            still, choice, before = seen.static, chosen, seen
            seen = self._look(current, choice)
            if np.array_equal(seen.moving, before.moving):
                break
        self._seen = seen
        return still, choice

    def _less_masked(self, current: TrackedFrame, choice: ChosenMotions) -> ChosenMotions:
        """The choice, or the next pose in its place, where that leaves far less that moves.

        Two frames may leave open which it is. By a wrong one, what stands contradicts all views of
        the seconds before, and would be masked: with it goes what speaks against the pose.
        """
        if not choice.alternatives:
            return choice
        other = choice.exchanged()
        masked, less = (self._share(current, each) for each in (choice, other))
        return other if less < masked - LESS_MASKED else choice

    def _share(self, current: TrackedFrame, choice: ChosenMotions) -> float:
        """How much of a frame moves where motions take it, 1 where too much does for a mask."""
        return float(np.nan_to_num(self._look(current, choice).share, nan=1.0))

    def redescribed(self, current: TrackedFrame) -> TrackedFrame:
        """The frame that was tracked last, with other features, without those of what moves."""
        assert self._seen is not None
        self._seen = replace(self._seen, frame=current)
        return self._seen.static

    def without_moving(self, frame: Frame) -> Frame:
        """The frame that was tracked last without the depth of what moves."""
        if self._seen is None or not self._seen.moving.any():
            return frame
        moving = in_pixels(self._seen.moving, frame.depth_m.shape)
        return replace(frame, depth_m=np.where(moving, np.float32(0), frame.depth_m))

    def remember(self, row: int, is_keyframe: bool) -> None:
        """Hold later frames against the frame that was tracked last, at the pose it has now."""
        if self._seen is not None:
            self.masks.add(self._seen, self._motion.poses[row], is_keyframe)

    def _look(self, current: TrackedFrame, choice: ChosenMotions) -> SeenFrame:
        """The frame and what moves in it, where motions take it; without one nothing does."""
        poses = self._motion.poses
        found = [poses[i] @ e.T_a_b for i, e in choice.estimates.items() if i in poses]
        if not found:
            self.masks.restart()
        return self.masks.look(current, found[0] if found else np.eye(4))
