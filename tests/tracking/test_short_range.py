"""Rooms seen by a sensor whose depth ends before the walls: a strip of floor has it, no more."""

from pathlib import Path

import numpy as np
import pytest

from tests.overlays.marked import BUMPER, Marked
from tests.tracking.stretches import stretch
from vnav.config import Config
from vnav.core import se3
from vnav.core.mapping import Odometry
from vnav.overlays.overlay import without_overlay
from vnav.stages.odometry import track
from vnav.synthetic import Sensor

pytestmark = pytest.mark.slow

SHORT = Sensor(max_depth_m=1.8)  # a fifth of the pixels has depth


@pytest.mark.parametrize("seed", [0, 1])
def test_frames_with_little_depth_are_tracked_as_one_by_what_is_beyond_it(
    seed: int, tmp_path: Path
) -> None:
    """Off by 1 cm or 0.3 deg is twice the worst of many, and half of what the floor alone tells."""
    rows = range(30)
    capture, T_world_camera = stretch("apartment", seed, rows, SHORT)
    assert np.mean([(capture.read(row).depth_m > 0).mean() for row in rows]) < 0.3
    assert_tracked(track(capture, Config(), tmp_path), T_world_camera)


def test_what_moves_with_the_camera_does_not_hold_it_where_little_has_depth(tmp_path: Path) -> None:
    """A robot's bumper and text stand still in the image, which what has no depth may tell."""
    capture, T_world_camera = stretch("one_room", 0, range(30), Sensor(max_depth_m=2.5))
    seen, hidden = without_overlay(Marked(capture))
    assert hidden > 1 - BUMPER
    assert np.mean([(seen.read(row).depth_m > 0).mean() for row in range(30)]) < 0.3
    assert_tracked(track(seen, Config(), tmp_path), T_world_camera)


def assert_tracked(odometry: Odometry, T_world_camera: np.ndarray) -> None:
    """In one piece, and by no edge that is off."""
    assert not any(odometry.reasons)
    assert set(odometry.segment.tolist()) == {0}
    for edge in odometry.edges:
        T_true = se3.inverse(T_world_camera[edge.i]) @ T_world_camera[edge.j]
        off = se3.inverse(T_true) @ edge.T_i_j
        assert np.linalg.norm(off[:3, 3]) < 0.01, (edge.i, edge.j)
        assert np.rad2deg(se3.rotation_angle(off)) < 0.3, (edge.i, edge.j)
