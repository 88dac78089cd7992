"""Rooms seen by a sensor whose depth ends before the walls: a strip of floor has it, no more."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracking.stretches import stretch
from vnav.config import Config
from vnav.core import se3
from vnav.stages.odometry import track
from vnav.synthetic import Sensor

SHORT = Sensor(max_depth_m=1.8)  # a fifth of the pixels has depth


@pytest.mark.parametrize("seed", [0, 1])
def test_frames_with_little_depth_are_tracked_as_one_by_what_is_beyond_it(
    seed: int, tmp_path: Path
) -> None:
    """Off by 1 cm or 0.3 deg is twice the worst of many, and half of what the floor alone tells."""
    rows = range(30)
    capture, T_world_camera = stretch("apartment", seed, rows, SHORT)
    assert np.mean([(capture.read(row).depth_m > 0).mean() for row in rows]) < 0.3
    odometry = track(capture, Config(), tmp_path)
    assert not any(odometry.reasons)
    assert set(odometry.segment.tolist()) == {0}
    for edge in odometry.edges:
        T_true = se3.inverse(T_world_camera[edge.i]) @ T_world_camera[edge.j]
        off = se3.inverse(T_true) @ edge.T_i_j
        assert np.linalg.norm(off[:3, 3]) < 0.01, (edge.i, edge.j)
        assert np.rad2deg(se3.rotation_angle(off)) < 0.3, (edge.i, edge.j)
