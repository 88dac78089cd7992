"""Poses of frames over time, between messages as tf2 gives them."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.io.recordings.ros_messages import RosTransform
from vnav.io.recordings.transform_tree import LONGEST_GAP_S, TransformTree

HAND_EYE = se3.exp(np.array([0.1, -0.2, 0.3, 0.05, 0.0, 0.1]))
TWIST = np.array([0.0, 0.0, 0.8, 1.0, 0.0, 0.0])  # a turn about z and a step along x, in a second


def tell(
    tree: TransformTree,
    stamp_s: float,
    parent: str,
    child: str,
    T: np.ndarray,
    static: bool = False,
) -> None:
    tree.add([RosTransform(round(stamp_s * 1e9), parent, child, T)], is_static=static)


def at(stamp_s: float) -> np.ndarray:
    return se3.make(se3.exp_so3(TWIST[:3] * stamp_s), TWIST[3:] * stamp_s)


@pytest.fixture
def tree() -> TransformTree:
    """map -> base, which moves by TWIST from 10 s on; base -> camera -> depth stay."""
    tree = TransformTree()
    tell(tree, 0, "base", "camera", HAND_EYE, static=True)
    tell(tree, 0, "camera", "depth", se3.make(np.eye(3), [0.02, 0, 0]), static=True)
    for k in range(5):
        tell(tree, 10 + 0.5 * k, "map", "base", at(0.5 * k))
    return tree


def test_between_two_messages_frames_are_in_between(tree: TransformTree) -> None:
    # The turn is about one axis and the step along a line, so that halves are exact.
    stamps_s = np.array([10.0, 10.25, 11.9])
    expected = [at(stamp_s - 10) @ HAND_EYE for stamp_s in stamps_s]
    np.testing.assert_allclose(tree.poses("map", "camera", stamps_s), expected, atol=1e-9)


def test_before_and_after_all_messages_nothing_is_known(tree: TransformTree) -> None:
    assert np.isnan(tree.poses("map", "camera", np.array([9.9, 12.1]))[:, :3]).all()


def test_in_a_long_gap_nothing_is_known(tree: TransformTree) -> None:
    tell(tree, 12 + LONGEST_GAP_S + 0.5, "map", "base", at(4))
    poses = tree.poses("map", "camera", np.array([12.5, 12 + LONGEST_GAP_S + 0.5]))
    assert np.isfinite(poses).all((1, 2)).tolist() == [False, True]


def test_messages_may_come_late_and_twice(tree: TransformTree) -> None:
    for stamp_s in (10.7, 10.2, 10.5):
        tell(tree, stamp_s, "map", "base", at(stamp_s - 10))
    np.testing.assert_allclose(tree.poses("map", "base", np.array([10.6]))[0], at(0.6), atol=1e-9)


def test_the_root_is_the_frame_that_all_others_hang_on(tree: TransformTree) -> None:
    assert tree.root("depth") == "map"
    assert tree.above("camera") == ["base", "map"]
    assert tree.root("nowhere") == "nowhere"


def test_only_frames_above_a_moving_one_see_a_frame_move(tree: TransformTree) -> None:
    assert tree.moves("map", "camera")
    assert not tree.moves("base", "camera")
    assert not tree.moves("depth", "camera")


def test_frames_side_by_side_are_connected(tree: TransformTree) -> None:
    tell(tree, 0, "base", "other", se3.make(np.eye(3), [0, 1, 0]), static=True)
    assert tree.knows("other", "depth")
    assert not tree.knows("other", "elsewhere")
    expected = se3.inverse(se3.make(np.eye(3), [0, 1, 0])) @ HAND_EYE
    np.testing.assert_allclose(tree.at_first("other", "camera"), expected, atol=1e-12)


def test_a_circle_of_frames_has_an_end() -> None:
    tree = TransformTree()
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a"), ("d", "d")):
        tell(tree, 0, parent, child, np.eye(4))
    assert tree.above("a") == ["c", "b"]
    assert tree.root("d") == "d"
