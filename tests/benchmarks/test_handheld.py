from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

TRUE = {"depth_delay_s": 0.02, "line_delay_s": 5e-5}


@pytest.fixture(scope="module")
def handheld(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("handheld")


def reported(depth_delay_s: float, line_delay_s: float) -> dict[str, float | None]:
    return {
        "depth_delay_s": depth_delay_s,
        "depth_delay_s_sigma": 1e-4,
        "line_delay_s": line_delay_s,
        "line_delay_s_sigma": None,
    }


def test_delays_may_be_off_by_a_tenth(handheld: ModuleType, missed: Callable[..., Any]) -> None:
    right = handheld.delays("a", "vnav", reported(0.0219, 4.6e-5), TRUE)
    assert not missed(right)
    wrong = handheld.delays("a", "vnav", reported(0.0221, 4.4e-5), TRUE)
    assert [m.quantity for m in missed(wrong)] == ["its error, ms", "its error, us"]


def test_a_still_capture_has_no_delay_at_all(
    handheld: ModuleType, missed: Callable[..., Any]
) -> None:
    none = dict.fromkeys(TRUE, 0.0)
    assert not missed(handheld.delays("a", "vnav", reported(0.0, 0.0), none))
    assert missed(handheld.delays("a", "vnav", reported(1e-4, 0.0), none))


def test_the_sensors_model_must_gain_and_lose_no_frame(
    handheld: ModuleType, missed: Callable[..., Any]
) -> None:
    def found(frames: int, off_m: float) -> list:
        values = {"frames": 300, "frames with a pose": frames, "ATE RMSE": off_m}
        return [handheld.Measurement("a", "vnav", name, value) for name, value in values.items()]

    assert not missed(handheld.wanted_of(found(300, 0.0069), 0.01))
    assert len(missed(handheld.wanted_of(found(299, 0.0071), 0.01))) == 2


def test_the_truth_is_that_of_the_rendered_sensor(handheld: ModuleType) -> None:
    assert handheld.true_delays(handheld.HANDHELD) == TRUE
    assert handheld.true_delays(handheld.DEMO) == dict.fromkeys(TRUE, 0.0)


def test_people_may_cost_half_as_much_again(
    handheld: ModuleType, missed: Callable[..., Any]
) -> None:
    def found(off_m: float) -> list:
        alone, past = (handheld.Measurement("a", "vnav", "ATE RMSE", m) for m in (0.004, off_m))
        return handheld.held_against([alone], [past])

    assert not missed(found(0.0059))
    assert missed(found(0.0061))


def test_people_walk_through_the_faster_walk_and_nothing_else_differs(
    handheld: ModuleType,
) -> None:
    alone = handheld.replace(handheld.PAST_PEOPLE, walkers=0)
    assert handheld.PAST_PEOPLE.walkers == 2
    assert alone == handheld.replace(handheld.FASTER, walker_share=alone.walker_share)
