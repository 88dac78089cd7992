import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.core import se3
from vnav.core.camera import CameraPrior
from vnav.localisation.hypotheses.displaced import MOST, displaced, frequent
from vnav.localisation.matches import no_matches
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query
from vnav.localisation.verification.prediction import predict
from vnav.localisation.verification.projection_matching import match_by_projection, one_to_one
from vnav.localisation.view import View


def at_its_pose(world, position, heading_deg):
    """A photo's view, its matches there, and the query."""
    T = world.looking(position, heading_deg)
    features, _ = world.seen(T, world.things, np.random.default_rng(5))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    view = View(se3.inverse(T), world.camera)
    prediction = predict(view, world.database)
    found = match_by_projection(prediction, photo, world.database, 3.0)
    query = Query(photo, world.database, LocateConfig())
    return view, one_to_one(found, prediction, world.database), query


def moved_m(views, view):
    return np.array([other.centre_world - view.centre_world for other in views])


def test_before_a_shelf_the_view_is_moved_by_its_periods(shelf_world):
    view, matches, query = at_its_pose(shelf_world, (0.0, 0.1, 1.3), 0.0)
    moved = moved_m(displaced(view, matches, query), view)
    # Landmarks are known as exactly as they lie; 5 mm is a tenth of the cells they are counted in.
    np.testing.assert_allclose(moved[:, [0, 2]], 0.0, atol=0.005)
    periods = moved[:, 1] / shelf_world.period_m
    np.testing.assert_allclose(periods, np.round(periods), atol=0.005 / shelf_world.period_m)
    assert {-1, 1} <= set(np.round(periods))


def test_the_view_is_not_turned(shelf_world):
    view, matches, query = at_its_pose(shelf_world, (0.0, 0.1, 1.3), 10.0)
    for other in displaced(view, matches, query):
        np.testing.assert_allclose(
            other.T_camera_world[:3, :3], view.T_camera_world[:3, :3], atol=1e-12
        )


def test_in_a_room_that_repeats_nothing_there_is_no_other_view(world):
    assert displaced(*at_its_pose(world, (0.4, -0.3, 1.5), 40.0)) == []


def test_without_matches_there_is_no_other_view(world):
    view, _, query = at_its_pose(world, (0.4, -0.3, 1.5), 40.0)
    assert displaced(view, no_matches(), query) == []


@pytest.fixture
def ways():
    """Thirty displacements by a metre, twenty by two, and forty that agree with none."""
    rng = np.random.default_rng(0)
    one, two = (np.tile([0.0, y, 0.0], (n, 1)) for y, n in ((1.0, 30), (2.0, 20)))
    shared = np.concatenate([two, one])
    return np.concatenate([shared + rng.normal(0, 0.003, shared.shape), rng.uniform(3, 9, (40, 3))])


def test_displacements_that_many_agree_on_come_the_most_frequent_first(ways):
    found = frequent(ways, 5)
    # Medians of 20 and more, of 3 mm each: below a millimetre.
    np.testing.assert_allclose(found, [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]], atol=0.004)


def test_displacements_that_few_agree_on_are_left(ways):
    assert len(frequent(ways, 25)) == 1
    assert frequent(ways, 40) == []


def test_a_displacement_at_the_border_of_two_cells_is_one():
    ways = np.array([[0.0, 1.024, 0.0]] * 10 + [[0.0, 1.026, 0.0]] * 10)
    assert len(frequent(ways, 5)) == 1


def test_only_the_most_frequent_displacements_are_tried():
    ways = np.repeat(np.arange(1.0, 21.0)[:, None] * [0.0, 0.5, 0.0], 10, axis=0)
    assert len(frequent(ways, 5)) == MOST
