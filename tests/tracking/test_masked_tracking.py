"""Which of two poses a frame is masked at, where two frames leave that open."""

from typing import cast

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, NO_FEATURES, walk
from vnav.config import Config
from vnav.core import se3
from vnav.core.frame import PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.tracking.feature_tracking import FeatureTracker
from vnav.tracking.masked_tracking import MaskedTracker
from vnav.tracking.motion import ConstantVelocity
from vnav.tracking.pose_choice import ChosenMotions, TrackedFrame

LAST = 19
TRUE = np.eye(4)  # but for 1 cm to the side
BACK = se3.make(np.eye(3), np.array([0, 0, -0.3]))  # all views before see through the wall then
BESIDE = se3.make(np.eye(3), np.array([0.2, 0, 0]))  # of the wall, which is even


class NothingAgrees(FeatureTracker):
    """Finds no motion by what is left of a frame."""

    def track(self, _current: TrackedFrame) -> ChosenMotions:
        return ChosenMotions()


class Known(ConstantVelocity):
    """Poses of frames are those given."""

    def __init__(self, poses: list[np.ndarray]) -> None:
        super().__init__()
        self.known = dict(enumerate(poses))

    @property
    def poses(self) -> dict[int, np.ndarray]:
        return self.known


def motions(T_a_b: np.ndarray, probability: float) -> dict[int, PoseEstimate]:
    nothing = np.zeros((0, 2), np.int32)
    return {LAST - 1: PoseEstimate(T_a_b, np.eye(6), nothing, 0, probability)}


def chosen(first: np.ndarray, second: np.ndarray) -> ChosenMotions:
    """Of two motions to the last frame, the first likelier by the pixels of two frames."""
    seen, config = walk((LAST + 1) * 0.1, None), Config()
    motion = Known(seen.poses)
    tracker = MaskedTracker(config, NothingAgrees(config, motion), motion)
    camera = CAMERA.scaled(4 * CAMERA.width, 4 * CAMERA.height)
    for row, image in enumerate(seen.frames):
        frame = TrackedFrame(FrameFeatures(row, NO_FEATURES, np.zeros((0, 3))), image, camera)
        asked = ChosenMotions(motions(first, 0.8), motions(second, 0.15))
        _, choice = tracker.track(frame, asked if row == LAST else ChosenMotions())
        tracker.remember(row, is_keyframe=False)
    return cast(ChosenMotions, choice)


@pytest.mark.parametrize(("first", "second"), [(TRUE, BACK), (BACK, TRUE)])
def test_a_pose_that_all_views_before_contradict_yields_to_one_that_they_bear_out(
    first: np.ndarray, second: np.ndarray
) -> None:
    choice = chosen(first, second)
    assert choice.estimates[LAST - 1].T_a_b is TRUE
    assert choice.probability == 0.8
    assert choice.alternatives[LAST - 1].T_a_b is BACK


def test_where_no_view_tells_two_poses_apart_pixels_decide() -> None:
    assert chosen(BESIDE, TRUE).estimates[LAST - 1].T_a_b is BESIDE
