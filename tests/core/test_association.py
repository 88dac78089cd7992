import numpy as np

from vnav.core.association import associate, span


def as_tum_does(a: np.ndarray, b: np.ndarray, largest_s: float) -> list[tuple[int, int]]:
    """The benchmark's associate.py, told plainly: all pairs, smallest difference first."""
    differences = np.abs(a[:, None] - b)
    rows = sorted(np.argwhere(differences < largest_s).tolist(), key=lambda ij: differences[*ij])
    matches: list[tuple[int, int]] = []
    for i, j in rows:
        if all(i != k and j != m for k, m in matches):
            matches.append((i, j))
    return sorted(matches)


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


def test_a_span_names_first_and_last_time_or_none() -> None:
    assert span(np.array([2.5, 1.0, 31.25])) == "1.000 to 31.250 s"
    assert span(np.zeros(0)) == "no time at all"
