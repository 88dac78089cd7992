from pathlib import Path

import numpy as np

from vnav.io.frame_list import FrameList, FramePair, ImageFile, associate, paired


def as_tum_does(a: np.ndarray, b: np.ndarray, largest_s: float) -> list[tuple[int, int]]:
    """The benchmark's associate.py, told plainly: all pairs, smallest difference first."""
    differences = np.abs(a[:, None] - b)
    rows = sorted(np.argwhere(differences < largest_s).tolist(), key=lambda ij: differences[*ij])
    matches: list[tuple[int, int]] = []
    for i, j in rows:
        if all(i != k and j != m for k, m in matches):
            matches.append((i, j))
    return sorted(matches)


def images(stamps: list[float], kind: str) -> list[ImageFile]:
    return [ImageFile(stamp, Path(f"{kind}/{k}.png")) for k, stamp in enumerate(stamps)]


def test_association_is_that_of_the_tum_benchmark() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        a, b = rng.uniform(0, 1, 60), rng.uniform(0, 1, 50)
        assert associate(a, b, 0.02).tolist() == [list(ij) for ij in as_tum_does(a, b, 0.02)]


def test_the_smallest_difference_wins_over_the_first_come() -> None:
    assert associate(np.array([0.0, 0.012]), np.array([0.011]), 0.02).tolist() == [[1, 0]]


def test_nothing_is_associated_at_the_limit_or_with_nothing() -> None:
    assert associate(np.array([0.0, 1.0]), np.array([0.5]), 0.5).tolist() == []
    assert associate(np.zeros(0), np.array([0.5]), 0.5).shape == (0, 2)
    assert associate(np.array([0.5]), np.zeros(0), 0.5).shape == (0, 2)


def test_long_lists_with_dense_times_are_associated_one_to_one() -> None:
    stamps = np.arange(20_000) / 30
    matches = associate(stamps, stamps[::-1] + 0.004, 0.02)
    np.testing.assert_array_equal(matches[:, 0], np.arange(20_000))
    np.testing.assert_array_equal(matches[:, 1], np.arange(20_000)[::-1])


def test_frames_are_in_order_of_time_and_what_is_left_is_dropped() -> None:
    colors, depths = images([2.0, 1.0, 3.0], "rgb"), images([1.01, 2.01, 9.0], "depth")
    frames = paired(colors, depths, np.array([[0, 1], [1, 0]]))
    assert frames.stamps_s.tolist() == [1.0, 2.0]
    assert [pair.depth.stamp_s for pair in frames.pairs] == [1.01, 2.01]
    assert frames.dropped_color == (colors[2],)
    assert frames.dropped_depth == (depths[2],)


def test_of_two_colour_images_with_one_time_the_first_is_kept() -> None:
    colors, depths = images([1.0, 1.0], "rgb"), images([1.0, 1.001], "depth")
    frames = paired(colors, depths, np.array([[0, 0], [1, 1]]))
    assert frames.pairs == (FramePair(colors[0], depths[0]),)
    assert frames.dropped_color == (colors[1],)


def test_the_largest_gap_and_the_offsets_are_told() -> None:
    colors, depths = images([0.0, 0.1, 0.5], "rgb"), images([0.01, 0.1, 0.48], "depth")
    frames = FrameList(tuple(map(FramePair, colors, depths)))
    assert frames.largest_gap_s == 0.4
    np.testing.assert_allclose(frames.offsets_s, [0.01, 0.0, -0.02], atol=1e-12)
    assert FrameList(frames.pairs[:1]).largest_gap_s == 0.0
