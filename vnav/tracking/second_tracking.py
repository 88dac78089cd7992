"""Frames tracked once more when their masks are final, by what these leave: 003 S4."""

from collections.abc import Iterator, Mapping, Sequence

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.tracking.feature_tracking import FeatureTracker, is_doubtful
from vnav.tracking.frame_masks import FinalFrame, FrameMasks, SeenFrame
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.pose_choice import ChosenMotions, TrackedFrame

ROUNDS = 2  # of masks and motions
MAX_STATIC_SIGMA_M = 0.0025  # of the translation by features left, which pixels may tell better


class SecondTracker:
    """Follows the tracking by as long as a mask takes to be final, and mends its motions."""

    def __init__(self, config: Config) -> None:
        self._motion = ConstantVelocity()
        self._features = FeatureTracker(config, self._motion)
        self._min_features = config.registration.min_inliers
        self._changed: set[int] = set()
        self._last: SeenFrame | None = None
        self._row = -1

    def track(self, final: FinalFrame, edges: Sequence[Edge]) -> ChosenMotions:
        """Motions to the next frame in the place of its edges; none where these stay.

        They stay where neither its mask nor that of a frame that they are from has changed, and
        where what is left tells none.
        """
        seen = final.seen
        self._predict(seen)
        if final.is_changed:
            self._changed.add(seen.row)
        changed = self._changed & {seen.row, *(e.i for e in edges)}
        choice = self._tracked(seen.static) if changed else ChosenMotions()
        motions = {i: e.T_a_b for i, e in choice.estimates.items()}
        found = motions or {e.i: e.T_i_j for e in edges}
        likely = [e.probability for e in choice.estimates.values() or edges]
        self._motion.update(seen.row, found, max(likely, default=1.0))
        if seen.static.features.has_depth.sum() >= self._min_features:
            self._features.remember(seen.static, seen.is_keyframe, choice.estimates)
        self._row = seen.row
        return choice

    @property
    def T_track_camera(self) -> Array:
        """Pose of the frame that was tracked last."""
        return self._motion.poses[self._row]

    @property
    def begins(self) -> bool:
        """Whether the frame that was tracked last is the first of its track."""
        return len(self._motion.poses) == 1

    def _tracked(self, static: TrackedFrame) -> ChosenMotions:
        """Motions by the features that are left, or by all pixels where these tell too little."""
        choice = self._features.track_nearest(static)
        if not is_doubtful(choice, MAX_STATIC_SIGMA_M):
            return choice
        return self._features.track_pixels(static, choice)

    def _predict(self, seen: SeenFrame) -> None:
        """Expect the motion that was found before, or that of the frames before to go on."""
        self._motion.predict(seen.view.frame.stamp_s)
        if self._last is not None:
            T_track_last = self._last.view.T_track_camera
            self._motion.suggest(se3.inverse(T_track_last) @ seen.view.T_track_camera)
        self._last = seen


class SecondTracking:
    """Tracks frames again, round by round: better masks give better motions, and these masks."""

    def __init__(self, config: Config, first: FrameMasks) -> None:
        masks = [first, *(FrameMasks(config, is_first=False) for _ in range(ROUNDS - 1))]
        self._rounds = [(m, SecondTracker(config)) for m in masks]
        self.masks = masks[-1]  # that are final

    def track(self, edges: Mapping[int, Sequence[Edge]]) -> Iterator[tuple[int, ChosenMotions]]:
        """New motions to frames by their rows, in the place of the ``edges`` to them.

        They are asked for one by one, and the edges hold them before the next.
        """
        for k in range(ROUNDS):
            yield from self._track_round(k, edges)

    def end(self, edges: Mapping[int, Sequence[Edge]]) -> Iterator[tuple[int, ChosenMotions]]:
        """The same of all frames that are left."""
        for k, (masks, _) in enumerate(self._rounds):
            masks.restart()
            yield from self._track_round(k, edges)

    def _track_round(
        self, k: int, edges: Mapping[int, Sequence[Edge]]
    ) -> Iterator[tuple[int, ChosenMotions]]:
        masks, tracker = self._rounds[k]
        for final in masks.taken_final():
            choice = tracker.track(final, edges[final.seen.row])
            if choice.estimates:
                yield final.seen.row, choice
            if masks is not self.masks:
                following = self._rounds[k + 1][0]
                if tracker.begins:
                    following.restart()
                following.add(final.seen, tracker.T_track_camera, final.seen.is_keyframe)
