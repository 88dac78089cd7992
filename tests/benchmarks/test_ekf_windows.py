from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from vnav.core.trajectory import Trajectory
from vnav.tracking.ekf.camera_filter import Followed


@pytest.fixture(scope="module")
def ekf_windows(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("ekf_windows")


def test_draws_of_five_are_those_that_the_share_would_ask_for(ekf_windows: ModuleType) -> None:
    half = Followed(60, 40, tuple(range(20)), tuple(range(20, 30)), 7)
    window = ekf_windows.Window(None, [half, half], 0.0)
    assert ekf_windows.draws_of(window) == (7, 146)


def test_the_way_is_that_of_the_truth_through_all_frames(ekf_windows: ModuleType) -> None:
    stamps_s = np.arange(5) / 10
    poses = np.repeat(np.eye(4)[None], 5, 0)
    poses[:, 0, 3] = [0, 1, 3, 6, 10]
    truth = Trajectory(stamps_s, poses)
    assert ekf_windows.way_m(stamps_s[1:4] + 0.001, truth) == 5
