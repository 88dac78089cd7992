import numpy as np
import pytest

from vnav.localisation.evidence import COLUMNS, LANDMARKS, ROWS, evidence
from vnav.localisation.guided import Hits, Prediction
from vnav.localisation.photo import prepare


@pytest.fixture
def scene(world):
    """A photo whose features lie where the map predicts landmarks, one each, all over it."""
    rng = np.random.default_rng(0)
    features, _ = world.seen(world.looking((0, 0, 1.4), 0), world.things, rng, clutter=0)
    photo = prepare(features, world.camera, 0.0, world.atlas.tree)
    px = photo.features.keypoints_px.astype(float)
    return photo, Prediction(np.arange(len(px)), px, np.ones((len(px), 2)))


def found(rows):
    return Hits(rows, rows, np.zeros(len(rows), np.float32), np.zeros(len(rows)))


def test_a_share_found_everywhere_speaks_for_the_pose(scene):
    photo, prediction = scene
    rows = np.arange(0, len(prediction), 4)
    assert evidence(prediction, found(rows), photo) > 5


def test_nothing_found_speaks_against_it(scene):
    photo, prediction = scene
    assert evidence(prediction, found(np.arange(0)), photo) < -5


def test_as_many_in_one_corner_speak_for_it_less_than_everywhere(scene):
    photo, prediction = scene
    count = len(prediction) // 4
    corner = np.argsort(np.abs(prediction.px - [160, 120]).max(1))[:count]
    spread = np.arange(0, 4 * count, 4)
    in_corner = evidence(prediction, found(np.sort(corner)), photo)
    assert in_corner < evidence(prediction, found(spread), photo) - 5


def test_where_the_map_predicts_nothing_there_is_no_evidence(scene):
    photo, prediction = scene
    assert evidence(prediction[np.zeros(len(prediction), bool)], found(np.arange(0)), photo) == 0


def test_the_odds_of_counts_add_up():
    """Both are distributions over the count: with the binomial coefficient they sum to one."""
    from math import comb, exp

    from vnav.localisation.evidence import _log_beta_binomial

    for shares in (LANDMARKS.right, LANDMARKS.wrong):
        total = sum(comb(12, k) * exp(_log_beta_binomial(k, 12, *shares)) for k in range(13))
        assert total == pytest.approx(1)


def test_cells_cover_the_image(scene):
    photo, _ = scene
    assert photo.intrinsics.width % COLUMNS == 0
    assert photo.intrinsics.height % ROWS == 0
