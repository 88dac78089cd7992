"""Recordings that are drawn by seed."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.trajectory import Trajectory
from vnav.io.formats.trajectories import write_tum
from vnav.synthetic import CaptureSpec
from vnav.synthetic.staying import MOTIONS
from vnav.synthetic.things import THINGS


@pytest.fixture(scope="module")
def drawn_walks(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("drawn_walks")


@pytest.fixture(scope="module")
def specs(drawn_walks: ModuleType) -> list[CaptureSpec]:
    return [drawn_walks.drawn(seed) for seed in range(100)]


def test_a_seed_draws_one_recording(drawn_walks: ModuleType, specs: list[CaptureSpec]) -> None:
    assert [drawn_walks.drawn(seed) for seed in range(10)] == specs[:10]
    assert len(set(specs)) == len(specs)


def test_every_place_motion_and_thing_is_drawn(
    drawn_walks: ModuleType, specs: list[CaptureSpec]
) -> None:
    assert {spec.scene for spec in specs} == set(drawn_walks.PLACES)
    assert {spec.motion for spec in specs} == {"", *MOTIONS}
    assert {spec.thing for spec in specs} == {"", *THINGS}
    assert {spec.walkers for spec in specs} == {0, 1, 2, 3, 4}


def test_long_ways_are_recorded_by_fewer_frames_a_second(
    drawn_walks: ModuleType, specs: list[CaptureSpec]
) -> None:
    longest = [spec for spec in specs if spec.frames == drawn_walks.MOST_FRAMES]
    assert longest
    assert max(spec.frames for spec in specs) == drawn_walks.MOST_FRAMES
    assert all(spec.rate_hz < 30 for spec in longest)


def test_people_who_find_no_place_stay_away(
    drawn_walks: ModuleType, monkeypatch: pytest.MonkeyPatch, specs: list[CaptureSpec]
) -> None:
    alone = next(spec for spec in specs if spec.scene == "one_room" and not spec.thing)
    crowded = replace(alone, motion="", frames=30, walkers=1, walker_share=0.95)
    monkeypatch.setattr(drawn_walks, "drawn", lambda seed: crowded)
    assert drawn_walks.spec_of(alone.seed).walkers == 0


def test_a_camera_that_only_turns_is_aligned_by_its_turns(
    drawn_walks: ModuleType, tmp_path: Path
) -> None:
    """Positions, all but one, would allow any turn; a pose that is off bends nothing."""
    T_truth_map = se3.make(se3.exp_so3([0.1, -0.2, 0.9]), [1.0, 2.0, 0.5])
    turns = np.stack([np.zeros(9), np.linspace(-1, 1, 9), np.zeros(9)], 1)
    T_map_camera = se3.make(se3.exp_so3(turns), np.zeros((9, 3)))
    stamps_s = np.arange(9.0)
    true = Trajectory(stamps_s, T_truth_map @ T_map_camera)
    T_map_camera[4] = T_map_camera[4] @ se3.make(se3.exp_so3([0.3, 0, 0]), [0.2, 0, 0])
    write_tum(tmp_path / "groundtruth.txt", true)
    write_tum(tmp_path / "estimate.tum", Trajectory(stamps_s, T_map_camera))
    found = drawn_walks.T_truth_world(tmp_path, tmp_path / "estimate.tum")
    assert np.abs(found - T_truth_map).max() < 1e-6
