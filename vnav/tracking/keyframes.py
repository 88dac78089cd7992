"""Which frames become keyframes, and which keyframes a frame may match: claim 3, S6."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vnav.config import OdometryConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.mapping import FrameFeatures
from vnav.features.appearance import global_descriptor
from vnav.tracking.pose_choice import TrackedFrame


def is_new_view(T_keyframe_current: Array, shared: float, config: OdometryConfig) -> bool:
    """Whether a frame sees so much else than the last keyframe that it becomes the next.

    ``shared``: matches with the last keyframe, as a share of those with the predecessor.
    """
    return bool(
        np.linalg.norm(T_keyframe_current[:3, 3]) > config.keyframe_translation_m
        or np.rad2deg(se3.rotation_angle(T_keyframe_current)) > config.keyframe_rotation_deg
        or shared < config.keyframe_min_inlier_share
    )


class Keyframes:
    """The keyframes so far, in order; their global descriptors are made when they are asked for."""

    def __init__(self, config: OdometryConfig) -> None:
        self._config = config
        self._keyframes: list[TrackedFrame] = []
        self._descriptors: list[NDArray[np.float32]] = []

    def __iter__(self) -> Iterator[TrackedFrame]:
        return iter(self._keyframes)

    @property
    def last(self) -> TrackedFrame | None:
        """The newest keyframe, None before there is one."""
        return self._keyframes[-1] if self._keyframes else None

    def append(self, frame: TrackedFrame) -> None:
        """Make a frame the newest keyframe."""
        self._keyframes.append(frame)

    def replace_last(self, frame: TrackedFrame) -> None:
        """The newest keyframe once more, with what is known of it by now."""
        self._keyframes[-1] = frame

    def recent_and_similar(self, current: FrameFeatures) -> Iterator[TrackedFrame]:
        """Keyframes before the last, newest first, then the most similar of the rest."""
        recent = self._config.recent_keyframes
        yield from reversed(self._keyframes[-1 - recent : -1])
        older = self._keyframes[: -1 - recent]
        if older:
            new = older[len(self._descriptors) :]
            self._descriptors += [global_descriptor(k.features.features) for k in new]
            similarity = np.stack(self._descriptors) @ global_descriptor(current.features)
            ranked = np.argsort(-similarity, kind="stable")
            for k in ranked[: self._config.similar_keyframes]:
                yield self._keyframes[k]
