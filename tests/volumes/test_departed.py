"""A wall, and a board before it that stays, leaves or comes; three keyframes decide."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.volumes import departed as module
from vnav.volumes.departed import DepthHistory, seen_depth

CAMERA = Intrinsics(320, 240, 260.0, 260.0, 159.5, 119.5)
SIGMA_PER_M2, SLACK_M, NEEDED = 0.0014, 0.05, 3
BOARD_M, WALL_M, WIDTH_M = 2.0, 3.0, 0.5
RNG = np.random.default_rng(0)
SIDES_M = (0.0, 0.1, -0.1, 0.2)  # where the camera stands, to the right


def depth(board: bool, right_m: float, width_m: float = WIDTH_M, noisy: bool = True) -> np.ndarray:
    """What a camera to the right of the board's middle measures, looking at the wall."""
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    at = CAMERA.unproject(np.stack([u, v], -1), np.full(u.shape, BOARD_M))
    inside = (np.abs(at[..., 0] + right_m) < width_m / 2) & (np.abs(at[..., 1]) < 0.25)
    clean = np.where(inside & board, BOARD_M, WALL_M)
    noise = SIGMA_PER_M2 * clean**2 * RNG.standard_normal(clean.shape)
    return (clean + noise * noisy).astype(np.float32)


def history(*images: np.ndarray, off_m: float = 0.0, needed: int = NEEDED) -> DepthHistory:
    """Of images taken from SIDES_M in turn, whose poses are off to the right."""
    seen = [
        seen_depth(image, CAMERA, pose(SIDES_M[k % len(SIDES_M)] + off_m * (k > 0)))
        for k, image in enumerate(images)
    ]
    return DepthHistory(seen, SIGMA_PER_M2, SLACK_M, needed)


def pose(right_m: float) -> np.ndarray:
    return se3.make(np.eye(3), [right_m, 0, 0])


def seen(states: Sequence[bool]) -> list[np.ndarray]:
    """Images with the board and without, from SIDES_M in turn."""
    return [depth(board, SIDES_M[k % len(SIDES_M)]) for k, board in enumerate(states)]


def on_board(width_m: float = WIDTH_M) -> np.ndarray:
    """Points (N, 3) 2 cm apart."""
    x, y = np.mgrid[-width_m / 2 : width_m / 2 : 0.02, -0.25:0.25:0.02]
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, BOARD_M)], 1)


def inside(points: np.ndarray) -> np.ndarray:
    """Without the rim of the board, which may fall into the blocks around it."""
    return 0.9 * points + (0, 0, 0.1 * BOARD_M)


def departed(found: DepthHistory, points: np.ndarray, keyframe: int = 0) -> np.ndarray:
    return found.departed_since(keyframe, points, points[:, 2])


def test_what_three_later_keyframes_see_through_has_departed() -> None:
    assert departed(history(*seen([True, False, False, False])), on_board()).all()


def test_two_keyframes_are_not_enough() -> None:
    assert not departed(history(*seen([True, False, False])), on_board()).any()


def test_what_is_seen_again_stays() -> None:
    states = [True, False, False, False, True]
    assert not departed(history(*seen(states)), inside(on_board())).any()


def test_what_came_last_stays_though_many_saw_through_its_place() -> None:
    states = [False] * 8 + [True]
    assert not departed(history(*seen(states)), on_board(), keyframe=8).any()


def test_many_sightings_do_not_hold_what_has_left() -> None:
    states = [True] * 20 + [False] * 3
    assert departed(history(*seen(states)), on_board(), keyframe=7).all()


def test_the_wall_stays_when_the_board_leaves() -> None:
    found = history(*seen([True, False, False, False]))
    wall = on_board() + [1.0, 0, WALL_M - BOARD_M]
    assert not departed(found, wall).any()


@pytest.mark.parametrize("width_m", [0.5, 0.06, 0.03])
@pytest.mark.parametrize("off_m", [0.0, 0.01, -0.01])
def test_what_stays_is_not_eroded_by_poses_that_are_off(width_m: float, off_m: float) -> None:
    images = [depth(True, SIDES_M[k % 4], width_m) for k in range(9)]
    assert not departed(history(*images, off_m=off_m), on_board(width_m)).any()


def test_a_thin_thing_that_later_keyframes_have_no_depth_on_stays() -> None:
    """A sensor that triangulates loses a leg of 4 cm, and a few pixels to both sides."""
    images = [depth(True, side, 0.04, noisy=False) for side in SIDES_M]
    for image in images[1:]:
        on_leg = np.argwhere(image < WALL_M - 0.5)
        (top, left), (bottom, right) = on_leg.min(0), on_leg.max(0)
        image[top : bottom + 1, left - 3 : right + 4] = 0
    assert not departed(history(*images), inside(on_board(0.04))).any()


def test_what_lies_beyond_by_noise_only_stays() -> None:
    """A surface 10 cm before another: three sigmas of both and the slack are 14 cm at 4.6 m."""
    image = np.full((240, 320), 4.7, np.float32)
    points = on_board() * (1, 1, 0) + (0, 0, 4.6)
    assert not departed(history(*[image] * 4), points).any()


def test_nothing_departs_where_no_keyframes_are_asked_for() -> None:
    states = [True] + [False] * 6
    assert not departed(history(*seen(states), needed=0), on_board()).any()


def test_no_places_are_legal() -> None:
    assert departed(history(*seen([True, False])), np.zeros((0, 3))).shape == (0,)


def test_what_is_out_of_view_stays() -> None:
    found = history(*seen([True, False, False, False]))
    behind = on_board() * (1, 1, -1)
    assert not departed(found, behind).any()
    assert not departed(found, on_board() + [5.0, 0, 0]).any()


def asked(monkeypatch: pytest.MonkeyPatch, found: DepthHistory, points: np.ndarray) -> list[int]:
    """Which keyframes are asked what has departed of the first one's points."""
    numbers, look_back = list[int](), module._look_back

    def told(*arguments: Any) -> int:
        numbers.append(arguments[3])
        return int(look_back(*arguments))

    monkeypatch.setattr(module, "_look_back", told)
    departed(found, points)
    return numbers


def test_where_the_last_keyframe_sees_all_no_other_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = history(*seen([True] * 9))
    assert asked(monkeypatch, found, inside(on_board(0.2))) == [8]


def test_keyframes_that_are_elsewhere_are_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """They stand 20 m behind or before it, and see 3 m far."""
    found = history(*seen([True] * 3))
    for beyond in (on_board() + [0, 0, 20.0], on_board() - [0, 0, 20.0]):
        assert asked(monkeypatch, found, beyond) == []
