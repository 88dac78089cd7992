"""Frames tracked once more when their masks are final, by what these leave: 003 S4."""

from collections.abc import Sequence

from vnav.config import Config
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.tracking.feature_tracking import FeatureTracker
from vnav.tracking.frame_masks import FinalFrame, SeenFrame
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.pose_choice import ChosenMotions


class SecondTracker:
    """Follows the tracking by as long as a mask takes to be final, and mends its motions."""

    def __init__(self, config: Config) -> None:
        self._motion = ConstantVelocity()
        self._features = FeatureTracker(config, self._motion)
        self._min_features = config.registration.min_inliers
        self._changed: set[int] = set()
        self._last: SeenFrame | None = None

    def track(self, final: FinalFrame, edges: Sequence[Edge]) -> ChosenMotions:
        """Motions to the next frame in the place of its edges; none where these stay.

        They stay where neither its mask nor that of a frame that they are from has changed, and
        where what is left matches nothing.
        """
        seen = final.seen
        self._predict(seen)
        if final.is_changed:
            self._changed.add(seen.row)
        changed = self._changed & {seen.row, *(e.i for e in edges)}
        choice = self._features.track_nearest(seen.static) if changed else ChosenMotions()
        motions = {i: e.T_a_b for i, e in choice.estimates.items()}
        self._motion.update(seen.row, motions or {e.i: e.T_i_j for e in edges})
        if seen.static.features.has_depth.sum() >= self._min_features:
            self._features.remember(seen.static, seen.is_keyframe)
        return choice

    def _predict(self, seen: SeenFrame) -> None:
        """Expect the motion that was found before."""
        self._motion.predict(seen.view.frame.stamp_s)
        if self._last is not None:
            T_track_last = self._last.view.T_track_camera
            self._motion.replace_prediction(se3.inverse(T_track_last) @ seen.view.T_track_camera)
        self._last = seen
