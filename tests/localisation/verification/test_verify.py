import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.core import se3
from vnav.core.camera import CameraPrior
from vnav.localisation.hypotheses.pose_refinement import RefinedPose
from vnav.localisation.hypotheses.ransac import PoseHypothesis
from vnav.localisation.matches import Matches
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query
from vnav.localisation.verification import verify
from vnav.localisation.verification.verify import (
    SEARCH_RADII,
    VerifiedPose,
    _guided,
    _verified,
)
from vnav.localisation.view import View


@pytest.fixture
def query(tiled_world):
    """A photo of the wall with the pattern, and its true pose."""
    T = tiled_world.looking((0.0, 0.2, 1.4), 0)
    features, _ = tiled_world.seen(T, tiled_world.things, np.random.default_rng(3), clutter=20)
    photo = prepare(features, CameraPrior(tiled_world.camera), tiled_world.database.tree)
    return Query(photo, tiled_world.database, LocateConfig()), T


def off_m(pose, T_true) -> float:
    return float(np.linalg.norm(pose.view.centre_world - T_true[:3, 3]))


def test_a_pose_beside_the_right_one_that_few_matches_hold_leads_to_it(query, step_m):
    """Shifted by a step of the pattern, one copy of it looks like the other."""
    asked, T_true = query
    beside = View(se3.inverse(se3.make(np.eye(3), (0, step_m, 0)) @ T_true), asked.photo.intrinsics)
    alone = _guided(beside, asked, asked.photo.camera, SEARCH_RADII)
    assert alone is not None
    assert off_m(alone, T_true) > step_m / 2
    verified = _verified(beside, asked, np.random.default_rng(0))
    # Some 80 inliers of 0.5 px at 525 px and 3 m are good for a few millimetres with the map's own.
    assert off_m(verified, T_true) < 0.02


def test_the_pose_that_the_map_bears_out_better_is_taken_though_fewer_matches_hold_it(
    query, monkeypatch
):
    """Cells of a photo of house with a third covered, 25 cm beside the truth and there."""
    asked, T_true = query
    beside = pose_with_cells(
        asked, T_true, [15, 17, 20, 10, 18] + [0] * 9, [55, 101, 136, 60, 82] + [12] * 9
    )
    right = pose_with_cells(asked, T_true, [3, 8, 12, 15, 16, 18], [17, 40, 74, 103, 65, 55])
    found = iter([beside, right])
    monkeypatch.setattr(verify, "_guided", lambda *_: next(found))
    monkeypatch.setattr(verify, "pose_of", lambda *_: PoseHypothesis(right.view, np.ones(9, bool)))
    assert beside.inliers > right.inliers
    assert _verified(beside.view, asked, np.random.default_rng(0)) is right


def pose_with_cells(query, T_true, found, predicted) -> VerifiedPose:
    """A verified pose with so many landmarks found, of those predicted, in each cell."""
    rows = np.arange(sum(found))
    matches = Matches(rows, rows, rows.astype(np.int32), np.zeros(len(rows), np.float32))
    view = View(se3.inverse(T_true), query.photo.intrinsics)
    return VerifiedPose(RefinedPose(view, np.eye(6)), matches, np.array([found, predicted]))


def test_the_right_pose_stays(query):
    asked, T_true = query
    view = View(se3.inverse(T_true), asked.photo.intrinsics)
    assert off_m(_verified(view, asked, np.random.default_rng(0)), T_true) < 0.02


def test_where_nothing_is_found_there_is_no_pose(query):
    asked, T_true = query
    away = View(se3.inverse(T_true @ se3.exp([0, np.pi, 0, 0, 0, 0])), asked.photo.intrinsics)
    assert _verified(away, asked, np.random.default_rng(0)) is None
