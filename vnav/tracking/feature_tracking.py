"""Frames tracked by their features: claim 3, S2 to S5."""

import numpy as np

from vnav.config import Config
from vnav.core.camera import Intrinsics
from vnav.core.frame import PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.features.matching import DescriptorMatcher
from vnav.registration.points3d import PointRegistration
from vnav.tracking.keyframes import Keyframes
from vnav.tracking.motion import ConstantVelocity

MAX_SIGMA_M = 0.004  # of the translation; most frames' features tell their motion twice as well


class FeatureTracker:
    """Registers the current frame against earlier ones, near where the motion model puts it."""

    def __init__(self, config: Config, keyframes: Keyframes, motion: ConstantVelocity) -> None:
        self._config = config
        self._matcher = DescriptorMatcher(config.registration)
        self._keyframes = keyframes
        self._motion = motion
        self.previous: FrameFeatures | None = None

    def track(self, current: FrameFeatures, camera: Intrinsics) -> dict[int, PoseEstimate]:
        """Motions from earlier frames to the current one, by their rows; empty where none matches.

        From the last keyframe and the predecessor; else from the first of the recent and the
        similar keyframes that matches.
        """
        return self.track_nearest(current, camera) or self._track_others(current, camera)

    def track_nearest(self, current: FrameFeatures, camera: Intrinsics) -> dict[int, PoseEstimate]:
        """Motions from the last keyframe and from the predecessor, by their rows."""
        nearest = {a.row: a for a in (self._keyframes.last, self.previous) if a is not None}
        estimates = {row: self._register(a, current, camera) for row, a in nearest.items()}
        return {row: estimate for row, estimate in estimates.items() if estimate is not None}

    def _track_others(self, current: FrameFeatures, camera: Intrinsics) -> dict[int, PoseEstimate]:
        for keyframe in self._keyframes.recent_and_similar(current):
            estimate = self._register(keyframe, current, camera)
            if estimate is not None:
                return {keyframe.row: estimate}
        return {}

    def _register(
        self, target: FrameFeatures, current: FrameFeatures, camera: Intrinsics
    ) -> PoseEstimate | None:
        rng = np.random.default_rng([self._config.seed, target.row, current.row])
        pair = PointRegistration(camera, camera, self._config.registration, self._matcher)
        estimate = pair.register(target, current, rng, self._motion.predicted(target.row))
        return estimate if isinstance(estimate, PoseEstimate) else None


def are_degenerate(estimates: dict[int, PoseEstimate]) -> bool:
    """Whether none tells every direction of the translation to `MAX_SIGMA_M`, or there is none."""
    return all(
        np.linalg.inv(estimate.information)[3:, 3:].diagonal().max() > MAX_SIGMA_M**2
        for estimate in estimates.values()
    )
