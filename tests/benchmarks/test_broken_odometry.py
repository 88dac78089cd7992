from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from vnav.core.mapping import Odometry


@pytest.fixture(scope="module")
def broken_odometry(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("broken_odometry")


def test_broken_edges_are_shifted_and_as_sure_as_before(
    broken_odometry: ModuleType, odometry: Odometry
) -> None:
    changed, wrong = broken_odometry.broken(odometry, 3, np.random.default_rng(0))
    assert len(wrong) == 3
    pairs = list(zip(odometry.edges, changed.edges, strict=True))
    moved = [(a, b) for a, b in pairs if not broken_odometry.same(a, b)]
    assert [b for _, b in moved] == wrong
    for a, b in moved:
        assert (a.i, a.j) == (b.i, b.j)
        assert 0.05 <= np.linalg.norm(a.T_i_j[:3, 3] - b.T_i_j[:3, 3]) <= 0.30
        np.testing.assert_array_equal(a.information, b.information)
    assert not np.array_equal(changed.T_segment_camera, odometry.T_segment_camera)
