"""Bundle adjustment of a walk past random points; noise is what the settings say, unless told."""

import dataclasses

import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.optimisation import bundle
from vnav.optimisation.bundle_problem import BundleProblem
from vnav.optimisation.calibrating_step import calibrating_step
from vnav.optimisation.self_calibration import PRIOR_SIGMAS
from vnav.optimisation.sensor_model import Bundle, Observations, SensorModel

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
CONFIG = RegistrationConfig()
CAMERAS, POINTS = 6, 60
MODEL = SensorModel([CAMERA] * CAMERAS, CONFIG)
ITERATIONS = 20


def scene(rng: np.random.Generator) -> Bundle:
    """Cameras that go sideways past a wall of points 2 to 4 m away, all seen by all."""
    xi = np.zeros((CAMERAS, 6))
    xi[:, 1], xi[:, 3] = np.linspace(0, -0.2, CAMERAS), np.linspace(0, 0.8, CAMERAS)
    points = rng.uniform([-0.6, -0.6, 2], [1.0, 0.6, 4], (POINTS, 3))
    return Bundle(se3.exp(xi), points)


def measured(truth: Bundle, rng: np.random.Generator, noise: float = 1.0) -> Observations:
    """Every point seen by every camera."""
    camera, landmark = (k.ravel().astype(np.int32) for k in np.indices((CAMERAS, POINTS)))
    T_camera_world = se3.inverse(truth.T_world_camera)
    points = se3.transform(T_camera_world, truth.points_world)[camera, landmark]
    px = CAMERA.project(points) + noise * CONFIG.pixel_sigma_px * rng.standard_normal(
        (len(camera), 2)
    )
    inverse = 1 / points[:, 2] + noise * CONFIG.depth_sigma_per_m2 * rng.standard_normal(
        len(camera)
    )
    return Observations(landmark, camera, px, inverse)


def adjust(
    initial: Bundle, seen: Observations, edges: list[Edge], model: SensorModel, iterations: int
) -> Bundle:
    return bundle.adjust(initial, BundleProblem(seen, edges, model), iterations)


def covariances(
    found: Bundle, seen: Observations, edges: list[Edge], model: SensorModel
) -> np.ndarray:
    return bundle.covariances(found, BundleProblem(seen, edges, model))


def with_offset(seen: Observations, offset: float) -> Observations:
    return dataclasses.replace(seen, inverse_depth=seen.inverse_depth + offset)


def depth_offset(found: Bundle, seen: Observations, model: SensorModel) -> float:
    """Where steps of bundle and offset lead, under the prior of an offset."""
    offset = np.zeros(1)
    by_error = np.tile([[0.0], [0.0], [1.0]], (len(seen), 1, 1))
    for _ in range(4):
        problem = BundleProblem(with_offset(seen, -offset[0]), [], model)
        step = calibrating_step(found, problem, by_error, -offset, PRIOR_SIGMAS[:1])
        found, offset = step.bundle, offset + step.change
    return float(offset[0])


def without_depth(seen: Observations, rows: np.ndarray) -> Observations:
    inverse = seen.inverse_depth.copy()
    inverse[rows] = np.nan
    return Observations(seen.landmark, seen.camera, seen.px, inverse)


def disturbed(truth: Bundle, rng: np.random.Generator) -> Bundle:
    """As odometry may leave it: 1 degree and 5 cm off, points 10 cm; the first camera is right."""
    xi = np.repeat([0.02, 0.05], 3) * rng.standard_normal((CAMERAS, 6))
    xi[0] = 0
    points = truth.points_world + 0.1 * rng.standard_normal(truth.points_world.shape)
    return Bundle(truth.T_world_camera @ se3.exp(xi), points)


def tangents(result: Bundle, truth: Bundle) -> np.ndarray:
    """Errors (K, 6) of the poses, rotation first."""
    error = se3.inverse(truth.T_world_camera) @ result.T_world_camera
    return np.concatenate([se3.log_so3(error[:, :3, :3]), error[:, :3, 3]], 1)


