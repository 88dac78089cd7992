"""Places that repeat themselves, tracked by their images alone: no edge is off by a period."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracking.stretches import stretch
from vnav.config import Config
from vnav.core import se3
from vnav.stages.odometry import track
from vnav.tracking.pose_choice import UNSURE

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("scene", "seed", "rows"),
    [
        pytest.param("library", 1, range(30, 52), id="library, 10 Hz"),
        pytest.param("library", 1, range(27, 60, 3), id="library, every third frame"),
        pytest.param("shop", 0, range(15), id="shop, 10 Hz"),
        pytest.param("shop", 0, range(0, 45, 3), id="shop, every third frame"),
        pytest.param("twin_rooms", 0, range(90, 129, 3), id="twin rooms, every third frame"),
    ],
)
def test_every_frame_is_tracked_and_no_edge_is_off(
    scene: str, seed: int, rows: range, tmp_path: Path
) -> None:
    """Off: by 3 cm or a degree, far beyond noise and well below the shortest period, 8 cm."""
    capture, T_world_camera = stretch(scene, seed, rows)
    odometry = track(capture, Config(), tmp_path)
    assert not any(odometry.reasons)
    assert len(odometry.edges) >= len(rows) - 1
    for edge in odometry.edges:
        T_true = se3.inverse(T_world_camera[edge.i]) @ T_world_camera[edge.j]
        off = se3.inverse(T_true) @ edge.T_i_j
        assert np.linalg.norm(off[:3, 3]) < 0.03, (edge.i, edge.j)
        assert np.rad2deg(se3.rotation_angle(off)) < 1, (edge.i, edge.j)


def test_where_nothing_is_unique_a_motion_does_not_become_sure_by_going_on(tmp_path: Path) -> None:
    """Every step looks like one of a period more or less: which it was, no later step tells."""
    capture, _ = stretch("library_bare", 5, range(12))
    edges = track(capture, Config(), tmp_path).edges
    likely = {j: max(e.probability for e in edges if e.j == j) for j in {e.j for e in edges}}
    assert np.median(list(likely.values())) < UNSURE, likely
