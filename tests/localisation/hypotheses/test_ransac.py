import dataclasses

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.localisation.hypotheses.ransac import RansacOptions, estimate_absolute_pose
from vnav.localisation.matches import Correspondences2D3D
from vnav.localisation.view import View

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
OPTIONS = RansacOptions(threshold_px=4.0, min_inliers=8, max_iterations=1000, solver="auto")
EXACT, UNKNOWN = CameraPrior(CAMERA, 0.0), CameraPrior(CAMERA, np.inf)
TRUE = View(se3.exp([0.1, -0.2, 0.3, 0.5, -0.2, 0.4]), CAMERA)


def correspondences(rng, *, view=TRUE, good=60, bad=60, flat=False):
    """Correspondences with as many outliers as inliers of 0.5 px."""
    camera = rng.uniform([-1, -1, 2], [1, 1, 2.001 if flat else 5], (good + bad, 3))
    points = se3.transform(view.T_world_camera, camera)
    px = view.project(points)[0] + rng.normal(0, 0.5, (good + bad, 2))
    px[good:] = rng.uniform([0, 0], [640, 480], (bad, 2))
    order = rng.permutation(good + bad)
    return Correspondences2D3D(points[order], px[order], np.ones(good + bad)), order < good


def error_m(found, view=TRUE):
    return np.linalg.norm(found.view.centre_world - view.centre_world)


@pytest.mark.parametrize("solver", ["auto", "p3p", "dlt"])
def test_half_outliers_do_not_matter(solver):
    matched, good = correspondences(np.random.default_rng(0))
    options = dataclasses.replace(OPTIONS, solver=solver)
    found = estimate_absolute_pose(matched, EXACT, options, np.random.default_rng(0))
    # 60 points, 0.5 px, 3 m: 0.5 / 525 * 3 / sqrt(60) = 0.4 mm along the image, depth ten times.
    assert error_m(found) < 0.02
    assert found.inlier_mask[good].mean() > 0.95
    assert found.inlier_mask[~good].mean() < 0.1


@pytest.mark.parametrize("solver", ["auto", "dlt"])
def test_a_plane_is_no_obstacle(solver):
    matched, _ = correspondences(np.random.default_rng(1), flat=True)
    options = dataclasses.replace(OPTIONS, solver=solver)
    assert error_m(estimate_absolute_pose(matched, EXACT, options, np.random.default_rng(0))) < 0.03


def test_five_points_are_enough_for_a_known_camera():
    matched, _ = correspondences(np.random.default_rng(2), good=5, bad=0)
    options = dataclasses.replace(OPTIONS, min_inliers=5)
    assert error_m(estimate_absolute_pose(matched, EXACT, options, np.random.default_rng(0))) < 0.1


def test_an_unknown_focal_length_is_found():
    long = View(TRUE.T_camera_world, dataclasses.replace(CAMERA, fx=800.0, fy=800.0))
    matched, _ = correspondences(np.random.default_rng(3), view=long, bad=30)
    found = estimate_absolute_pose(matched, UNKNOWN, OPTIONS, np.random.default_rng(0))
    assert found.view.intrinsics.fx == pytest.approx(800, rel=0.02)
    assert error_m(found, long) < 0.1


def test_too_few_that_agree_are_none():
    matched, _ = correspondences(np.random.default_rng(4), good=0, bad=40)
    options = dataclasses.replace(OPTIONS, min_inliers=12)
    assert estimate_absolute_pose(matched, EXACT, options, np.random.default_rng(0)) is None


def test_too_few_at_all_are_none():
    matched, _ = correspondences(np.random.default_rng(5), good=3, bad=0)
    assert estimate_absolute_pose(matched, EXACT, OPTIONS, np.random.default_rng(0)) is None


def test_the_same_seed_gives_the_same_pose():
    matched, _ = correspondences(np.random.default_rng(6))
    one, two = (
        estimate_absolute_pose(matched, EXACT, OPTIONS, np.random.default_rng(1)) for _ in range(2)
    )
    np.testing.assert_array_equal(one.view.T_camera_world, two.view.T_camera_world)
