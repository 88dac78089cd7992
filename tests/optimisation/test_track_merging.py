import numpy as np

from vnav.optimisation.track_merging import merge

COUNTS = np.array([4, 5, 3], np.int32)


def merged(*matches: tuple[int, int, int, int]) -> list[list[int]]:
    """Track numbers, one list a frame."""
    rows = np.array(matches, np.int32).reshape(-1, 4)
    return [part.tolist() for part in np.split(merge(rows, COUNTS), np.cumsum(COUNTS)[:-1])]


def test_features_without_a_match_have_a_track_of_their_own() -> None:
    assert merged() == [[0, 1, 2, 3], [4, 5, 6, 7, 8], [9, 10, 11]]


def test_matches_chain_into_one_track() -> None:
    first, second, third = merged((0, 1, 1, 4), (1, 4, 2, 0))
    assert first[1] == second[4] == third[0]
    assert len({*first, *second, *third}) == sum(COUNTS) - 2


def test_tracks_are_numbered_without_gaps() -> None:
    numbers = sorted({n for frame in merged((0, 0, 2, 2), (1, 1, 2, 1)) for n in frame})
    assert numbers == list(range(len(numbers)))


def test_an_earlier_match_wins_over_one_that_contradicts_it() -> None:
    first, second, _ = merged((0, 0, 1, 0), (0, 0, 1, 3))
    assert first[0] == second[0]
    assert first[0] != second[3]


def test_a_detour_does_not_join_two_features_of_a_frame() -> None:
    # Feature 0 of frame 0 and feature 1 of frame 0 both want feature 2 of frame 2.
    first, second, third = merged((0, 0, 1, 0), (1, 0, 2, 2), (0, 1, 2, 2))
    assert first[0] == second[0] == third[2]
    assert first[1] != third[2]


def test_a_track_never_holds_two_features_of_one_frame() -> None:
    rng = np.random.default_rng(0)
    counts = rng.integers(3, 12, 8).astype(np.int32)
    frames = np.array([rng.choice(8, 2, replace=False) for _ in range(300)])
    features = (rng.random((300, 2)) * counts[frames]).astype(int)
    matches = np.stack([frames[:, 0], features[:, 0], frames[:, 1], features[:, 1]], 1)
    track = merge(matches.astype(np.int32), counts)
    frame_of = np.repeat(np.arange(8), counts)
    pairs = set(zip(track.tolist(), frame_of.tolist(), strict=True))
    assert len(pairs) == len(track)
    assert len(set(track.tolist())) < len(track) / 2  # and yet many were merged
