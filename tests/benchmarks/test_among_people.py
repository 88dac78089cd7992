"""Stretches of walks among people, each a recording of its own."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import vnav
from vnav.io.formats.trajectories import read_tum


@pytest.fixture(scope="module")
def among_people(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("among_people")


def test_stretches_cover_a_walk_from_its_first_frame_to_its_last(
    among_people: ModuleType,
) -> None:
    begins = among_people.begins_of(150)
    assert begins == [0, 25, 50, 75]
    assert begins[-1] + 150 // 2 == 150


def test_a_stretch_is_a_capture_of_those_frames_alone(
    among_people: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    part = among_people.stretch(tiny_capture, 20, 15, tmp_path / "part")
    recording, whole = vnav.open_capture(part), vnav.open_capture(tiny_capture)
    assert len(recording) == 15
    np.testing.assert_array_equal(recording.stamps_s, whole.stamps_s[20:35])
    np.testing.assert_array_equal(recording.read(0).color, whole.read(20).color)
    truth, of_whole = (read_tum(folder / "groundtruth.txt") for folder in (part, tiny_capture))
    np.testing.assert_array_equal(truth.T_world_camera, of_whole.T_world_camera[20:35])
