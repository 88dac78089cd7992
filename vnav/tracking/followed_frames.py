"""Frames that show the points of an earlier one: only where few are left is a frame described.

A frame is followed by the points of the last described one: it has their descriptors, at the pixels
where a tracker finds them, and 3D points by its own depth. Source: 001 sections 1 and 5.
"""

from dataclasses import dataclass, replace

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Rows
from vnav.core.frame import Frame
from vnav.core.mapping import FrameFeatures
from vnav.features.description import FrameDescriber, points_of
from vnav.tracking.feature_tracking import FeatureTracker, are_degenerate, described, is_doubtful
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.pose_choice import ChosenMotions, FollowedPoints, TrackedFrame
from vnav.tracking.trackers import Tracker, tracker

CELL_PX = 20  # edge of the square of pixels of which the strongest point is followed


@dataclass(frozen=True)
class Source:
    """The frame whose points are followed, which features these are, and what finds them."""

    features: FrameFeatures
    rows: Rows
    tracker: Tracker


class FollowedFrames:
    """Gives frames the points of the last described one, or describes them."""

    def __init__(
        self,
        config: Config,
        features: FeatureTracker,
        motion: ConstantVelocity,
        describer: FrameDescriber,
    ) -> None:
        self._config, self._features, self._motion = config, features, motion
        self._describer = describer
        self.share = 1.0  # of the source's points that the last frame was found to show
        self._source: Source | None = None
        self._predecessor: tuple[TrackedFrame, Frame] | None = None  # if it was followed

    def track(self, seen: TrackedFrame, frame: Frame) -> tuple[TrackedFrame, ChosenMotions]:
        """The next frame with its features, and its motions from earlier ones.

        Followed, unless too few points are left or these leave the motion in doubt. If then the
        frame that was followed from shows too little as well, the predecessor is described, too.
        """
        current = self._followed(seen, frame)
        if current is not None:
            choice = self._features.track_nearest(current)
            if not is_doubtful(choice):
                return current, choice
        current = described(seen, frame, self._describer)
        enough = current.features.has_depth.sum() >= self._config.registration.min_inliers
        if self._predecessor is not None and enough:
            choice = self._features.track_nearest(current)
            if not are_degenerate(choice.estimates):
                return current, choice
            predecessor = described(*self._predecessor, self._describer)
            self._features.remember(predecessor, is_keyframe=False, estimates={})
        return current, self._features.track(current)

    def remember(self, current: TrackedFrame, frame: Frame) -> None:
        """Follow the points of a frame from now on, if its features are its own."""
        self._predecessor = (current, frame) if current.is_followed else None
        if not current.is_followed:
            rows = strongest_in_cells(current.features)
            found_by = tracker(frame.color, current.features.features[rows], self._config)
            self._source = Source(current.features, rows, found_by)

    def _followed(self, seen: TrackedFrame, frame: Frame) -> TrackedFrame | None:
        """A frame by the points that are found again in it, if those are enough."""
        source, motion = self._source, None
        if source is not None:
            motion = self._motion.predicted(source.features.row)
        if source is None or motion is None:
            self.share = 1.0
            return None
        points = source.features.points_camera[source.rows]
        in_camera = se3.transform(se3.inverse(motion), points)
        px = source.tracker.find(frame.color, frame.intrinsics.project(in_camera))
        found = np.isfinite(px[:, 0])
        self.share = float(found.mean()) if len(found) else 0.0
        if found.sum() < self._config.tracking.min_points:
            return None
        rows, px = source.rows[found], px[found]
        features = replace(source.features.features[rows], keypoints_px=px)
        points = points_of(px, frame, self._config)
        own = FrameFeatures(seen.features.row, features, points)
        return replace(seen, features=own, followed=FollowedPoints(source.features, rows))


def strongest_in_cells(frame: FrameFeatures) -> Rows:
    """Rows (N,) of the strongest of the features with depth in each cell of the image."""
    px, scores = frame.features.keypoints_px, frame.features.scores
    rows = np.flatnonzero(frame.has_depth)
    rows = rows[np.argsort(-scores[rows], kind="stable")]
    _, first = np.unique(px[rows] // CELL_PX, axis=0, return_index=True)
    return np.sort(rows[first])
