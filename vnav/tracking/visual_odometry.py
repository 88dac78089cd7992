"""Visual odometry: poses of frames by their features, else by all their pixels: claim 3."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.config.registries import DESCRIPTORS
from vnav.core.frame import Edge, Frame, PoseEstimate
from vnav.core.graph import chain
from vnav.core.mapping import LOST, FrameFeatures, FrameTable, Odometry
from vnav.core.reduced_frame import ReducedFrame
from vnav.errors import CaptureError
from vnav.features.description import FrameDescriber
from vnav.masking.view import Blocks
from vnav.registration.dense import DenseEstimate
from vnav.threads import Behind
from vnav.tracking.dense_tracking import DenseTracker
from vnav.tracking.feature_tracking import (
    MAX_SIGMA_M,
    FeatureTracker,
    are_degenerate,
    described,
    is_doubtful,
)
from vnav.tracking.followed_frames import FollowedFrames
from vnav.tracking.joint_choice import chosen_together
from vnav.tracking.keyframes import is_new_view
from vnav.tracking.map_tracking import MapTracker
from vnav.tracking.masked_tracking import MaskedTracker
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.pose_choice import ChosenMotions, Motions, Rivals, TrackedFrame
from vnav.tracking.second_tracking import SecondTracking

MAX_COARSE_SIGMA_M = 0.003  # of the translation, that all features would tell better
COARSE_SHARE = 5 / 6  # so that keyframes are as dense as by all features
TOO_MUCH = "most of what is seen moves"
REFUTED = 0.05  # probability of a motion, below which it joins nothing


class VisualOdometry:
    """Tracks frames one by one and keeps what the later stages need."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._motion = ConstantVelocity()
        self._features = FeatureTracker(config, self._motion)
        self._describer = FrameDescriber(config)
        self._followed = None
        if config.tracking.method != DESCRIPTORS:
            self._followed = FollowedFrames(config, self._features, self._motion, self._describer)
        self._masked = MaskedTracker(config, self._features, self._motion)
        self._dense = DenseTracker(config)
        self._map = MapTracker(config, self._motion)
        self._second = SecondTracking(config, self._masked.masks)
        self._behind = Behind()
        self._edges: dict[int, list[Edge]] = {}  # by the row of the frame that they lead to
        self._alternatives: dict[int, list[Edge]] = {}
        self._rivals: dict[int, Rivals | None] = {}
        self._degenerate_edges: list[Edge] = []
        self._reasons: dict[int, str] = {}

    def add(self, features: FrameFeatures, frame: Frame, image: ReducedFrame) -> bool:
        """Track the next frame; True where it becomes a keyframe."""
        self._motion.predict(frame.stamp_s)
        seen = TrackedFrame(features, image.moving(self._motion.twist), frame.intrinsics)
        current, choice = self._tracked(seen, frame)
        features, frame = current.features, self._masked.without_moving(frame)
        dense = self._align_where_degenerate(frame, choice.estimates)
        if dense and are_degenerate(choice.estimates):
            choice = self._track_near(dense, current) or choice
        count = int(features.has_depth.sum())
        has_features = count >= self._config.registration.min_inliers
        if not (choice.estimates or dense or has_features):
            self.skip(features.row, f"{count} features with depth")
            return False
        degenerate = self._record(features.row, choice, dense)
        self._edges[features.row] += self._map.track(features.row, frame, choice.probability)
        self._dense.remember(features.row, frame, degenerate)
        is_own = has_features and current.is_whole and not degenerate
        is_keyframe = is_own and self._is_keyframe(current, choice.estimates)
        if has_features:
            self._remember(current, frame, is_keyframe, choice)
        if is_keyframe:
            self._map.add(features, frame, choice.estimates)
        self._behind.start(lambda: self._look_back(features.row, is_keyframe))
        return is_keyframe

    @property
    def moving(self) -> Mapping[int, Blocks]:
        """Blocks (h, w) of keyframes that move, by row; final with the result."""
        return self._second.masks.moving

    def skip(self, row: int, reason: str) -> None:
        """Leave a frame out, and say why."""
        self._reasons[row] = reason

    def result(self, frames: FrameTable) -> Odometry:
        """Everything that was tracked, as segments of connected frames."""
        self._behind.wait()
        self._take(self._second.end(self._edges))
        tracked = self._rivals, self._edges, self._alternatives
        self._edges, self._alternatives = chosen_together(*tracked, frames.stamp_s)
        masks = self._second.masks
        moving_share = masks.shares(len(frames))
        keyframes = tuple(masks.static(k.features) for k in self._features.keyframes)
        if not keyframes:
            raise CaptureError(
                f"expected frames with at least {self._config.registration.min_inliers} features"
                f" that have depth, found none in {len(frames)} frames; run 'vnav check CAPTURE'"
            )
        found = self._borne_out(moving_share)
        poses, segment = chain(len(frames), found, [k.row for k in keyframes])
        edges = tuple(e for e in found if segment[e.i] != LOST)
        apart = tuple(e for e in found if segment[e.i] == LOST)
        others = [edge for edges in self._alternatives.values() for edge in edges]
        return Odometry(
            frames,
            poses,
            segment,
            self._reasons_of(segment),
            edges,
            keyframes,
            degenerate_edges=(*self._degenerate_edges, *apart),
            alternatives=tuple(e for e in others if segment[e.i] != LOST),
            moving_share=moving_share,
        )

    def _borne_out(self, moving_share: NDArray[np.float32]) -> list[Edge]:
        """The edges that the images do not refute; a frame that has no other is lost.

        Two frames of which too much moves for a mask tell the motion of that. A lost frame holds
        those after it only where nothing else does.
        """
        found, lost, unmasked = [], set(), np.isnan(moving_share)
        for row, edges in self._edges.items():
            likely = [e for e in edges if e.probability >= REFUTED]
            kept = [e for e in likely if not (unmasked[e.i] and unmasked[e.j])]
            kept = [e for e in kept if e.i not in lost] or kept
            if edges and not kept:
                lost.add(row)
                self._reasons[row] = TOO_MUCH if likely else "the images refute its motion"
            found += kept
        return found

    def _tracked(self, seen: TrackedFrame, frame: Frame) -> tuple[TrackedFrame, ChosenMotions]:
        """The frame without what moves, and its motions from earlier ones.

        A frame by some of its features, or by those of another, is described whole where it sees
        enough else to become a keyframe, and where what stands still leaves its motion in doubt.
        """
        tracked = self._first_tracked(seen, frame)
        self._behind.wait()
        current, choice = self._masked.track(*tracked)
        max_sigma_m = MAX_COARSE_SIGMA_M if current.features.is_coarse else MAX_SIGMA_M
        is_doubted = not current.is_whole and is_doubtful(choice, max_sigma_m)
        is_new_view = not current.is_whole and self._is_keyframe(current, choice.estimates)
        if not (is_new_view or is_doubted):
            return current, choice
        whole = self._masked.redescribed(described(seen, frame, self._describer))
        if is_doubted:
            found = self._features.track(whole)
        else:
            whole = replace(whole, is_new_view=True)
            found = self._features.track_near(whole, choice)
        return (whole, found) if found.estimates else (current, choice)

    def _first_tracked(
        self, seen: TrackedFrame, frame: Frame
    ) -> tuple[TrackedFrame, ChosenMotions]:
        """The frame by few features, or by all where those do not tell its motion."""
        if self._followed is not None:
            return self._followed.track(seen, frame)
        if seen.features.is_coarse:
            choice = self._features.track_nearest(seen)
            if not is_doubtful(choice, MAX_COARSE_SIGMA_M):
                return seen, choice
            seen = described(seen, frame, self._describer)
        return seen, self._features.track(seen)

    def _remember(
        self, current: TrackedFrame, frame: Frame, is_keyframe: bool, choice: ChosenMotions
    ) -> None:
        """Hold later frames against this one, and follow its points."""
        moving = replace(current, image=current.image.moving(self._motion.twist))
        self._features.remember(moving, is_keyframe, choice.estimates)
        if self._followed is not None:
            self._followed.remember(moving, frame)

    def _align_where_degenerate(self, frame: Frame, estimates: Motions) -> dict[int, DenseEstimate]:
        """The motion from the last frame by all pixels, where features leave either degenerate."""
        last = self._dense.last_row
        if last is None or not (are_degenerate(estimates) or self._dense.is_degenerate):
            return {}
        predicted = estimates[last].T_a_b if last in estimates else self._motion.predicted(last)
        return self._dense.track(frame, frame.intrinsics, predicted)

    def _track_near(
        self, dense: dict[int, DenseEstimate], current: TrackedFrame
    ) -> ChosenMotions | None:
        """By features once more, now near the motion that the pixels tell; None by none."""
        (aligned,) = dense.values()
        self._motion.replace_prediction(aligned.T_a_b)
        choice = self._features.track_nearest(current)
        return choice if choice.estimates else None

    def _record(self, row: int, choice: ChosenMotions, dense: dict[int, DenseEstimate]) -> bool:
        """Keep a frame's edges, and its pose for the next; True where all are degenerate."""
        constrained = {i: e for i, e in dense.items() if e.well_constrained}
        self._keep(row, choice)
        self._edges[row] += _edges(row, constrained)
        edges, degenerate = self._edges[row], [] if constrained else _edges(row, dense)
        self._degenerate_edges += degenerate
        found = {e.i: e.T_i_j for e in edges or degenerate}
        self._motion.update(row, found, choice.probability)
        if not (edges or degenerate):
            self._reasons[row] = "no frame before it matches"
        return not edges and bool(degenerate)

    def _look_back(self, row: int, is_keyframe: bool) -> None:
        """Mask earlier frames by the one that was tracked last, and track them by what is left.

        Behind the next frame's first tracking, which has nothing to do with masks.
        """
        self._masked.remember(row, is_keyframe)
        self._take(self._second.track(self._edges))

    def _take(self, found: Iterable[tuple[int, ChosenMotions]]) -> None:
        """Give frames the edges that later masks leave."""
        for row, choice in found:
            self._keep(row, choice)

    def _keep(self, row: int, choice: ChosenMotions) -> None:
        """A frame's motions by features, in the place of any before."""
        self._edges[row] = _edges(row, choice.estimates)
        self._alternatives[row] = _edges(row, choice.alternatives)
        self._rivals[row] = choice.rivals

    def _is_keyframe(self, current: TrackedFrame, estimates: Motions) -> bool:
        """By motion and shared view; also where the last keyframe is out of sight."""
        last, previous = self._features.keyframes.last, self._features.previous
        if current.is_new_view or last is None or previous is None:
            return True
        if last.features.row not in estimates:
            return True
        to_keyframe = estimates[last.features.row]
        to_previous = estimates.get(previous.features.row, to_keyframe)
        shared = to_keyframe.agreeing / to_previous.agreeing
        if current.features.is_coarse:
            shared *= COARSE_SHARE
        elif current.coarse and previous.features.is_coarse:  # which has few to be found
            shared *= len(current.coarse.features) / len(current.features.features)
        if self._followed is not None:
            shared = min(shared, self._followed.share)
        return is_new_view(to_keyframe.T_a_b, shared, self._config.odometry)

    def _reasons_of(self, segment: NDArray[np.int32]) -> tuple[str, ...]:
        """Why frames are lost or alone in their segment; empty for all others."""
        sizes = np.bincount(segment[segment != LOST])
        alone = (segment != LOST) & (sizes[segment] == 1) & (len(segment) > 1)
        return tuple(
            self._reasons.get(row, "") if lost else ""
            for row, lost in enumerate((segment == LOST) | alone)
        )


def _edges(row: int, estimates: Mapping[int, PoseEstimate | DenseEstimate]) -> list[Edge]:
    """Edges to a frame from the earlier ones, whose rows the estimates have."""
    return [Edge(i, row, e.T_a_b, e.information, e.probability) for i, e in estimates.items()]
