"""Recordings among people, who stand still as they begin or fill the view, and among things."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracking.stretches import stretch_of
from vnav.config import load
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.stages.odometry import track
from vnav.synthetic import MINIATURE, CaptureSpec
from vnav.synthetic.rendered_capture import KINECT, PHONE

pytestmark = pytest.mark.slow

DOORWAY = CaptureSpec("apartment", 300, 0, KINECT, PHONE, walkers=4, walker_share=0.35)
ROOM = CaptureSpec(
    "one_room", 150, 0, KINECT.scaled(320, 240), PHONE, seed=2, walkers=3, walker_share=0.35
)
BEFORE_A_PANEL = CaptureSpec(
    "one_room", 300, 0, KINECT, PHONE, 30.0, motion="halfsphere", thing="panel"
)
STAYING = replace(MINIATURE, frames=450, rate_hz=30.0, motion="xyz", walkers=3, walker_share=0.5)


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
    assert errors_m(walk, rows, tmp_path).max() < 0.015


def test_the_room_tells_the_motion_where_people_cover_four_fifths_of_the_view(
    tmp_path: Path,
) -> None:
    """So they do from row 356 to row 364, and walk 2 to 4 cm a frame: edges follow the room."""
    off_m = errors_m(STAYING, range(310, 376), tmp_path)
    assert np.sqrt(np.mean(off_m**2)) < 0.01


@pytest.mark.parametrize("preset", [None, "fast"])
def test_the_room_tells_the_motion_where_a_panel_slides_by_fifteen_mm_a_frame(
    tmp_path: Path, preset: str | None
) -> None:
    """4 px: a motion between its own and the camera's is within the threshold of all matches."""
    off_m = errors_m(BEFORE_A_PANEL, range(40), tmp_path, preset)
    assert np.sqrt(np.mean(off_m**2)) < 0.003


def errors_m(walk: CaptureSpec, rows: range, folder: Path, preset: str | None = None) -> Array:
    """Of the translations of odometry's edges (E,), in one segment."""
    capture, T_world_camera = stretch_of(walk, rows)
    odometry = track(capture, load(preset), folder)
    assert not odometry.segment.any()
    true = (se3.inverse(T_world_camera[e.i]) @ T_world_camera[e.j] for e in odometry.edges)
    off = [se3.inverse(T) @ e.T_i_j for T, e in zip(true, odometry.edges, strict=True)]
    return np.asarray(np.linalg.norm(np.array(off)[:, :3, 3], axis=1))
