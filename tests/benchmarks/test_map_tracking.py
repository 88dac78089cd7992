"""Runs without and with the local map, summed up."""

from collections.abc import Callable
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def map_tracking(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("map_tracking")


def run(ate_m: float, time_s: float) -> dict[str, float]:
    return {"ATE": ate_m, "RPE": 0.002, "time": time_s}


def test_runs_are_summed_up_over_their_seeds(map_tracking: ModuleType) -> None:
    off, on = map_tracking.OFF, map_tracking.ON
    runs = {
        off: [run(0.010, 20.0), run(0.012, 24.0), run(0.017, 22.0)],
        on: [run(0.011, 33.0), run(0.010, 30.0), run(0.013, 36.0)],
    }
    found = {(m.quantity, m.unit): m for m in map_tracking.measured("room", on, runs)}
    assert found["ATE RMSE", "m"].value == pytest.approx(0.011)
    assert found["spread of ATE", "%"].value == pytest.approx(100 * 3 / 11)
    assert found["RPE over a frame", "mm"].value == pytest.approx(2.0)
    assert found["odometry's time, of that without", ""].value == pytest.approx(1.5)
