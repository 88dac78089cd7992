"""Following a camera frame by frame, by its features, else by all pixels: claim 3, S3 to S6."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core import se3
from vnav.core.frame import Edge, Frame, PoseEstimate, Rejected
from vnav.core.graph import chain
from vnav.core.mapping import LOST, FrameFeatures, FrameTable, Odometry
from vnav.errors import CaptureError
from vnav.features.appearance import signature
from vnav.registration import Sensor, register
from vnav.registration.dense import DenseEstimate
from vnav.tracking.dense_tracking import LONGEST_STEP, DenseTracker

WEAK_M = 0.004  # standard deviation; most frames' features tell their motion twice as well


class VisualOdometry:
    """Follows frames one by one and keeps what the later stages need."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._keyframes: list[FrameFeatures] = []
        self._signatures: list[NDArray[np.float32]] = []
        self._previous: FrameFeatures | None = None
        self._motion = Motion()
        self._edges: list[Edge] = []
        self._dense = DenseTracker(config.odometry)
        self._degenerate_edges: list[Edge] = []
        self._reasons: dict[int, str] = {}

    def add(self, view: FrameFeatures, frame: Frame, sensor: Sensor) -> bool:
        """Follow the next frame; True where it is kept as a keyframe."""
        self._motion.approach(frame.stamp_s)
        found = self._follow(view, sensor)
        weak = _are_weak(found)
        dense = self._follow_densely(frame, sensor, found) if weak or self._dense.hanging else None
        if dense and weak:
            self._motion.expect(dense.T_a_b)
            found = self._from_nearest(view, sensor) or found
        lifted = int(view.has_depth.sum())
        featured = lifted >= sensor.config.min_inliers
        if not found and not dense and not featured:
            self.skip(view.row, f"{lifted} features with depth")
            return False
        if not found and not dense:
            self._reasons[view.row] = "no frame before it matches"
        self._join(view.row, found, dense)
        loose = bool(dense and not dense.firm and not found)
        new = featured and not loose and self._is_keyframe(view, found)
        self._dense.took(view.row, frame, loose)
        if featured:
            self._previous = view
        if new:
            self._keyframes.append(view)
            self._signatures.append(signature(view.features))
        return new

    def skip(self, row: int, reason: str) -> None:
        """Leave a frame out, and say why."""
        self._reasons[row] = reason

    def _follow(self, view: FrameFeatures, sensor: Sensor) -> dict[int, PoseEstimate]:
        """Estimates by row: last keyframe and predecessor; else recent ones; else alike ones."""
        if self._previous is None:
            return {}
        found = self._from_nearest(view, sensor)
        others = () if found else self._others(view)
        for target in others:
            estimate = self._register(target, view, sensor)
            if isinstance(estimate, PoseEstimate):
                return {target.row: estimate}
        return found

    def _from_nearest(self, view: FrameFeatures, sensor: Sensor) -> dict[int, PoseEstimate]:
        """Estimates by row, from the last keyframe and the predecessor."""
        previous = () if self._previous is None else (self._previous,)
        nearest = {k.row: k for k in (*self._keyframes[-1:], *previous)}
        return {
            target.row: estimate
            for target in nearest.values()
            if isinstance(estimate := self._register(target, view, sensor), PoseEstimate)
        }

    def _follow_densely(
        self, frame: Frame, sensor: Sensor, found: dict[int, PoseEstimate]
    ) -> DenseEstimate | None:
        """From the last frame, near where features or the motion so far put this one."""
        last = self._dense.last
        if last is None:
            return None
        predicted = found[last].T_a_b if last in found else self._motion.predicted(last)
        return self._dense.follow(frame, sensor, predicted)

    def _join(self, row: int, found: dict[int, PoseEstimate], dense: DenseEstimate | None) -> None:
        """Keep the edges of a frame, and its pose for the next."""
        edges = [Edge(i, row, e.T_a_b, e.information) for i, e in found.items()]
        loose: list[Edge] = []
        if dense is not None and self._dense.last is not None:
            edge = Edge(self._dense.last, row, dense.T_a_b, dense.information)
            (edges if dense.firm else loose).append(edge)
        self._edges += edges
        self._degenerate_edges += loose
        self._motion.follow(row, {e.i: e.T_i_j for e in edges or loose})

    def _others(self, view: FrameFeatures) -> Iterator[FrameFeatures]:
        """Recent keyframes, newest first, then the most similar of the rest."""
        recent = self._config.odometry.recent_keyframes
        yield from reversed(self._keyframes[-1 - recent : -1])
        older = self._signatures[: -1 - recent]
        if older:
            similarity = np.stack(older) @ signature(view.features)
            best = np.argsort(-similarity, kind="stable")
            for k in best[: self._config.odometry.similar_keyframes]:
                yield self._keyframes[k]

    def _register(
        self, target: FrameFeatures, view: FrameFeatures, sensor: Sensor
    ) -> PoseEstimate | Rejected:
        rng = np.random.default_rng([self._config.seed, target.row, view.row])
        return register(target, view, sensor, rng, self._motion.predicted(target.row))

    def _is_keyframe(self, view: FrameFeatures, found: dict[int, PoseEstimate]) -> bool:
        """By motion and shared view; also where the last keyframe is out of sight."""
        settings = self._config.odometry
        if not self._keyframes or self._keyframes[-1].row not in found:
            return True
        assert self._previous is not None
        to_keyframe = found[self._keyframes[-1].row]
        to_previous = found.get(self._previous.row, to_keyframe)
        moved = float(np.linalg.norm(to_keyframe.T_a_b[:3, 3]))
        turned = float(np.rad2deg(se3.rotation_angle(to_keyframe.T_a_b)))
        shared = len(to_keyframe.inliers) / len(to_previous.inliers)
        return (
            moved > settings.keyframe_translation_m
            or turned > settings.keyframe_rotation_deg
            or shared < settings.keyframe_min_inlier_share
        )

    def result(self, frames: FrameTable) -> Odometry:
        """Everything that was tracked, as segments of connected frames."""
        if not self._keyframes:
            raise CaptureError(
                f"expected frames with at least {self._config.registration.min_inliers} features"
                f" that have depth, found none in {len(frames)} frames; run 'vnav check CAPTURE'"
            )
        poses, segment = chain(len(frames), self._edges, [k.row for k in self._keyframes])
        sizes = np.bincount(segment[segment != LOST])
        alone = (segment != LOST) & (sizes[segment] == 1) & (len(frames) > 1)
        reasons = tuple(
            self._reasons.get(row, "") if segment[row] == LOST or alone[row] else ""
            for row in range(len(frames))
        )
        keyframes = tuple(self._keyframes)
        edges = tuple(e for e in self._edges if segment[e.i] != LOST)
        loose = (*self._degenerate_edges, *(e for e in self._edges if segment[e.i] == LOST))
        return Odometry(frames, poses, segment, reasons, edges, keyframes, degenerate_edges=loose)


