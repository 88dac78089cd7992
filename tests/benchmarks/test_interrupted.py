"""Frames that are taken out of a recording, for benchmarks/interrupted.py."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import vnav


@pytest.fixture(scope="module")
def interrupted(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("interrupted")


def test_frames_are_lost_from_a_share_on_for_so_long_and_after_another(
    interrupted: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    whole = np.asarray(vnav.open_capture(tiny_capture).stamps_s)
    lasts_s = whole[-1] - whole[0]
    gap = interrupted.Gap(0.25, 0.25 * lasts_s, 0.75)
    taken = gap.taken(interrupted.Source.open(tiny_capture), tmp_path / "taken")
    share = (np.asarray(vnav.open_capture(taken).stamps_s) - whole[0]) / lasts_s
    expected = (whole - whole[0]) / lasts_s
    expected = expected[(expected < 0.25) | ((expected >= 0.5) & (expected <= 0.75))]
    assert share == pytest.approx(expected)


def test_a_recording_is_written_once(
    interrupted: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    source, gap = interrupted.Source.open(tiny_capture), interrupted.GAPS[0]
    first = gap.taken(source, tmp_path / "taken")
    (first / "kept").touch()
    assert gap.taken(source, first) == first
    assert (first / "kept").exists()


def test_a_gap_names_what_is_lost(interrupted: ModuleType) -> None:
    assert str(interrupted.Gap(0.3, 3.0)) == "3 s lost from 30% on"
    assert str(interrupted.Gap(0.3, 1.0, 0.6)) == "1 s lost from 30% on, ends at 60%"
