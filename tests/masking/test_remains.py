"""Small surfaces beside a mask: what it leaves of what moves."""

import numpy as np

from tests.masking.moving_box import CAMERA
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.regions import LEAST_SHARE
from vnav.masking.remains import REACH, remains

SHAPE = (CAMERA.height, CAMERA.width)
WALL_M, THING_M = 3.0, 2.0
MARGIN = 3  # blocks
MOVING = np.s_[5:25, 5:15]  # the mask
SMALL, LARGE = 5, int(np.ceil(np.sqrt(LEAST_SHARE * SHAPE[0] * SHAPE[1]))) + 1  # blocks, a side


def left_of(side: int, away: int) -> tuple[np.ndarray, np.ndarray]:
    """What remains where a thing so large stands so far from the mask, and where it stands."""
    moving, thing = np.zeros((2, *SHAPE), bool)
    moving[MOVING] = True
    thing[10 : 10 + side, 14 + away : 14 + away + side] = True
    depth_m = np.where(thing, THING_M, WALL_M)
    depth_m[5 - MARGIN : 25 + MARGIN, 5 - MARGIN : 15 + MARGIN] = 0
    inverse_depth = np.divide(1, depth_m, out=np.zeros(SHAPE), where=depth_m > 0)
    frame = ReducedFrame(0.0, np.zeros(SHAPE), inverse_depth, CAMERA)
    return remains(frame, moving, MARGIN), thing


def test_a_small_thing_beside_a_mask_is_all_that_remains_of_what_moves() -> None:
    left, thing = left_of(SMALL, MARGIN + 1)
    np.testing.assert_array_equal(left, thing)


def test_a_small_thing_is_beside_a_mask_as_far_as_it_reaches() -> None:
    left, thing = left_of(SMALL, MARGIN + REACH)
    assert left[thing].all()
    left, thing = left_of(SMALL, MARGIN + REACH + 1)
    assert not left[thing].any()


def test_a_thing_as_large_as_a_body_is_its_own_masks_affair() -> None:
    assert not left_of(LARGE, MARGIN + 1)[0].any()


def test_a_thing_that_reaches_into_the_margin_goes_with_what_is_left_of_it() -> None:
    left, thing = left_of(SMALL, MARGIN - 2)
    thing[:, : 15 + MARGIN] = False
    np.testing.assert_array_equal(left, thing)
