import os
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.io.sources.open_capture import open_capture


@pytest.fixture(scope="module")
def speed(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("speed")


def test_the_first_half_of_a_capture_is_a_capture(
    speed: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    whole = open_capture(tiny_capture, CaptureConfig())
    half = open_capture(speed.first_half(tiny_capture, tmp_path / "half"), CaptureConfig())
    assert len(half) == len(whole) // 2
    np.testing.assert_array_equal(half.read(7).depth_m, whole.read(7).depth_m)


def test_what_is_asked_for_is_measured(speed: ModuleType) -> None:
    assert speed.captures(["a", "b"]) == [Path("a"), Path("b")]


def test_a_call_on_all_cores_is_timed_without_its_first_calls(speed: ModuleType) -> None:
    seen: list[int] = []

    def sleep(image: np.ndarray) -> None:
        time.sleep(0.02)
        seen.append(len(image))

    wall_ms, cpu_ms = speed.ms_a_frame(sleep, [np.zeros(3)] * 20)
    assert len(seen) == 28
    assert wall_ms * (os.cpu_count() or 1) > 19 > cpu_ms


def test_times_of_stages_are_added_up(speed: ModuleType) -> None:
    reports = {"a": {"seconds": 1.0, "cpu_seconds": 2.0}, "b": {"seconds": 3.0, "cpu_seconds": 4.0}}
    assert speed.stage_ms(reports, ["a", "b"], 100).tolist() == [40.0, 60.0]
