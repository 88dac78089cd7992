"""Regions of blocks: opened, large, grown over a body."""

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.free_space import COARSE, Votes
from vnav.masking.regions import (
    MAX_SAME,
    beside,
    bodies,
    completed,
    grown,
    large,
    may_hold_bodies,
    opened,
)
from vnav.masking.view import PosedView

SHAPE = (CAMERA.height, CAMERA.width)


def blocks(*parts: tuple[slice, slice]) -> np.ndarray:
    made = np.zeros(SHAPE, bool)
    for part in parts:
        made[part] = True
    return made


BODY = np.s_[10:50, 30:50]
SEED = np.s_[10:20, 30:50]  # 3 % of the blocks
NOWHERE = np.zeros(SHAPE, bool)


def view(inverse_depth: np.ndarray) -> PosedView:
    frame = ReducedFrame(0.0, np.zeros(SHAPE), inverse_depth, CAMERA)
    return PosedView(frame, np.eye(4), np.zeros(SHAPE, bool))


def scene(background_m: float, body_m: float = 2.0) -> PosedView:
    return view(1 / np.where(blocks(BODY), body_m, background_m))


def moved(regions: np.ndarray, ago_s: float = 0.0) -> np.ndarray:
    return np.where(regions, ago_s, np.inf).astype(np.float32)


def votes(same: int = 0, seen_through: np.ndarray | None = None) -> Votes:
    free = np.zeros(SHAPE) if seen_through is None else seen_through
    return Votes(np.full(SHAPE, same, np.float32), free.astype(np.float32))


def coarsely(whole: np.ndarray) -> np.ndarray:
    """Blocks as they are told where only some rows and columns are asked."""
    coarse = np.zeros(SHAPE, bool)
    coarse[::COARSE, ::COARSE] = whole[::COARSE, ::COARSE]
    return coarse


def test_no_body_of_opened_regions_is_overlooked_where_few_blocks_are_asked() -> None:
    """Noise of any density and grain, up to the edges of the image."""
    found = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        grains = rng.random((SHAPE[0] // 4, SHAPE[1] // 4)) < rng.uniform(0.01, 0.2)
        whole = np.kron(grains, np.ones((4, 4), bool)) & (rng.random(SHAPE) < rng.uniform(0.8, 1))
        if bodies(opened(whole)).any():
            found += 1
            assert may_hold_bodies(coarsely(whole))
    assert 10 < found < 60


def test_blocks_that_are_apart_are_asked_no_further() -> None:
    assert not may_hold_bodies(blocks(np.s_[10:11, 20:21], np.s_[40:41, 20:21], np.s_[58:, 78:]))


def test_what_is_narrower_than_three_blocks_is_no_region() -> None:
    assert not opened(blocks(np.s_[10:12, :], np.s_[:, 40:42])).any()
    assert opened(blocks(np.s_[10:13, 40:43])).sum() == 9


def test_small_regions_are_dropped_one_by_one() -> None:
    kept = large(blocks(np.s_[0:3, 0:4], np.s_[20:23, 20:23]), 12)
    assert np.array_equal(kept, blocks(np.s_[0:3, 0:4]))


def test_a_region_below_six_thousandths_of_the_image_is_no_body() -> None:
    speck, body = np.s_[0:4, 0:7], np.s_[20:25, 20:26]  # 28 and 30 of 4800 blocks
    assert np.array_equal(bodies(blocks(speck, body)), blocks(body))


def test_a_region_grows_over_its_body_and_stops_at_a_step_of_depth() -> None:
    result = np.isfinite(grown(moved(blocks(SEED)), votes(seen_through=blocks(SEED)), scene(3.0)))
    assert result[BODY].all()
    assert not result[~blocks(BODY)].any()


def test_a_region_does_not_grow_into_what_many_have_seen_in_its_place() -> None:
    result = np.isfinite(grown(moved(blocks(SEED)), votes(20, blocks(SEED)), scene(2.01)))
    assert np.array_equal(result, blocks(SEED))


def test_a_region_does_not_grow_over_a_surface_that_no_view_sees_through() -> None:
    result = np.isfinite(grown(moved(blocks(SEED)), votes(), scene(3.0)))
    assert np.array_equal(result, blocks(SEED))


def test_a_surface_moves_as_a_whole_where_a_third_of_it_does() -> None:
    for rows, whole in ((13, False), (14, True)):
        part = blocks(np.s_[10 : 10 + rows, 30:50])
        result = np.isfinite(completed(moved(part), scene(3.0), NOWHERE))
        assert np.array_equal(result, blocks(BODY) if whole else part)


def test_of_a_surface_that_moves_what_many_have_seen_in_its_place_stays() -> None:
    """A panel that is pushed over a floor, and is one surface with it where they touch."""
    panel, floor = blocks(np.s_[10:30, 30:50]), blocks(np.s_[30:50, 30:50])
    same = np.where(floor, MAX_SAME + 1, 0)
    seen = Votes(same.astype(np.float32), panel.astype(np.float32))
    assert np.array_equal(np.isfinite(grown(moved(panel), seen, scene(3.0))), panel)


def test_what_a_region_grows_by_has_moved_when_the_region_has() -> None:
    result = grown(moved(blocks(SEED), ago_s=1.5), votes(0, blocks(SEED)), scene(3.0))
    assert (result[BODY] == 1.5).all()


def test_a_small_region_does_not_grow() -> None:
    seed = blocks(np.s_[10:15, 30:35])
    assert np.array_equal(np.isfinite(grown(moved(seed), votes(0, seed), scene(3.0))), seed)


def test_edges_without_depth_belong_to_the_region_they_border() -> None:
    inverse_depth = np.array(scene(3.0).frame.inverse_depth)
    inverse_depth[:, 50] = 0
    result = np.isfinite(grown(moved(blocks(BODY)), votes(20), view(inverse_depth)))
    assert result[10:50, 50].all()
    assert not result[:, 51:].any()


def test_a_body_goes_on_where_it_is_too_near_for_the_sensor() -> None:
    for body_m, rows, goes_on in ((0.6, 60, True), (0.6, 25, False), (1.2, 60, False)):
        inverse_depth = np.full(SHAPE, 1 / 3.0)
        inverse_depth[:rows, :40] = 1 / body_m
        inverse_depth[:, :20] = 0
        result = np.isfinite(completed(moved(inverse_depth > 0.5), view(inverse_depth), NOWHERE))
        assert result[:, :15].all() == goes_on


@pytest.mark.parametrize(("margin", "reaches"), [(6, True), (12, False)])
@pytest.mark.parametrize("turns", range(4))
def test_what_moves_reaches_into_a_margin_where_the_sensor_has_no_depth(
    margin: int, reaches: bool, turns: int
) -> None:
    inverse_depth = np.full(SHAPE, 1 / 3.0)
    moving = blocks(np.s_[20:40, 30:50])
    of_side, known = (np.rot90(image, turns) for image in (moving, inverse_depth))
    known[:margin] = 0
    of_side[margin : margin + 10, 25:45] = True
    of_side[:margin] = False
    result = np.isfinite(completed(moved(moving), view(inverse_depth), NOWHERE))
    side = np.rot90(result, turns)[0]
    assert side[27:43].all() == reaches
    assert not side[:20].any()


def test_of_other_regions_those_are_taken_that_touch() -> None:
    touching, apart = np.s_[15:25, 50:60], np.s_[15:25, 65:75]
    assert np.array_equal(beside(blocks(SEED), blocks(touching, apart)), blocks(touching))