def test_without_noise_the_truth_comes_back() -> None:
    rng = np.random.default_rng(0)
    truth = scene(rng)
    found = adjust(disturbed(truth, rng), measured(truth, rng, 0), [], MODEL, ITERATIONS)
    np.testing.assert_allclose(found.T_world_camera, truth.T_world_camera, atol=1e-4)
    np.testing.assert_allclose(found.points_world, truth.points_world, atol=1e-3)


def test_the_residuals_left_are_those_of_the_noise() -> None:
    # Chi-squared of 3 numbers an observation less 6 a free pose and 3 a point, within four times
    # its scatter, and 5 % less for what Cauchy's kernel lets go.
    rng = np.random.default_rng(1)
    truth = scene(rng)
    seen = measured(truth, rng)
    found = adjust(disturbed(truth, rng), seen, [], MODEL, ITERATIONS)
    free = 3 * len(seen) - 6 * (CAMERAS - 1) - 3 * POINTS
    total = MODEL.squared_residuals(found, seen).sum()
    assert total == pytest.approx(free, abs=4 * np.sqrt(2 * free) + 0.05 * free)


def test_poses_scatter_as_their_covariance_says() -> None:
    # 12 trials of 5 cameras and 6 numbers each; errors of one trial hang together, so 12 * 6
    # independent ones: the mean of their squares is 1 within 4 * sqrt(2 / 72). Cauchy's kernel adds
    # 5 % to the errors, and the covariance of its weights a little more to what is promised.
    normalised = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        truth = scene(rng)
        seen = measured(truth, rng)
        found = adjust(truth, seen, [], MODEL, ITERATIONS)
        covariance = covariances(found, seen, [], MODEL)
        for xi, c in zip(tangents(found, truth)[1:], covariance[1:], strict=True):
            normalised.append(xi @ np.linalg.solve(c, xi) / 6)
    assert np.mean(normalised) == pytest.approx(1, abs=4 * np.sqrt(2 / 72))


def test_points_scatter_as_their_sigmas_say() -> None:
    # With true poses every point errs on its own, most of all in depth: 4 * 60 numbers, whose
    # mean square is 1 within 4 * sqrt(2 / 240), and 5 % for Cauchy's kernel.
    ratios = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        truth = scene(rng)
        seen, T = measured(truth, rng), truth.T_world_camera
        held = [
            Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], 1e12 * np.eye(6))
            for k in range(CAMERAS - 1)
        ]
        found = adjust(truth, seen, held, MODEL, ITERATIONS)
        squared = ((found.points_world - truth.points_world) ** 2).mean(1)
        ratios.append(squared / MODEL.point_sigmas(truth, seen) ** 2)
    assert np.mean(ratios) == pytest.approx(1, abs=4 * np.sqrt(2 / 240) + 0.05)


def test_the_first_camera_stays_where_it_is() -> None:
    rng = np.random.default_rng(3)
    truth = scene(rng)
    start = disturbed(truth, rng)
    found = adjust(start, measured(truth, rng), [], MODEL, ITERATIONS)
    # Its prior has 1e-5 rad and m.
    np.testing.assert_allclose(found.T_world_camera[0], start.T_world_camera[0], atol=1e-4)


def test_observations_without_depth_work() -> None:
    # Every second number has no depth; what is left fixes scale and poses as well.
    rng = np.random.default_rng(4)
    truth = scene(rng)
    seen = without_depth(measured(truth, rng), np.arange(0, CAMERAS * POINTS, 2))
    found = adjust(disturbed(truth, rng), seen, [], MODEL, ITERATIONS)
    covariance = covariances(found, seen, [], MODEL)
    for xi, c in zip(tangents(found, truth)[1:], covariance[1:], strict=True):
        assert xi @ np.linalg.solve(c, xi) < 24  # chi-squared of 6: once in 2000


def test_less_depth_leaves_less_certain_poses() -> None:
    rng = np.random.default_rng(5)
    truth = scene(rng)
    seen = measured(truth, rng)
    blind = without_depth(seen, np.arange(60, CAMERAS * POINTS))
    traces = [
        np.trace(covariances(truth, s, [], MODEL)[1:, 3:, 3:], axis1=1, axis2=2).sum()
        for s in (seen, blind)
    ]
    assert traces[0] < traces[1]


