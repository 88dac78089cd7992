import numpy as np
import pytest

from vnav.core import se3
from vnav.stages.recognise import Recognised


def at(*x_m: float) -> np.ndarray:
    """Places (N, 4, 4) along a line."""
    return np.stack([np.eye(4), *(se3.make(np.eye(3), [x, 0, 0]) for x in x_m)])[1:]


def recognised(segment: list[int], *x_m: float) -> Recognised:
    return Recognised(np.array(segment, np.int32), at(*x_m), 9, None)


def test_located_keyframes_agree_where_they_put_a_segment_in_the_same_place() -> None:
    assert recognised([0, 0, 0, 0], 1.0, 1.1, 0.9, 7.0).agreeing == 3


def test_keyframes_of_different_segments_bear_out_nothing_for_each_other() -> None:
    assert recognised([0, 1, 2], 1.0, 1.0, 1.0).agreeing == 1


def test_places_apart_do_not_agree_nor_do_turns() -> None:
    assert recognised([0, 0, 0], 1.0, 2.0, 3.0).agreeing == 1
    turned = np.stack([np.eye(4), se3.exp([0, 0, 0.5, 0, 0, 0])])
    assert Recognised(np.zeros(2, np.int32), turned, 2, None).agreeing == 1


def test_nothing_located_agrees_with_nothing() -> None:
    nothing = Recognised(np.zeros(0, np.int32), np.zeros((0, 4, 4)), 5, None)
    assert nothing.agreeing == len(nothing) == 0
    assert nothing.bears_out(np.zeros(2, np.int32), at(0.0, 1.0)).tolist() == [False, False]


def test_no_closure_is_borne_out_where_there_is_none() -> None:
    assert recognised([0], 1.0).bears_out(np.zeros(0, np.int32), np.zeros((0, 4, 4))).size == 0


@pytest.mark.parametrize(
    ("segment", "x_m", "expected"), [(0, 1.1, True), (0, 5, False), (1, 1, False)]
)
def test_a_closure_is_borne_out_by_a_keyframe_of_its_segment(
    segment: int, x_m: float, expected: bool
) -> None:
    seen = recognised([0, 0], 9.0, 1.0)
    assert seen.bears_out(np.array([segment], np.int32), at(x_m)).tolist() == [expected]
