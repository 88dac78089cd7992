"""Keypoints spread by a quadtree."""

import numpy as np

from vnav.features.spread import spread

SIZE = (640, 480)


def drawn(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    px = (rng.random((count, 2)) * SIZE).astype(np.float32)
    return px, rng.integers(7, 90, count).astype(np.float32)


def test_no_more_than_wanted_are_kept_and_nearly_as_many() -> None:
    px, responses = drawn(3000)
    kept = spread(px, responses, SIZE, 400)
    assert 380 <= len(kept) <= 400
    assert len(set(kept.tolist())) == len(kept)


def test_they_are_the_strongest_of_their_surroundings_strongest_first() -> None:
    px, responses = drawn(3000)
    kept = spread(px, responses, SIZE, 400)
    assert (np.diff(responses[kept]) <= 0).all()
    assert responses[kept].mean() > responses.mean() + 15


def test_a_corner_full_of_strong_ones_does_not_take_them_all() -> None:
    px, responses = drawn(500)
    crowd = np.random.default_rng(1).random((2500, 2)).astype(np.float32) * 60
    everything = np.concatenate([px, crowd]), np.append(responses, np.full(2500, 200, np.float32))
    kept = spread(*everything, SIZE, 300)
    assert (kept < 500).mean() > 0.7


def test_all_are_kept_where_there_are_fewer_than_wanted() -> None:
    px, responses = drawn(50)
    assert sorted(spread(px, responses, SIZE, 400)) == list(range(50))


def test_of_keypoints_in_one_place_the_strongest_is_kept() -> None:
    px = np.full((5, 2), 33.0, np.float32)
    assert spread(px, np.array([1, 5, 2, 5, 3], np.float32), SIZE, 5).tolist() == [1]


def test_the_order_of_the_keypoints_does_not_matter() -> None:
    px, responses = drawn(1000)
    shuffled = np.random.default_rng(2).permutation(1000)
    kept = px[spread(px, responses, SIZE, 100)]
    np.testing.assert_array_equal(
        px[shuffled][spread(px[shuffled], responses[shuffled], SIZE, 100)], kept
    )


def test_nothing_is_spread_of_nothing() -> None:
    assert not len(spread(np.zeros((0, 2), np.float32), np.zeros(0, np.float32), SIZE, 10))