def test_a_few_wrong_observations_do_little_harm() -> None:
    # 2 % are 60 px off. Cauchy's kernel bounds what each pulls to that of 1 sigma: 7 of 360 that
    # all pull one way shift the rest by 2 % of a sigma of one observation, under half a sigma of
    # the pose. So the errors stay within three sigmas instead of hundreds.
    rng = np.random.default_rng(6)
    truth = scene(rng)
    seen = measured(truth, rng)
    rows = rng.choice(len(seen), len(seen) // 50, replace=False)
    px = seen.px.copy()
    px[rows] += 60
    bad = Observations(seen.landmark, seen.camera, px, seen.inverse_depth)
    found = adjust(disturbed(truth, rng), bad, [], MODEL, ITERATIONS)
    sigmas = np.sqrt(np.diagonal(covariances(truth, seen, [], MODEL), axis1=1, axis2=2))
    assert (np.abs(tangents(found, truth)) / sigmas)[1:].max() < 5
    squared = MODEL.squared_residuals(found, bad)
    assert squared[rows].min() > np.delete(squared, rows).max()


def test_a_camera_that_sees_nothing_hangs_on_its_edge() -> None:
    rng = np.random.default_rng(7)
    truth = scene(rng)
    seen = measured(truth, rng)
    seen = seen[seen.camera < CAMERAS - 1]
    T = truth.T_world_camera
    step = se3.inverse(T[-2]) @ T[-1]
    held = [Edge(CAMERAS - 2, CAMERAS - 1, step, 1e6 * np.eye(6))]
    found = adjust(disturbed(truth, rng), seen, held, MODEL, ITERATIONS)
    moved = se3.inverse(found.T_world_camera[-2]) @ found.T_world_camera[-1]
    np.testing.assert_allclose(moved, step, atol=1e-6)
    assert np.isfinite(covariances(found, seen, held, MODEL)).all()


def test_what_nothing_sees_stays_and_has_no_covariance() -> None:
    rng = np.random.default_rng(8)
    truth = scene(rng)
    seen = measured(truth, rng)
    seen = seen[(seen.camera != 2) & (seen.landmark != 5)]
    start = disturbed(truth, rng)
    found = adjust(start, seen, [], MODEL, ITERATIONS)
    np.testing.assert_array_equal(found.T_world_camera[2], start.T_world_camera[2])
    np.testing.assert_array_equal(found.points_world[5], start.points_world[5])
    covariance = covariances(found, seen, [], MODEL)
    assert np.isnan(covariance[2]).all()
    assert np.isfinite(np.delete(covariance, 2, 0)).all()


def test_arguments_are_left_alone_and_the_result_is_the_same_again() -> None:
    rng = np.random.default_rng(9)
    truth = scene(rng)
    seen, start = measured(truth, rng), disturbed(truth, rng)
    before = start.T_world_camera.tobytes(), start.points_world.tobytes()
    first, second = (adjust(start, seen, [], MODEL, ITERATIONS) for _ in range(2))
    assert before == (start.T_world_camera.tobytes(), start.points_world.tobytes())
    assert first.T_world_camera.tobytes() == second.T_world_camera.tobytes()
    assert first.points_world.tobytes() == second.points_world.tobytes()


def test_each_camera_has_its_own_intrinsics() -> None:
    rng = np.random.default_rng(10)
    truth = scene(rng)
    seen = measured(truth, rng, 0)
    tele = Intrinsics(640, 480, 800.0, 810.0, 300.0, 250.0)
    mine = seen.camera == 3
    points = se3.transform(se3.inverse(truth.T_world_camera[3]), truth.points_world)
    seen.px[mine] = tele.project(points)[seen.landmark[mine]]
    model = SensorModel([CAMERA] * 3 + [tele] + [CAMERA] * (CAMERAS - 4), CONFIG)
    assert model.rms_px(truth, seen) < 1e-9
    found = adjust(disturbed(truth, rng), seen, [], model, ITERATIONS)
    np.testing.assert_allclose(found.T_world_camera, truth.T_world_camera, atol=1e-4)


def test_residuals_are_in_standard_deviations() -> None:
    truth = scene(np.random.default_rng(11))
    seen = measured(truth, np.random.default_rng(11), 0)
    off = Observations(
        seen.landmark,
        seen.camera,
        seen.px + [3 * CONFIG.pixel_sigma_px, 0],
        seen.inverse_depth + 4 * CONFIG.depth_sigma_per_m2,
    )
    np.testing.assert_allclose(MODEL.squared_residuals(truth, off), 3**2 + 4**2)
    blind = without_depth(off, np.arange(len(off)))
    np.testing.assert_allclose(MODEL.squared_residuals(truth, blind), 3**2)
    assert MODEL.rms_px(truth, off) == pytest.approx(3 * CONFIG.pixel_sigma_px)


def test_a_point_behind_its_camera_fits_nothing() -> None:
    truth = scene(np.random.default_rng(12))
    behind = Bundle(truth.T_world_camera, truth.points_world * [1, 1, -1])
    seen = measured(truth, np.random.default_rng(12))
    assert np.isinf(MODEL.squared_residuals(behind, seen)).all()


def test_one_pixel_alone_fixes_no_point() -> None:
    truth = scene(np.random.default_rng(13))
    seen = measured(truth, np.random.default_rng(13))[:POINTS]
    assert np.isfinite(MODEL.point_sigmas(truth, seen)).all()
    blind = without_depth(seen, np.arange(POINTS))
    assert np.isinf(MODEL.point_sigmas(truth, blind)).all()


def test_without_observations_nothing_moves_and_nothing_is_known() -> None:
    truth = scene(np.random.default_rng(15))
    none = measured(truth, np.random.default_rng(15))[np.zeros(0, np.intp)]
    found = adjust(truth, none, [], MODEL, ITERATIONS)
    np.testing.assert_array_equal(found.T_world_camera, truth.T_world_camera)
    np.testing.assert_array_equal(found.points_world, truth.points_world)
    assert np.isnan(covariances(truth, none, [], MODEL)).all()


def test_no_observations_have_no_error() -> None:
    truth = scene(np.random.default_rng(14))
    none = measured(truth, np.random.default_rng(14))[np.zeros(0, np.intp)]
    assert np.isnan(MODEL.rms_px(truth, none))
    assert MODEL.squared_residuals(truth, none).shape == (0,)
    assert np.isinf(MODEL.point_sigmas(truth, none)).all()


@pytest.mark.parametrize("noise", [0.3, 0.7])
def test_the_noise_is_found_in_the_residuals(noise: float) -> None:
    # 360 residuals tell their spread within 10 % (two standard deviations); points and poses take
    # up a little more than what is allowed for.
    rng = np.random.default_rng(11)
    truth = scene(rng)
    seen = measured(truth, rng, noise)
    fitted = MODEL.fitted(adjust(truth, seen, [], MODEL, ITERATIONS), seen)
    assert fitted.pixel_sigma == pytest.approx(noise * CONFIG.pixel_sigma_px, rel=0.15)
    assert fitted.depth_sigma == pytest.approx(noise * CONFIG.depth_sigma_per_m2, rel=0.15)


def test_noise_is_never_taken_for_more_than_the_settings_say() -> None:
    rng = np.random.default_rng(12)
    truth = scene(rng)
    fitted = MODEL.fitted(truth, measured(truth, rng, 3.0))
    assert (fitted.pixel_sigma, fitted.depth_sigma) == (MODEL.pixel_sigma, MODEL.depth_sigma)


def test_few_or_short_tracks_tell_no_noise() -> None:
    rng = np.random.default_rng(13)
    truth = scene(rng)
    seen = measured(truth, rng, 0.3)
    assert MODEL.fitted(truth, seen[seen.camera < 2]) is MODEL
    assert MODEL.fitted(truth, seen[seen.landmark < 5]) is MODEL


def sharp(noise: float) -> SensorModel:
    """A sensor with that share of the settings' noise."""
    config = dataclasses.replace(
        CONFIG,
        pixel_sigma_px=noise * CONFIG.pixel_sigma_px,
        depth_sigma_per_m2=noise * CONFIG.depth_sigma_per_m2,
    )
    return SensorModel([CAMERA] * CAMERAS, config)


# At a hundredth of the noise the scene tells an offset to 2e-5 1/m (its scatter over 12 seeds),
# a tenth of the prior's sigma, which so draws by a hundredth.
TOLD = 4 * 2e-5


@pytest.mark.parametrize("offset", [-2e-4, 0.0, 1e-4])
def test_an_offset_of_all_inverse_depths_is_found(offset: float) -> None:
    rng = np.random.default_rng(16)
    truth = scene(rng)
    seen = with_offset(measured(truth, rng, 0.01), offset)
    assert depth_offset(truth, seen, sharp(0.01)) == pytest.approx(offset, abs=TOLD)


def test_depth_that_is_wrong_by_a_scale_has_no_offset() -> None:
    # 0.2 % is 4e-4 to 1e-3 1/m here: as an offset it would be two sigmas of the prior and more.
    rng = np.random.default_rng(17)
    truth = scene(rng)
    seen = measured(truth, rng, 0.01)
    scaled = dataclasses.replace(seen, inverse_depth=1.002 * seen.inverse_depth)
    assert depth_offset(truth, scaled, sharp(0.01)) == pytest.approx(0, abs=TOLD)


def test_an_offset_that_noise_hides_is_not_guessed() -> None:
    # Known to 2e-3 1/m only, so that the prior leaves a hundredth of what seems to be.
    rng = np.random.default_rng(18)
    truth = scene(rng)
    seen = with_offset(measured(truth, rng), PRIOR_SIGMAS[0])
    assert depth_offset(truth, seen, MODEL) == pytest.approx(0, abs=PRIOR_SIGMAS[0] / 2)


def test_a_step_leads_to_the_optimum_of_the_bundle() -> None:
    rng = np.random.default_rng(19)
    truth = scene(rng)
    seen = measured(truth, rng)
    problem, none = BundleProblem(seen, [], MODEL), np.zeros((len(seen), 3, 0))
    best = bundle.adjust(truth, problem, ITERATIONS, tolerance=0.0)
    found = truth
    for _ in range(12):
        found = calibrating_step(found, problem, none, np.zeros(0), np.zeros(0)).bundle
    # A hundredth of a pose's sigma, which is a millimetre and more.
    np.testing.assert_allclose(found.T_world_camera, best.T_world_camera, atol=1e-5)


def test_the_step_says_how_well_it_knows_the_offset() -> None:
    """Of sixteen scenes the mean square of errors in sigmas is 1 +- 0.35, less for careful ones."""
    errors = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        truth = scene(rng)
        seen = measured(truth, rng, 0.1)
        by_error = np.tile([[0.0], [0.0], [1.0]], (len(seen), 1, 1))
        problem = BundleProblem(seen, [], sharp(0.1))
        step = calibrating_step(truth, problem, by_error, np.zeros(1), np.array([1.0]))
        errors.append(step.change[0] / step.sigmas[0])
    assert 0.2 < np.mean(np.square(errors)) < 2


def test_what_errs_together_is_told_no_better_by_more_observations() -> None:
    """Sixteen times as many tell an error four times as well, but for what they have in common.

    A thousandth of the noise is little beside that of 360 observations, and much beside 5760.
    """
    rng = np.random.default_rng(20)
    truth = scene(rng)
    seen = measured(truth, rng, 0.01)
    common = np.array([CONFIG.depth_sigma_per_m2 / 10])
    alone = [sigma_of_offset(truth, seen, times, 0.0) for times in (1, 16)]
    together = [sigma_of_offset(truth, seen, times, common) for times in (1, 16)]
    assert alone[0] / alone[1] == pytest.approx(4, rel=0.05)
    assert together[0] > alone[0]
    assert together[0] / together[1] < 1.4


def test_a_step_tells_where_noise_alone_would_have_led() -> None:
    rng = np.random.default_rng(21)
    truth = scene(rng)
    seen = with_offset(measured(truth, rng, 0.01), 3e-4)
    by_error = np.tile([[0.0], [0.0], [1.0]], (len(seen), 1, 1))
    problem = BundleProblem(seen, [], sharp(0.01))
    asked = truth, problem, by_error, np.zeros(1), PRIOR_SIGMAS[:1]
    alone, common = calibrating_step(*asked), calibrating_step(*asked, np.array([1e-5]))
    assert alone.by_noise == pytest.approx(alone.change)
    assert common.by_noise == pytest.approx(alone.change)
    assert 0 < common.change[0] < 0.8 * alone.change[0]


def sigma_of_offset(
    truth: Bundle, seen: Observations, times: int, systematic: np.ndarray | float
) -> float:
    """Where each observation was made so many times."""
    again = seen[np.tile(np.arange(len(seen)), times)]
    by_error = np.tile([[0.0], [0.0], [1.0]], (len(again), 1, 1))
    problem = BundleProblem(again, [], MODEL)
    asked = np.zeros(1), np.array([1.0]), systematic
    return float(calibrating_step(truth, problem, by_error, *asked).sigmas[0])


def seen_of_last(seen: Observations, count: int) -> Observations:
    """The last camera sees so many points only, without depth."""
    of_last = np.flatnonzero(seen.camera == CAMERAS - 1)
    seen = without_depth(seen, of_last)
    return seen[np.setdiff1d(np.arange(len(seen)), of_last[count:])]


def test_a_first_camera_that_hardly_holds_to_the_others_makes_none_of_these_unsure() -> None:
    rng = np.random.default_rng(30)
    truth = scene(rng)
    seen = measured(truth, rng)
    of_first = np.flatnonzero(seen.camera == 0)
    few = without_depth(seen, of_first)[np.setdiff1d(np.arange(len(seen)), of_first[4:])]
    sigmas, before = (
        np.sqrt(np.diagonal(covariances(truth, s, [], MODEL), axis1=1, axis2=2))
        for s in (few, seen)
    )
    assert sigmas[1:].max() < 2 * before.max() < 0.4 * sigmas[0].max()


@pytest.mark.parametrize("count", [1, 2])
def test_a_camera_that_sees_too_little_is_as_unsure_as_can_be(
    count: int,
) -> None:
    rng = np.random.default_rng(30)
    truth = scene(rng)
    seen = measured(truth, rng)
    found = covariances(truth, seen_of_last(seen, count), [], MODEL)
    sigmas = np.sqrt(np.diagonal(found, axis1=1, axis2=2))
    assert sigmas[-1].max() > 0.5 * bundle.UNKNOWN_SIGMA
    others = np.sqrt(np.diagonal(covariances(truth, seen, [], MODEL), axis1=1, axis2=2))
    np.testing.assert_allclose(sigmas[1:-1], others[1:-1], rtol=0.2)


def test_a_landmark_that_nothing_determines_changes_no_camera() -> None:
    rng = np.random.default_rng(31)
    truth = scene(rng)
    seen = measured(truth, rng)
    of_one = np.flatnonzero(seen.landmark == 3)
    known = np.setdiff1d(np.arange(len(seen)), of_one)
    once = without_depth(seen, of_one)[np.append(known, of_one[0])]
    expected = covariances(truth, seen[known], [], MODEL)
    np.testing.assert_allclose(covariances(truth, once, [], MODEL), expected, rtol=1e-3, atol=1e-9)


def test_a_landmark_near_by_that_many_see_along_one_ray_changes_no_camera() -> None:
    # 100 pixels tell where the ray goes to 0.2 mm; how far along it, to what holds it: 1 m.
    rng = np.random.default_rng(32)
    truth = scene(rng)
    seen = measured(truth, rng)
    camera = np.zeros(100, np.int32)
    ray = Observations(
        np.full(100, POINTS, np.int32), camera, np.full((100, 2), 240.0), np.full(100, np.nan)
    )
    parts = zip(vars(seen).values(), vars(ray).values(), strict=True)
    with_ray = Observations(*map(np.concatenate, parts))
    on_it = CAMERA.unproject(np.array([240.0, 240.0]), np.array(0.5))
    longer = Bundle(truth.T_world_camera, np.vstack([truth.points_world, on_it]))
    expected = covariances(truth, seen, [], MODEL)
    np.testing.assert_allclose(
        covariances(longer, with_ray, [], MODEL), expected, rtol=1e-3, atol=1e-9
    )
