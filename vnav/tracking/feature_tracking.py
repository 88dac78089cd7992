"""Frames tracked by their features: claim 3, S2 to S5."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vnav.config import Config
from vnav.core.frame import Frame, PoseEstimate
from vnav.features.description import FrameDescriber
from vnav.registration.far_features import triangulated
from vnav.tracking.keyframes import Keyframes
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.pose_choice import UNSURE, ChosenMotions, Motions, Target, TrackedFrame
from vnav.tracking.pose_search import PoseSearch

MAX_SIGMA_M = 0.004  # of the translation; most frames' features tell their motion twice as well


class FeatureTracker:
    """Registers the current frame against earlier ones, near where the motion model puts it."""

    def __init__(self, config: Config, motion: ConstantVelocity) -> None:
        self._search = PoseSearch(config)
        self._pixel_sigma_px = config.registration.pixel_sigma_px
        self._motion = motion
        self.keyframes = Keyframes(config.odometry)
        self.previous: TrackedFrame | None = None

    def track(self, current: TrackedFrame) -> ChosenMotions:
        """Motions from earlier frames to the current one; empty where none matches.

        From the last keyframe and the predecessor, which agree on one pose; else from the first of
        the recent and the similar keyframes that matches.
        """
        nearest = self.track_nearest(current)
        return nearest if nearest.estimates else self._track_others(current)

    def track_nearest(self, current: TrackedFrame) -> ChosenMotions:
        """Motions from the predecessor and from the last keyframe."""
        return self._choose(self._nearest(), current)

    def track_near(self, current: TrackedFrame, choice: ChosenMotions) -> ChosenMotions:
        """Motions to the pose that was chosen by other features of the frame, as these tell them.

        From the predecessor and from the last keyframe; empty where neither matches there.
        """
        return self._search.near(self._targets(self._nearest()), current, choice)

    def track_pixels(self, current: TrackedFrame, choice: ChosenMotions) -> ChosenMotions:
        """Motions from the predecessor and from the last keyframe, those by all pixels among them.

        ``choice``: those of features, from these frames, which are not enough to be sure.
        """
        targets, motion = self._targets(self._nearest()), self._motion
        if not targets:
            return choice
        return self._search.by_pixels(targets, current, choice, motion.expected, motion.log_prior)

    def remember(self, current: TrackedFrame, is_keyframe: bool, estimates: Motions) -> None:
        """Make the current frame the predecessor of the next, if its features are its own.

        ``estimates``: its motions from earlier frames, which tell of the features without depth.
        """
        if not current.is_followed:
            for row, estimate in estimates.items():
                current = self._triangulated(row, current, estimate)
            self.previous = current
        if is_keyframe:
            self.keyframes.append(current)

    def _triangulated(
        self, row: int, current: TrackedFrame, estimate: PoseEstimate
    ) -> TrackedFrame:
        """The current frame with what its motion from an earlier one tells of far features.

        So is the earlier one, if it is the predecessor or the last keyframe.
        """
        nearest = {a.features.row: a for a in self._nearest()}
        if row not in nearest or not len(estimate.far):
            return current
        before = nearest[row]
        known, cameras = before.features_for(current), (before.camera, current.camera)
        a, b = triangulated(known, current.features, estimate, cameras, self._pixel_sigma_px)
        told = before.knowing(a)
        if before is self.keyframes.last:
            self.keyframes.replace_last(told)
        if before is self.previous:
            self.previous = told
        return replace(current, features=b)

    def _nearest(self) -> list[TrackedFrame]:
        """The predecessor and the last keyframe, as far as they are of this track."""
        nearest = {a.features.row: a for a in (self.previous, self.keyframes.last) if a is not None}
        return [a for row, a in nearest.items() if row in self._motion.poses]

    def _track_others(self, current: TrackedFrame) -> ChosenMotions:
        for keyframe in self.keyframes.recent_and_similar(current.features):
            choice = self._choose([keyframe], current)
            if choice.estimates:
                return choice
        return ChosenMotions()

    def _choose(self, frames: Sequence[TrackedFrame], current: TrackedFrame) -> ChosenMotions:
        """Motions from frames of the track, or from a single one that is of another."""
        if not frames:
            return ChosenMotions()
        targets, poses = self._targets(frames), self._motion.poses
        if any(target.row not in poses for target in targets):
            return self._search.search(targets, current, [])
        return self._search.search(targets, current, self._motion.expected, self._motion.log_prior)

    def _targets(self, frames: Sequence[TrackedFrame]) -> list[Target]:
        poses = self._motion.poses
        return [Target(a, poses.get(a.features.row, np.eye(4))) for a in frames]


def described(seen: TrackedFrame, frame: Frame, describer: FrameDescriber) -> TrackedFrame:
    """A frame with all features of its own."""
    features = describer.describe(seen.features.row, frame)
    coarse = seen.features if seen.features.is_coarse else None
    return replace(seen, features=features, followed=None, coarse=coarse)


def is_doubtful(choice: ChosenMotions, max_sigma_m: float = MAX_SIGMA_M) -> bool:
    """Whether the motions of a frame need more features to be told."""
    return are_degenerate(choice.estimates, max_sigma_m) or choice.probability < UNSURE


def are_degenerate(estimates: Motions, max_sigma_m: float = MAX_SIGMA_M) -> bool:
    """Whether none tells every direction of the translation to so much, or there is none."""
    return all(
        np.linalg.inv(estimate.information)[3:, 3:].diagonal().max() > max_sigma_m**2
        for estimate in estimates.values()
    )
