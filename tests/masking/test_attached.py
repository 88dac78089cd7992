"""A body of two surfaces, trousers and a shirt: where one has left, the other has, too."""

from dataclasses import replace

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, STEP_S, Walk, all_masks
from vnav.config import load
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.motion import MotionMask
from vnav.masking.view import Blocks, MaskedView, PosedView, still

Region = tuple[slice, slice]
WALL_M, TROUSERS_M, SHIRT_M, SOMEBODY_M = 3.0, 2.0, 2.07, 1.2
TROUSERS, SHIRT = (slice(30, 50), slice(30, 50)), (slice(10, 30), slice(30, 50))
BESIDE_SHIRT = (slice(6, 30), slice(24, 56))  # a cupboard as near as the shirt, about it
HIDDEN, FARTHER_DOWN = (slice(0, 30), slice(20, 60)), (slice(0, 38), slice(20, 60))
AGO_S = 0.4


def view(
    trousers_m: float, shirt_m: float, hidden: Region | None = None, beside_m: float = WALL_M
) -> PosedView:
    """The wall, and what is before it, by depth in metres, with the noise of blocks.

    Somebody else may have ``hidden`` a part.
    """
    depth_m = np.full((CAMERA.height, CAMERA.width), WALL_M)
    depth_m[BESIDE_SHIRT] = beside_m
    depth_m[TROUSERS], depth_m[SHIRT] = trousers_m, shirt_m
    if hidden is not None:
        depth_m[hidden] = SOMEBODY_M
    noise = 0.00035 * np.random.default_rng(0).standard_normal(depth_m.shape)
    grey = np.full(depth_m.shape, 128.0)
    frame = ReducedFrame(0.0, grey, 1 / depth_m + noise, CAMERA)
    return PosedView(frame, np.eye(4), np.zeros(depth_m.shape, bool))


def masked(
    others: list[PosedView],
    shirt_m: float = SHIRT_M,
    warp: str = "depth",
    beside_m: float = WALL_M,
) -> tuple[np.ndarray, Blocks]:
    """Times of a view in which the trousers are known to move, and what moves at all."""
    seen = view(TROUSERS_M, shirt_m, beside_m=beside_m)
    moved_s = still(seen)
    moved_s[TROUSERS] = AGO_S
    mask = MotionMask(load(settings=["masking.method=motion", f"masking.warp={warp}"]))
    found = mask.with_attached(MaskedView(seen, moved_s), others)
    return found, np.isfinite(found)


ONLY_TROUSERS_LEFT = view(WALL_M, SHIRT_M)
SHIRT_HIDDEN = view(WALL_M, WALL_M, HIDDEN)
BELT_HIDDEN = view(WALL_M, WALL_M, FARTHER_DOWN)
BOTH_IN_PLACE = view(TROUSERS_M, SHIRT_M)


def test_what_touches_a_surface_that_has_left_moves_with_it_though_it_is_hidden_then() -> None:
    moved_s, moving = masked([SHIRT_HIDDEN, BOTH_IN_PLACE])
    assert moving[SHIRT].mean() > 0.95
    assert moved_s[SHIRT][moving[SHIRT]] == pytest.approx(AGO_S)


def test_what_stands_free_moves_with_a_body_that_has_left_though_what_joins_them_is_hidden() -> (
    None
):
    _, moving = masked([BELT_HIDDEN, BOTH_IN_PLACE])
    assert moving[SHIRT].mean() > 0.95


def test_what_is_joined_to_other_things_does_not() -> None:
    _, moving = masked([BELT_HIDDEN, BOTH_IN_PLACE], beside_m=SHIRT_M + 0.07)
    assert not moving[SHIRT].any()


def test_the_wall_behind_does_not_move_with_it() -> None:
    _, moving = masked([SHIRT_HIDDEN])
    moving[TROUSERS] = moving[SHIRT] = False
    assert not moving.any()


def test_what_a_view_sees_stay_when_the_other_has_left_does_not_move() -> None:
    _, moving = masked([SHIRT_HIDDEN, ONLY_TROUSERS_LEFT])
    assert not moving[SHIRT].any()


def test_nothing_is_attached_to_what_no_view_has_seen_leave() -> None:
    _, moving = masked([BOTH_IN_PLACE])
    assert not moving[SHIRT].any()


def test_what_is_farther_off_than_a_body_is_thick_does_not_touch_it() -> None:
    _, moving = masked([SHIRT_HIDDEN], shirt_m=TROUSERS_M + 0.15)
    assert not moving[SHIRT].any()


def test_a_homography_knows_no_surfaces() -> None:
    moved_s, _ = masked([SHIRT_HIDDEN], warp="homography")
    only_trousers_s = np.full(moved_s.shape, np.float32(np.inf))
    only_trousers_s[TROUSERS] = AGO_S
    assert np.array_equal(moved_s, only_trousers_s)


def test_a_body_is_masked_whole_before_it_leaves_though_somebody_hides_half_of_it_then() -> None:
    views = [BOTH_IN_PLACE] * 30 + [SHIRT_HIDDEN] * 30
    frames = [replace(seen.frame, stamp_s=STEP_S * k) for k, seen in enumerate(views)]
    nowhere = np.zeros((CAMERA.height, CAMERA.width), bool)
    walk = Walk(frames, [np.eye(4)] * len(frames), [nowhere] * len(frames))
    moving = all_masks(walk, load(settings=["masking.method=motion"]))[1].moving
    assert min(moving[row][SHIRT].mean() for row in range(5, 30)) > 0.95
