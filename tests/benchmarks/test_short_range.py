from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture(scope="module")
def short_range(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("short_range")


def test_a_map_may_be_off_by_a_centimetre(
    short_range: ModuleType, missed: Callable[..., Any]
) -> None:
    ate = [short_range.Measurement("a", "vnav", "ATE RMSE", off_m, "m") for off_m in (0.009, 0.011)]
    assert [m.value for m in missed(short_range.held_to(ate))] == [0.011]


def test_sensors_differ_in_their_range_alone(short_range: ModuleType) -> None:
    for spec, range_m in short_range.WALKS.values():
        kinect, short = (short_range.ranged(spec, 3, m) for m in (short_range.KINECT_M, range_m))
        assert kinect.sensor == spec.sensor
        assert short_range.ranged(short, 3, short_range.KINECT_M) == kinect
        assert short.sensor.max_depth_m < kinect.sensor.max_depth_m
