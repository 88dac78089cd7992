"""Regions of blocks: opened, large, grown over a body."""

import numpy as np

from tests.masking.moving_box import CAMERA
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.free_space import Votes
from vnav.masking.regions import beside, grown, large, opened

SHAPE = (CAMERA.height, CAMERA.width)


def blocks(*parts: tuple[slice, slice]) -> np.ndarray:
    made = np.zeros(SHAPE, bool)
    for part in parts:
        made[part] = True
    return made


BODY = np.s_[10:50, 30:50]
SEED = np.s_[10:20, 30:50]  # 3 % of the blocks


def frame(background_m: float, body_m: float = 2.0) -> ReducedFrame:
    depth_m = np.where(blocks(BODY), body_m, background_m)
    return ReducedFrame(0.0, np.zeros(SHAPE), 1 / depth_m, CAMERA)


def votes(same: int = 0, free: int = 0) -> Votes:
    return Votes(np.full(SHAPE, same, np.float32), np.full(SHAPE, free, np.float32))


def test_what_is_narrower_than_three_blocks_is_no_region() -> None:
    assert not opened(blocks(np.s_[10:12, :], np.s_[:, 40:42])).any()
    assert opened(blocks(np.s_[10:13, 40:43])).sum() == 9


def test_small_regions_are_dropped_one_by_one() -> None:
    kept = large(blocks(np.s_[0:3, 0:4], np.s_[20:23, 20:23]), 12)
    assert np.array_equal(kept, blocks(np.s_[0:3, 0:4]))


def test_a_region_grows_over_its_body_and_stops_at_a_step_of_depth() -> None:
    result = grown(blocks(SEED), votes(), frame(3.0))
    reached = np.flatnonzero(result[:, 40])
    assert reached[0] == 10
    assert abs((reached[-1] - 19) - 65.0 / 2.0) <= 2 or reached[-1] == 49
    assert not result[~blocks(BODY)].any()


def test_a_region_does_not_grow_into_what_many_have_seen_in_its_place() -> None:
    result = grown(blocks(SEED), votes(same=20), frame(2.01))
    assert np.array_equal(result, blocks(SEED))


def test_a_small_region_does_not_grow() -> None:
    seed = blocks(np.s_[10:15, 30:35])
    assert np.array_equal(grown(seed, votes(), frame(3.0)), seed)


def test_edges_without_depth_belong_to_the_region_they_border() -> None:
    depth = np.asarray(frame(3.0).inverse_depth).copy()
    depth[:, 50] = 0
    result = grown(blocks(BODY), votes(20), ReducedFrame(0.0, np.zeros(SHAPE), depth, CAMERA))
    assert result[10:50, 50].all()
    assert not result[:, 51:].any()


def test_of_other_regions_those_are_taken_that_touch() -> None:
    touching, apart = np.s_[15:25, 50:60], np.s_[15:25, 65:75]
    assert np.array_equal(beside(blocks(SEED), blocks(touching, apart)), blocks(touching))
