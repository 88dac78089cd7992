"""Recordings that begin among people who stand still, and then walk off."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracking.stretches import stretch_of
from vnav.config import load
from vnav.core import se3
from vnav.stages.odometry import track
from vnav.synthetic import CaptureSpec
from vnav.synthetic.rendered_capture import KINECT, PHONE

pytestmark = pytest.mark.slow

WALK = CaptureSpec("apartment", 300, 0, KINECT, PHONE, walkers=4, walker_share=0.35)
ROWS = range(80, 104)  # two people stand in a doorway until row 92, on half of the view


def test_the_room_tells_the_motion_where_people_on_half_of_the_view_walk_off(
    tmp_path: Path,
) -> None:
    """Off by 3 cm would be 30 times the noise of a step, and a third of what they walk in one."""
    capture, T_world_camera = stretch_of(WALK, ROWS)
    odometry = track(capture, load(), tmp_path)
    assert not odometry.segment.any()
    for edge in odometry.edges:
        true = se3.inverse(T_world_camera[edge.i]) @ T_world_camera[edge.j]
        assert np.linalg.norm((se3.inverse(true) @ edge.T_i_j)[:3, 3]) < 0.03
