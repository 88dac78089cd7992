"""Two recordings that are taken out of one walk, for benchmarks/split_walks.py."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import vnav


@pytest.fixture(scope="module")
def split_walks(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("split_walks")


@pytest.mark.parametrize("number", [0, 1])
def test_two_recordings_are_all_of_a_walk_and_share_what_is_said(
    number: int, split_walks: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    whole = np.asarray(vnav.open_capture(tiny_capture).stamps_s)
    split = split_walks.SPLITS[number]
    taken = split.taken(split_walks.Source.open(tiny_capture), tmp_path / "taken")
    first, second = (set(vnav.open_capture(part).stamps_s) for part in taken)
    assert first | second == set(whole)
    assert len(first & second) == pytest.approx(0.1 * number * len(whole), abs=1)


def test_recordings_are_written_once(
    split_walks: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    source = split_walks.Source.open(tiny_capture)
    split, whole = split_walks.SPLITS[0], tmp_path / "taken"
    first, _ = split.taken(source, whole)
    (first / "kept").touch()
    split.taken(source, whole)
    assert (first / "kept").exists()
