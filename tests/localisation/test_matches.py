import numpy as np

from vnav.localisation.matches import Matches, no_matches


def matches(*rows):
    feature, landmark, cost = zip(*rows, strict=True)
    return Matches(
        np.array(feature), np.array(landmark), np.array(landmark, np.int32), np.array(cost)
    )


def test_the_better_match_wins_a_feature():
    kept = matches((1, 10, 0.5), (1, 11, 0.3)).one_to_one()
    assert kept.landmark.tolist() == [11]


def test_the_better_match_wins_a_landmark():
    kept = matches((1, 10, 0.5), (2, 10, 0.3)).one_to_one()
    assert kept.feature.tolist() == [2]


def test_the_best_come_first():
    kept = matches((1, 10, 0.5), (2, 11, 0.1), (3, 12, 0.3)).one_to_one()
    assert kept.feature.tolist() == [2, 3, 1]


def test_nothing_joined_with_nothing_is_nothing():
    assert len(no_matches().joined(no_matches()).one_to_one()) == 0
