import numpy as np
import pytest

from vnav.core import se3
from vnav.core.trajectory import Trajectory


def test_length_is_that_of_the_way_through_the_camera_centres() -> None:
    corners = [[0, 0, 0], [3, 0, 0], [3, 4, 0]]
    way = Trajectory(np.arange(3.0), se3.make(np.eye(3), corners))
    assert way.length_m == pytest.approx(7)
    np.testing.assert_array_equal(way.positions, corners)


def test_no_poses_are_legal() -> None:
    empty = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
    assert len(empty) == 0
    assert empty.length_m == 0


@pytest.mark.parametrize("stamps", [[1.0, 1.0], [2.0, 1.0]])
def test_times_that_do_not_ascend_are_refused(stamps: list[float]) -> None:
    with pytest.raises(ValueError, match="ascending"):
        Trajectory(np.array(stamps), np.stack([np.eye(4)] * 2))
