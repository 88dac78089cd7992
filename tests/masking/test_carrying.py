"""What moves in one view, found in the views beside it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, walk
from vnav.config import load
from vnav.masking.motion import REMEMBERED_S, MotionMask
from vnav.masking.regions import MAX_SAME
from vnav.masking.view import MaskedView, PosedView, still

CONFIG = load(settings=["masking.method=motion"])


def box_at(place_m: float, stamp_s: float) -> tuple[PosedView, np.ndarray]:
    """A view of the box before the wall, and where the box is in it."""
    walked = walk(0.1, lambda _: place_m)
    frame = replace(walked.frames[0], stamp_s=stamp_s)
    return PosedView(frame, np.eye(4), np.zeros(frame.grey.shape, bool)), walked.box[0]


def moving(view: PosedView, blocks: np.ndarray, ago_s: float = 0.0) -> MaskedView:
    return MaskedView(view, np.where(blocks, np.float32(ago_s), still(view)))


@pytest.fixture(scope="module")
def mask() -> MotionMask:
    return MotionMask(CONFIG)


@pytest.mark.parametrize("step_m", [0.0, 0.1])
def test_who_moves_in_the_next_view_is_masked_where_he_stands_or_comes_from(
    mask: MotionMask, step_m: float
) -> None:
    before, box = box_at(0.0, 0.0)
    after, box_after = box_at(step_m, 0.1)
    found = mask.carried(before, moving(after, box_after), [])
    assert np.isfinite(found)[box].mean() > 0.95
    assert np.isfinite(found)[~box].mean() < 0.01


def test_it_is_known_when_he_moves_and_forgotten_after_a_while(mask: MotionMask) -> None:
    before, _ = box_at(0.0, 0.0)
    after, box = box_at(0.0, 0.5)
    found = mask.carried(before, moving(after, box, ago_s=1.0), [])
    middle = CAMERA.height // 2, CAMERA.width // 2
    assert found[middle] == pytest.approx(1.5)
    assert np.isinf(mask.carried(before, moving(after, box, ago_s=REMEMBERED_S), [])).all()


def test_what_most_views_see_stand_still_is_not_carried(mask: MotionMask) -> None:
    before, box = box_at(0.0, 0.0)
    after = [box_at(0.0, 0.1 * k)[0] for k in range(1, 4)]
    moves, rests = moving(after[0], box), [MaskedView(view, still(view)) for view in after[1:]]
    assert np.isfinite(mask.carried(before, moves, [moves, rests[0]])).any()
    assert np.isinf(mask.carried(before, moves, [moves, *rests])).all()


def test_of_a_surface_that_moves_in_part_what_many_views_see_stand_still_is_not_carried(
    mask: MotionMask,
) -> None:
    """Half of a thing moves, and a third makes a whole: but not the half that is seen to stay."""
    before, box = box_at(0.0, 0.0)
    after = [box_at(0.0, 0.1 * k)[0] for k in range(MAX_SAME + 1)]
    upper = box & (np.indices(box.shape)[0] < CAMERA.height // 2)
    moves = [moving(view, upper) for view in after]
    unseen, seen = (mask.carried(before, moves[0], witnesses) for witnesses in ([], moves))
    known = box & (before.frame.inverse_depth > 0)
    assert np.isfinite(unseen)[known].mean() > 0.95
    assert np.array_equal(np.isfinite(seen)[known], upper[known])


def test_the_wall_where_he_was_is_not_he(mask: MotionMask) -> None:
    before, box = box_at(0.0, 0.0)
    empty = walk(0.1, None).frames[0]
    wall = PosedView(replace(empty, stamp_s=0.1), np.eye(4), np.zeros(empty.grey.shape, bool))
    assert np.isinf(mask.carried(before, moving(wall, box), [])[box]).all()
