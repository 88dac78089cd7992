from itertools import permutations

import numpy as np
import pytest

from vnav.planning.tour import cheapest_order


@pytest.mark.parametrize("visits", [1, 2, 3, 5])
def test_no_other_order_is_cheaper(visits: int) -> None:
    rng = np.random.default_rng(visits)
    for _ in range(10):
        between = rng.uniform(1, 10, (visits + 2, visits + 2))
        costs = {
            order: sum(between[a, b] for a, b in zip((0, *order), (*order, -1), strict=True))
            for order in permutations(range(1, visits + 1))
        }
        assert costs[cheapest_order(between)] == pytest.approx(min(costs.values()))


def test_nothing_to_visit_is_no_order() -> None:
    assert cheapest_order(np.zeros((2, 2))) == ()


def test_where_no_order_is_possible_all_are_kept() -> None:
    assert sorted(cheapest_order(np.full((4, 4), np.inf))) == [1, 2]
