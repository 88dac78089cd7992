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

DOORWAY = CaptureSpec("apartment", 300, 0, KINECT, PHONE, walkers=4, walker_share=0.35)
ROOM = CaptureSpec(
    "one_room", 150, 0, KINECT.scaled(320, 240), PHONE, seed=2, walkers=3, walker_share=0.35
)


@pytest.mark.parametrize(
    ("walk", "rows"),
    [
        (DOORWAY, range(80, 104)),  # two people stand there until row 92, on half of the view
        (ROOM, range(58, 90)),  # one stands until row 68, two cover two thirds of the view then
    ],
)
def test_the_room_tells_the_motion_where_people_on_half_of_the_view_walk_off(
    tmp_path: Path, walk: CaptureSpec, rows: range
) -> None:
    """Off by 1.5 cm would be a tenth of what they walk in a step, and eight times its noise."""
    capture, T_world_camera = stretch_of(walk, rows)
    odometry = track(capture, load(), tmp_path)
    assert not odometry.segment.any()
    for edge in odometry.edges:
        true = se3.inverse(T_world_camera[edge.i]) @ T_world_camera[edge.j]
        assert np.linalg.norm((se3.inverse(true) @ edge.T_i_j)[:3, 3]) < 0.015
