from math import comb, exp

import numpy as np
import pytest

from vnav.core.descriptor_space import DescriptorSpace
from vnav.localisation.verification.evidence import (
    ODDS,
    RATES,
    RIVALS,
    TRIES,
    UNMAPPED,
    Evidence,
    evidence,
    odds_of,
    posterior,
)
from vnav.localisation.verification.image_cells import COLUMNS, ROWS, cell_counts
from vnav.localisation.verification.projection_matching import ProjectionMatches

CELLS = COLUMNS * ROWS


def chance(scene, rows) -> float:
    """Probability of the pose where these predicted rows are found."""
    photo, prediction = scene
    found = ProjectionMatches(rows, rows, np.zeros(len(rows), np.float32))
    return float(posterior([evidence(cell_counts(prediction, found, photo))])[0])


def test_a_share_found_everywhere_speaks_for_the_pose(scene):
    assert chance(scene, np.arange(0, len(scene[1]), 3)) > 0.98


def test_nothing_found_speaks_against_it(scene):
    assert chance(scene, np.arange(0)) < 0.1


def test_as_many_in_one_corner_speak_for_it_less_than_everywhere(scene):
    prediction = scene[1]
    count = len(prediction) // 4
    corner = np.argsort(np.abs(prediction.px - [160, 120]).max(1))[:count]
    everywhere = np.arange(0, 4 * count, 4)
    assert chance(scene, np.sort(corner)) < 0.7 < 0.95 < chance(scene, everywhere)


def test_where_the_map_predicts_nothing_a_pose_is_one_of_many_tries(scene):
    """A pose that hides everything has nothing to show for it."""
    photo, prediction = scene
    none = ProjectionMatches(np.arange(0), np.arange(0), np.zeros(0, np.float32))
    nowhere = prediction[np.zeros(len(prediction), bool)]
    found = evidence(cell_counts(nowhere, none, photo))
    assert posterior([found])[0] == pytest.approx(1 / (1 + TRIES))


@pytest.mark.parametrize(
    ("found", "predicted"),
    [
        # Many matches along two lines, of far more that should be there.
        ([8, 1, 6, 1, 3, 13, 10, 0, 0, 0, 0, 0], [75, 60, 119, 144, 40, 59, 68, 33, 14, 66, 7, 8]),
        # A few in a corner, of a view that hardly sees the map.
        ([2, 9, 2, 0, 0, 0, 0, 0], [18, 38, 11, 9, 7, 12, 7, 3]),
    ],
)
def test_what_chance_finds_in_a_few_cells_is_not_enough(found, predicted):
    """Such poses came out best for photos from elsewhere."""
    assert posterior([evidence(np.array([found, predicted]))])[0] < 0.8


def test_the_same_share_found_in_every_cell_is_enough():
    predicted = np.array([75, 60, 119, 144, 40, 59, 68, 33, 14, 66, 7, 8] * 3)
    cells = np.stack([np.rint(0.09 * predicted).astype(int), predicted])
    assert posterior([evidence(cells)])[0] > 0.95


@pytest.mark.parametrize("rate", [0.08, 0.15, 0.6])
def test_how_many_a_photo_finds_everywhere_does_not_matter(rate):
    """A worse camera, or a map that is off by centimetres, finds few; but finds them everywhere."""
    predicted = np.full(CELLS, 40)
    found = np.random.default_rng(0).binomial(predicted, rate)
    assert posterior([evidence(np.stack([found, predicted]))])[0] > 0.95


def test_few_found_in_few_cells_speak_against_a_pose():
    """The same number of landmarks as a poor photo finds everywhere, in an eighth of the cells."""
    predicted = np.full(CELLS, 40)
    found = np.where(np.arange(CELLS) % 8, 0, 26)
    assert posterior([evidence(np.stack([found, predicted]))])[0] < 0.2


def test_a_third_of_a_view_behind_something_unknown_leaves_a_pose_sure():
    predicted = np.full(CELLS, 20)
    found = np.where(np.arange(CELLS) % 3, 9, 0)
    assert posterior([evidence(np.stack([found, predicted]))])[0] > 0.95


def test_two_places_that_show_the_same_share_the_chances():
    same = evidence(np.stack([np.full(CELLS, 9), np.full(CELLS, 20)]))
    one, other = posterior([same, same])
    assert one == other
    assert 0.98 < one + other < 1  # a place that is not mapped may look the same


def test_a_map_that_repeats_itself_makes_the_strongest_place_less_sure():
    """What looks alike twice may do so a third time, where nobody has been."""
    predicted = np.full(CELLS, 20)
    found = np.where(np.arange(CELLS) % 4, 9, 0)
    strongest = evidence(np.stack([found, predicted]))
    rival = evidence(np.stack([np.where(np.arange(CELLS) % 8 < 5, 9, 0), predicted]))
    assert rival.likeness > 0.5
    assert posterior([strongest])[0] > 0.95
    assert posterior([strongest, rival]).sum() < 0.8


def test_a_pose_that_chance_made_leaves_the_strongest_place_as_sure():
    predicted = np.full(CELLS, 20)
    found = np.where(np.arange(CELLS) % 4, 9, 0)
    strongest = evidence(np.stack([found, predicted]))
    chance = evidence(np.stack([np.where(np.arange(CELLS) == 0, 9, 0), predicted]))
    assert chance.likeness < 0.01
    np.testing.assert_allclose(posterior([strongest, chance])[0], posterior([strongest]), atol=0.01)


def test_a_rival_of_which_half_is_missing_is_hardly_one():
    predicted = np.full(CELLS, 20)
    whole = evidence(np.stack([np.full(CELLS, 9), predicted]))
    half = evidence(np.stack([np.where(np.arange(CELLS) % 2, 9, 0), predicted]))
    assert posterior([whole, half])[0] > 0.98


def test_the_chances_of_all_places_and_of_none_add_up():
    one = np.zeros(len(RATES))
    places = [Evidence(one + 3, one + 1, one + 0.5), Evidence(one + 2, one + 1.5, one + 0.2)]
    alike = 1 / (1 + exp(0.2 - 1.5) * (1 - RIVALS) / RIVALS)  # the second place, not the photo's
    chance = UNMAPPED * alike / (1 + alike)
    unmapped = (1 - chance) * exp(0.5) + chance * exp(1.0)
    odds = [exp(3.0 - 1.0), exp(2.0 - 1.5), TRIES * unmapped / exp(1.0)]
    np.testing.assert_allclose(posterior(places), np.array(odds[:2]) / sum(odds))
    assert len(posterior([])) == 0


def test_the_likelihoods_of_all_counts_add_up():
    """Of one cell with five landmarks: with the binomial coefficient they sum to one."""
    for kind in ("right", "rival", "elsewhere"):
        logs = [getattr(evidence(np.array([[k], [5]])), kind) for k in range(6)]
        total = sum(comb(5, k) * np.exp(log) for k, log in enumerate(logs))
        np.testing.assert_allclose(total, 1.0)


def test_a_front_end_has_its_own_odds_and_one_that_none_were_fitted_for_has_sifts():
    of = [DescriptorSpace(name, "uint8", 32, "hamming", 64.0) for name in ("orb", "foreign")]
    assert [odds_of(space) for space in of] == [ODDS["orb"], ODDS["sift"]]
    assert ODDS["orb"] != ODDS["sift"]
