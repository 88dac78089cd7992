"""The benchmark of repeating scenes counts what the truth contradicts."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.frame import Edge
from vnav.io.store.artifacts import load_loops, load_odometry
from vnav.io.store.map_folder import MapFolder


@pytest.fixture(scope="module")
def repeating(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("repeating")


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """T_world_frame (4, 4, 4) of a turning walk."""
    turns = se3.exp_so3(np.outer(np.arange(4), [0.1, 0.2, -0.3]))
    return se3.make(turns, np.outer(np.arange(4), [0.1, 0.02, 0.0]))


@pytest.mark.parametrize(
    ("off_m", "off_deg", "count"), [(0.0, 0.0, 0), (0.029, 0.9, 0), (0.031, 0, 1), (0, 1.1, 1)]
)
def test_an_edge_is_wrong_beyond_3_cm_or_a_degree(
    repeating: ModuleType, poses: np.ndarray, off_m: float, off_deg: float, count: int
) -> None:
    off = se3.make(se3.exp_so3([0, 0, np.deg2rad(off_deg)]), np.array([off_m, 0, 0]))
    true = se3.inverse(poses[0]) @ poses[2], se3.inverse(poses[1]) @ poses[3]
    edges = [Edge(0, 2, true[0] @ off, np.eye(6)), Edge(1, 3, true[1], np.eye(6))]
    assert repeating.wrong_edges(edges, poses) == count


def test_the_edges_of_a_sound_map_are_right(
    repeating: ModuleType, tiny_map: Path, tiny_capture: Path
) -> None:
    found = repeating.of_edges("tiny", "vnav", tiny_capture, tiny_map)
    folder = MapFolder.open(tiny_map)
    values = {m.quantity: m.value for m in found}
    assert values["odometry's edges"] == len(load_odometry(folder).edges) > 0
    accepted = [v for v in load_loops(folder, "optimise") if v.accepted]
    assert values["kept loops"] == len(accepted) > 0
    assert values["wrong edges"] == values["wrong edges kept"] == values["wrong loops"] == 0


def test_a_walk_has_as_many_frames_with_unlike_things(repeating: ModuleType) -> None:
    for scene in repeating.SCENE_NAMES:
        one, other = (repeating.spec_of(name, 1, 320) for name in (scene, f"{scene}_unlike"))
        assert one.frames == other.frames > 100
