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


@pytest.mark.parametrize(("verdict", "ate_m"), [("good", 0.002), ("doubtful", 3.0)])
def test_a_map_that_is_right_or_called_doubtful_is_not_silent(
    short_range: ModuleType, verdict: str, ate_m: float
) -> None:
    assert not short_range.is_silent(verdict, ate_m)
    assert short_range.is_silent("good", 3.0)


def test_sensors_differ_in_their_range_alone(short_range: ModuleType) -> None:
    for spec, range_m in short_range.WALKS.values():
        kinect, short = (short_range.ranged(spec, 3, m) for m in (short_range.KINECT_M, range_m))
        assert kinect.sensor == spec.sensor
        assert short_range.ranged(short, 3, short_range.KINECT_M) == kinect
        assert short.sensor.max_depth_m < kinect.sensor.max_depth_m
