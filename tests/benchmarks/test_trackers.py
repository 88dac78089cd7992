from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from vnav.evaluation.tracker_matches import TrackerMatches


@pytest.fixture(scope="module")
def trackers(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("trackers")


def matches(found: list[float], true: list[float], ms: float) -> TrackerMatches:
    """Points on a line, found and to be found at these columns, NaN where not."""
    at = [np.stack([x, np.zeros(len(found))], 1) for x in (np.array(found), np.array(true))]
    for px in at:
        px[np.isnan(px[:, 0])] = np.nan
    return TrackerMatches("klt", np.zeros((len(found), 2)), at[0], at[1], 10 * ms, ms)


def test_shares_are_of_all_pairs_together_and_times_are_medians(trackers: ModuleType) -> None:
    nan = np.nan
    pairs = [
        matches([5.0, 9.0, nan, 40.0], [5.0, 20.0, 30.0, 41.0], 2.0),  # 2 of 3 right, 4 seen
        matches([7.0], [7.5], 4.0),
        matches([nan], [nan], 9.0),
    ]
    told = {m.quantity: m.value for m in trackers.of_tracker("house", "klt", pairs)}
    assert told["precision"] == pytest.approx(3 / 4)
    assert told["recall"] == pytest.approx(3 / 5)
    assert told["CPU time a frame"] == 4.0
    assert told["CPU time for the first frame"] == 40.0