def _are_weak(found: dict[int, PoseEstimate]) -> bool:
    """Whether no estimate tells every direction of the translation to `WEAK_M`."""
    return all(
        np.linalg.inv(estimate.information)[3:, 3:].diagonal().max() > WEAK_M**2
        for estimate in found.values()
    )


class Motion:
    """Poses since the track began, and where the next frame will be if the motion goes on."""

    def __init__(self) -> None:
        self._T_start_camera: dict[int, NDArray[np.float64]] = {}
        self._last = -1
        self._last_s = self._next_s = 0.0
        self._step, self._step_s = np.eye(4), 0.0
        self._T_last_next = np.eye(4)

    def approach(self, stamp_s: float) -> None:
        """The next frame is of this time: expect the last step again, longer after a gap."""
        self._next_s = stamp_s
        wait_s = stamp_s - self._last_s
        times = wait_s / self._step_s if self._step_s > 0 else 1.0
        self._T_last_next = _repeated(self._step, float(np.clip(times, 0.0, LONGEST_STEP)))

    def expect(self, T_last_next: NDArray[np.float64]) -> None:
        """Take this for the motion to the next frame, until that is followed."""
        self._T_last_next = T_last_next

    def follow(self, row: int, found: dict[int, NDArray[np.float64]]) -> None:
        """Add that frame by its transformations ``T_target_camera`` from others, the best first."""
        known = [(t, T) for t, T in found.items() if t in self._T_start_camera]
        if not known:
            self._T_start_camera.clear()
            pose = np.eye(4)
        else:
            pose = self._T_start_camera[known[0][0]] @ known[0][1]
        previous = self._T_start_camera.get(self._last)
        self._step = np.eye(4) if previous is None else se3.inverse(previous) @ pose
        self._step_s = self._next_s - self._last_s
        self._T_start_camera[row] = pose
        self._last, self._last_s = row, self._next_s

    def predicted(self, target: int) -> NDArray[np.float64] | None:
        """``T_target_camera`` of the next frame, None where the target is of another track."""
        if target not in self._T_start_camera:
            return None
        now = self._T_start_camera[self._last]
        return np.asarray(se3.inverse(self._T_start_camera[target]) @ now @ self._T_last_next)


def _repeated(step: NDArray[np.float64], times: float) -> NDArray[np.float64]:
    """A motion a number of times, turning and moving evenly."""
    return se3.make(se3.exp_so3(times * se3.log_so3(step[:3, :3])), times * step[:3, 3])
