"""Matching by descriptor distance, with descriptors whose distances are chosen."""

from dataclasses import replace

import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.features.guided_matching import match_guided
from vnav.features.matching import DescriptorMatcher, match, turned_alike
from vnav.features.sift import ROOT_SCALE, SPACE

NOWHERE = (np.nan, np.nan)


def features(values: list[int], px: list[tuple[float, float]] | None = None) -> Features:
    """Features whose descriptors differ in one number: their distances are its differences."""
    descriptors = np.zeros((len(values), 128), np.uint8)
    descriptors[:, 0] = values
    return described(descriptors, px)


def described(descriptors: np.ndarray, px: list[tuple[float, float]] | None = None) -> Features:
    n = len(descriptors)
    places = np.zeros((n, 2)) if px is None else np.array(px).reshape(n, 2)
    return Features(places, descriptors, np.ones(n), np.ones(n), np.zeros(n), SPACE)


def pairs(matches: np.ndarray) -> list[tuple[int, int]]:
    return [(int(i), int(j)) for i, j in matches]


def near(
    a: Features, b: Features, predicted: list[tuple[float, float]], limit: float = 400.0
) -> list[tuple[int, int]]:
    return pairs(match_guided(a, b, np.array(predicted).reshape(-1, 2), 10.0, 0.8, limit))


def test_the_nearest_descriptor_matches() -> None:
    assert pairs(match(features([10, 200]), features([205, 100, 12]), 0.8)) == [(0, 2), (1, 0)]


def test_two_alike_candidates_are_no_match() -> None:
    # Nearest / second-nearest is 9 / 10 in the first case, 7 / 10 in the second.
    assert pairs(match(features([100]), features([91, 110]), 0.8)) == []
    assert pairs(match(features([100]), features([93, 110]), 0.8)) == [(0, 0)]


def test_a_twin_in_b_is_no_match_even_where_it_is_equal() -> None:
    assert pairs(match(features([100]), features([100, 100, 7]), 0.8)) == []


def test_mutual_matches_must_be_nearest_both_ways() -> None:
    a, b = features([100, 104]), features([105, 250])
    assert pairs(match(a, b, 0.8)) == [(1, 0)]
    assert pairs(match(a, b, 0.8, mutual=False)) == [(0, 0), (1, 0)]


def test_fewer_than_two_features_leave_no_ratio_and_no_match() -> None:
    some, one, none = features([1, 50]), features([1]), features([])
    for a, b in ((some, one), (some, none), (none, some), (none, none)):
        assert match(a, b, 0.8).shape == (0, 2)
    assert pairs(match(one, some, 0.8)) == [(0, 0)]


def test_distances_are_exact_at_the_ends_of_the_bytes() -> None:
    # Inner products reach 128 * 255^2 = 8.3 million, where float32 still counts by ones.
    full = np.full((2, 128), 255, np.uint8)
    full[1, 0] = 254
    assert pairs(match(described(full), described(full[::-1]), 0.8)) == [(0, 1), (1, 0)]


def test_only_features_near_the_prediction_match() -> None:
    a = features([100])
    b = features([101, 100], [(50, 50), (90, 50)])
    assert near(a, b, [(52, 50)]) == [(0, 0)]
    assert near(a, b, [(50, 61)]) == []


def test_the_ratio_is_taken_among_the_features_in_reach() -> None:
    a = features([100])
    b = features([93, 110, 91], [(50, 50), (52, 50), (90, 90)])
    assert near(a, b, [(50, 50)]) == [(0, 0)]
    crowded = features([93, 110, 108], [(50, 50), (52, 50), (53, 50)])
    assert near(a, crowded, [(50, 50)]) == []


def test_a_sole_candidate_matches_where_its_distance_is_small_enough() -> None:
    a, b = features([100]), features([160], [(50, 50)])
    assert near(a, b, [(50, 50)], limit=61) == [(0, 0)]
    assert near(a, b, [(50, 50)], limit=59) == []


def test_a_feature_without_a_predicted_place_matches_nothing() -> None:
    a, b = features([100, 100]), features([100], [(50, 50)])
    assert near(a, b, [NOWHERE, NOWHERE]) == []
    assert near(a, b, [NOWHERE, (50, 50)]) == [(1, 0)]


def test_of_rivals_for_one_feature_the_nearer_wins() -> None:
    a, b = features([100, 103]), features([104], [(50, 50)])
    assert near(a, b, [(50, 50), (50, 50)]) == [(1, 0)]


def test_matching_near_nothing_gives_nothing() -> None:
    some, none = features([1, 50]), features([])
    assert near(none, some, []) == []
    assert near(some, none, [(0, 0), (0, 0)]) == []


