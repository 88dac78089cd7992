import numpy as np
from numpy.typing import NDArray

from vnav.checking.depth_edges import depth_edges


def box_before_a_wall() -> NDArray[np.float32]:
    depth_m = np.full((40, 60), 3, np.float32)
    depth_m[10:20, 25:35] = 1
    return depth_m


def test_the_rim_of_what_is_near_is_marked_on_each_side() -> None:
    right, left, below, above = depth_edges(box_before_a_wall())
    for found, rows, columns in (
        (right, slice(10, 20), slice(34, 35)),
        (left, slice(10, 20), slice(25, 26)),
        (below, slice(19, 20), slice(25, 35)),
        (above, slice(10, 11), slice(25, 35)),
    ):
        expected = np.zeros_like(found)
        expected[rows, columns] = True
        assert (found == expected).all()


def test_pixels_without_depth_beside_an_edge_are_bridged() -> None:
    depth_m = box_before_a_wall()
    depth_m[:, 16:25] = 0  # the shadow beside a near thing
    assert (depth_edges(depth_m) == depth_edges(box_before_a_wall())).all()


def test_what_borders_on_nothing_has_no_edge() -> None:
    depth_m = box_before_a_wall()
    depth_m[depth_m == 3] = 0
    assert not depth_edges(depth_m).any()


def test_a_slanted_wall_has_no_edges() -> None:
    assert not depth_edges(np.tile(np.linspace(1, 4, 60, dtype=np.float32), (40, 1))).any()
