"""A hand-held camera pans past doorways: its shutter rolls, and its depth is late."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.tracking.stretches import stretch_of
from vnav.config import Config
from vnav.stages.odometry import track
from vnav.synthetic import HANDHELD, SCENES
from vnav.synthetic.path import frames_at

pytestmark = pytest.mark.slow

STEP_M = 0.04  # 1.2 m/s
PAST_DOORS = range(40, 110)


def test_nothing_is_masked_past_doorways_where_only_the_camera_moves(tmp_path: Path) -> None:
    """A door's edge is displaced by up to 7 blocks, and a body's region has 0.6 % of the view."""
    camera = HANDHELD.camera.scaled(320, 240)
    frames = frames_at(STEP_M, SCENES["apartment"](0).tour)
    spec = replace(HANDHELD, scene="apartment", camera=camera, frames=frames)
    capture, _ = stretch_of(spec, PAST_DOORS)

    odometry = track(capture, Config(), tmp_path)

    assert not any(odometry.reasons)
    assert odometry.moving_share.max() < 0.02