def test_matching_near_is_matching_everywhere_where_all_is_in_reach() -> None:
    rng = np.random.default_rng(0)
    parents = rng.integers(0, 256, (60, 128))
    noisy = parents + rng.integers(-20, 21, (2, 60, 128))
    first, second = np.clip(noisy, 0, 255).astype(np.uint8)
    a, b = described(first), described(second[rng.permutation(60)])
    together = match_guided(a, b, np.zeros((60, 2)), 1.0, 0.8, 1e9)
    np.testing.assert_array_equal(together, match(a, b, 0.8))
    assert len(together) == 60


def test_the_matcher_takes_its_limits_from_the_settings() -> None:
    config = RegistrationConfig(ratio=0.8, max_distance=60 / ROOT_SCALE)
    matcher = DescriptorMatcher(config)
    predicted = np.array([[50.0, 50.0]])
    for value, expected in ((159, 1), (161, 0)):
        b = features([value], [(50, 50)])
        assert len(matcher.match_guided(features([100]), b, predicted, 10.0)) == expected
    assert pairs(matcher.match(features([100]), features([93, 110]))) == [(0, 0)]


def turned_by(degrees: list[float]) -> tuple[Features, Features, np.ndarray]:
    """Features of two images, and their matches, each turned by so much from a to b."""
    rng, n = np.random.default_rng(0), len(degrees)
    before = rng.uniform(0, 2 * np.pi, n)
    after = (before + np.deg2rad(degrees)) % (2 * np.pi)
    a, b = (replace(features([0] * n), angles_rad=x.astype(np.float32)) for x in (before, after))
    return a, b, np.stack([np.arange(n), np.arange(n)], 1).astype(np.int32)


def test_matches_that_turn_otherwise_than_most_are_left_out() -> None:
    a, b, matches = turned_by([30] * 9 + [60] * 9 + [90] * 9 + [150, 210, 270])
    assert turned_alike(a, b, matches, 12)[:, 0].tolist() == list(range(27))


def test_turns_to_either_side_of_none_are_alike() -> None:
    a, b, matches = turned_by([-8, 8] * 2 + [120] * 3 + [180] * 3 + [60])
    assert turned_alike(a, b, matches, 12)[:, 0].tolist() == list(range(10))


def test_without_bins_or_orientations_all_matches_are_kept() -> None:
    a, b, matches = turned_by([30] * 9 + [60, 90, 120, 150])
    assert len(turned_alike(a, b, matches, 0)) == 13
    upright = replace(SPACE, has_angles=False)
    assert len(turned_alike(replace(a, space=upright), b, matches, 12)) == 13


def test_a_matcher_asks_the_turns_that_it_is_told_to_ask() -> None:
    turns = [30] * 9 + [60] * 9 + [90] * 9 + [150]
    a, b, _ = turned_by(turns)
    described = np.zeros((len(turns), 128), np.uint8)
    described[:, :28] = 200 * np.eye(28)
    a, b = replace(a, descriptors=described), replace(b, descriptors=described)
    for bins, kept in ((0, 28), (12, 27)):
        matcher = DescriptorMatcher(RegistrationConfig(rotation_bins=bins))
        assert len(matcher.match(a, b)) == kept
        assert len(matcher.match_guided(a, b, np.zeros((28, 2)), 10.0)) == kept


@pytest.mark.parametrize("mutual", [True, False])
def test_bits_match_as_their_differing_bits_are_counted_one_by_one(mutual: bool) -> None:
    rng, ratio = np.random.default_rng(0), 0.9
    a, b = (rng.integers(0, 256, (n, 32), np.uint8) for n in (60, 80))
    b[:40] = a[:40] ^ (1 << rng.integers(0, 8, (40, 32))).astype(np.uint8)  # 32 bits of 256
    b[50], b[70] = b[3], a[45]
    counted = (np.unpackbits(a, axis=1)[:, None] != np.unpackbits(b, axis=1)).sum(2)
    nearest, two = counted.argmin(1), np.sort(counted, 1)[:, :2]
    is_match = two[:, 0] < ratio * two[:, 1]
    if mutual:
        is_match &= counted.argmin(0)[nearest] == np.arange(60)
    space = DescriptorSpace("bits", "uint8", 32, "hamming", 64.0)
    of = [
        Features(np.zeros((n, 2)), x, np.ones(n), np.ones(n), np.zeros(n), space)
        for n, x in ((60, a), (80, b))
    ]
    expected = [(i, int(nearest[i])) for i in np.flatnonzero(is_match)]
    assert 38 <= len(expected) <= 42
    assert pairs(match(*of, ratio, mutual)) == expected
