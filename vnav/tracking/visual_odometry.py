"""Visual odometry: poses of frames by their features, else by all their pixels: claim 3."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Frame, PoseEstimate
from vnav.core.graph import chain
from vnav.core.mapping import LOST, FrameFeatures, FrameTable, Odometry
from vnav.errors import CaptureError
from vnav.registration.dense import DenseEstimate
from vnav.tracking.dense_tracking import DenseTracker
from vnav.tracking.feature_tracking import FeatureTracker, are_degenerate
from vnav.tracking.keyframes import Keyframes, is_new_view
from vnav.tracking.map_tracking import MapTracker
from vnav.tracking.motion import ConstantVelocity


class VisualOdometry:
    """Tracks frames one by one and keeps what the later stages need."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._motion = ConstantVelocity()
        self._keyframes = Keyframes(config.odometry)
        self._features = FeatureTracker(config, self._keyframes, self._motion)
        self._dense = DenseTracker(config)
        self._map = MapTracker(config, self._motion)
        self._edges: list[Edge] = []
        self._degenerate_edges: list[Edge] = []
        self._reasons: dict[int, str] = {}

    def add(self, current: FrameFeatures, frame: Frame, camera: Intrinsics) -> bool:
        """Track the next frame; True where it becomes a keyframe."""
        self._motion.predict(frame.stamp_s)
        estimates = self._features.track(current, camera)
        dense = self._align_where_degenerate(frame, camera, estimates)
        if dense and are_degenerate(estimates):
            estimates = self._track_near(dense, current, camera) or estimates
        count = int(current.has_depth.sum())
        has_features = count >= self._config.registration.min_inliers
        if not (estimates or dense or has_features):
            self.skip(current.row, f"{count} features with depth")
            return False
        degenerate = self._record(current.row, estimates, dense)
        self._edges += self._map.track(current.row, frame, camera)
        self._dense.remember(current.row, frame, degenerate)
        is_keyframe = has_features and not degenerate and self._is_keyframe(estimates)
        if has_features:
            self._features.previous = current
        if is_keyframe:
            self._keyframes.append(current)
            self._map.add(current, frame, estimates)
        return is_keyframe

    def skip(self, row: int, reason: str) -> None:
        """Leave a frame out, and say why."""
        self._reasons[row] = reason

    def result(self, frames: FrameTable) -> Odometry:
        """Everything that was tracked, as segments of connected frames."""
        keyframes = tuple(self._keyframes)
        if not keyframes:
            raise CaptureError(
                f"expected frames with at least {self._config.registration.min_inliers} features"
                f" that have depth, found none in {len(frames)} frames; run 'vnav check CAPTURE'"
            )
        poses, segment = chain(len(frames), self._edges, [k.row for k in keyframes])
        edges = tuple(e for e in self._edges if segment[e.i] != LOST)
        apart = tuple(e for e in self._edges if segment[e.i] == LOST)
        return Odometry(
            frames,
            poses,
            segment,
            self._reasons_of(segment),
            edges,
            keyframes,
            degenerate_edges=(*self._degenerate_edges, *apart),
        )

    def _align_where_degenerate(
        self, frame: Frame, camera: Intrinsics, estimates: dict[int, PoseEstimate]
    ) -> dict[int, DenseEstimate]:
        """The motion from the last frame by all pixels, where features leave either degenerate."""
        last = self._dense.last_row
        if last is None or not (are_degenerate(estimates) or self._dense.is_degenerate):
            return {}
        predicted = estimates[last].T_a_b if last in estimates else self._motion.predicted(last)
        return self._dense.track(frame, camera, predicted)

    def _track_near(
        self, dense: dict[int, DenseEstimate], current: FrameFeatures, camera: Intrinsics
    ) -> dict[int, PoseEstimate]:
        """By features once more, now near the motion that the pixels tell."""
        (aligned,) = dense.values()
        self._motion.replace_prediction(aligned.T_a_b)
        return self._features.track_nearest(current, camera)

    def _record(
        self, row: int, estimates: dict[int, PoseEstimate], dense: dict[int, DenseEstimate]
    ) -> bool:
        """Keep a frame's edges, and its pose for the next; True where all are degenerate."""
        constrained = {i: e for i, e in dense.items() if e.well_constrained}
        edges = [*_edges(row, estimates), *_edges(row, constrained)]
        degenerate = [] if constrained else _edges(row, dense)
        self._edges += edges
        self._degenerate_edges += degenerate
        self._motion.update(row, {e.i: e.T_i_j for e in edges or degenerate})
        if not (edges or degenerate):
            self._reasons[row] = "no frame before it matches"
        return not edges and bool(degenerate)

    def _is_keyframe(self, estimates: dict[int, PoseEstimate]) -> bool:
        """By motion and shared view; also where the last keyframe is out of sight."""
        last, previous = self._keyframes.last, self._features.previous
        if last is None or previous is None or last.row not in estimates:
            return True
        to_keyframe = estimates[last.row]
        to_previous = estimates.get(previous.row, to_keyframe)
        shared = len(to_keyframe.inliers) / len(to_previous.inliers)
        return is_new_view(to_keyframe.T_a_b, shared, self._config.odometry)

    def _reasons_of(self, segment: NDArray[np.int32]) -> tuple[str, ...]:
        """Why frames are lost or alone in their segment; empty for all others."""
        sizes = np.bincount(segment[segment != LOST])
        alone = (segment != LOST) & (sizes[segment] == 1) & (len(segment) > 1)
        return tuple(
            self._reasons.get(row, "") if lost else ""
            for row, lost in enumerate((segment == LOST) | alone)
        )


def _edges(
    row: int, estimates: Mapping[int, PoseEstimate] | Mapping[int, DenseEstimate]
) -> list[Edge]:
    """Edges to a frame from the earlier ones, whose rows the estimates have."""
    return [Edge(i, row, e.T_a_b, e.information) for i, e in estimates.items()]
