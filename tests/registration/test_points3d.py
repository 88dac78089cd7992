"""Two views of random points, with the noise that the settings name put into both."""

import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features, PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.features.matching import DescriptorMatcher
from vnav.features.sift import SPACE
from vnav.registration.points3d import PointRegistration

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
OTHER = Intrinsics(320, 240, 240.0, 235.0, 160.5, 118.5)
CONFIG = RegistrationConfig()
PAIR = PointRegistration(CAMERA, CAMERA, CONFIG, DescriptorMatcher(CONFIG))
MOTION = se3.exp([0.05, -0.1, 0.03, 0.15, -0.05, 0.1])  # 7 degrees and 0.19 m
TRIALS = 60
Views = tuple[FrameFeatures, FrameFeatures]


def scattered(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points (N, 3) all over the image, 1 to 5 m away."""
    px = rng.uniform([20, 20], [619, 459], (count, 2))
    return CAMERA.unproject(px, rng.uniform(1, 5, count))


def described(rng: np.random.Generator, count: int) -> np.ndarray:
    """Descriptors (N, 128), each unlike all others."""
    return rng.integers(0, 100, (count, 128)).astype(np.uint8)


def measured(
    points: np.ndarray,
    descriptors: np.ndarray,
    rng: np.random.Generator,
    camera: Intrinsics = CAMERA,
) -> FrameFeatures:
    """What the camera sees of points (N, 3) given in it, with the noise of the settings."""
    n = len(points)
    px = camera.project(points) + CONFIG.pixel_sigma_px * rng.standard_normal((n, 2))
    inverse_depth = 1 / points[:, 2] + CONFIG.depth_sigma_per_m2 * rng.standard_normal(n)
    features = Features(px, descriptors, np.ones(n), np.ones(n), np.zeros(n), SPACE)
    return FrameFeatures(0, features, camera.unproject(px, 1 / inverse_depth))


def two_views(
    rng: np.random.Generator,
    points_a: np.ndarray,
    descriptors_a: np.ndarray,
    descriptors_b: np.ndarray,
) -> Views:
    points_b = se3.transform(se3.inverse(MOTION), points_a)
    return measured(points_a, descriptors_a, rng), measured(points_b, descriptors_b, rng)


def views(seed: int, count: int = 100, wrong: float = 0.0) -> Views:
    """Two views of which a share of the features looks like another feature."""
    rng = np.random.default_rng(seed)
    descriptors = described(rng, count)
    swapped = descriptors.copy()
    swapped[: int(wrong * count)] = np.roll(swapped[: int(wrong * count)], 1, 0)
    return two_views(rng, scattered(rng, count), descriptors, swapped)


def estimated(pair: Views, seed: int = 0, predicted: np.ndarray | None = None) -> PoseEstimate:
    result = PAIR.register(*pair, np.random.default_rng(seed), predicted)
    assert isinstance(result, PoseEstimate), result
    return result


def rejected(pair: Views) -> Rejected:
    result = PAIR.register(*pair, np.random.default_rng(0))
    assert isinstance(result, Rejected), result
    return result


def normalised_error(estimate: PoseEstimate) -> float:
    """Squared error by the estimate's own information, per degree of freedom: 1 on average."""
    error = se3.inverse(MOTION) @ estimate.T_a_b
    xi = np.concatenate([se3.log_so3(error[:3, :3]), error[:3, 3]])
    return float(xi @ estimate.information @ xi) / 6


def test_without_noise_the_motion_is_exact() -> None:
    # Only float32 of points and pixels is left: 3e-5 px at 640, 100 times below the tolerance.
    rng = np.random.default_rng(0)
    points, descriptors = scattered(rng, 100), described(rng, 100)
    a, b = (
        FrameFeatures(0, Features(CAMERA.project(p), descriptors, *np.ones((3, 100)), SPACE), p)
        for p in (points, se3.transform(se3.inverse(MOTION), points))
    )
    np.testing.assert_allclose(estimated((a, b)).T_a_b, MOTION, atol=1e-5)


@pytest.mark.parametrize("wrong", [0.0, 0.4])
def test_errors_are_what_the_information_says(wrong: float) -> None:
    # Chi-squared of 6 degrees of freedom over 6 has mean 1 and scatters by 0.58, the mean of 60
    # trials by 0.07. Cauchy weights are 0.63 on average even for right matches, so an honest
    # information matrix reads 0.63 to 0.8; beyond 1.2 it would promise too much, below 0.4 it
    # would throw away more than half of what the matches tell.
    errors = [normalised_error(estimated(views(k, wrong=wrong), k)) for k in range(TRIALS)]
    assert 0.4 < np.mean(errors) < 1.2
    # The worst of 60 is beyond 24 / 6 with a chance of 60 * 0.0005 = 3 %.
    assert max(errors) < 4


@pytest.mark.parametrize("cameras", [(CAMERA, OTHER), (OTHER, CAMERA)])
def test_errors_between_two_cameras_are_what_the_information_says(
    cameras: tuple[Intrinsics, Intrinsics],
) -> None:
    # As above. With one camera's focal length for both, a pixel's noise is taken for 2.2 times
    # what it is, or for less than half: the mean would leave the limits.
    registration = PointRegistration(*cameras, CONFIG, PAIR.matcher)
    errors = []
    for k in range(TRIALS):
        rng = np.random.default_rng(k)
        points, descriptors = scattered(rng, 100), described(rng, 100)
        a = measured(points, descriptors, rng, cameras[0])
        there = se3.transform(se3.inverse(MOTION), points)
        b = measured(there, descriptors, rng, cameras[1])
        estimate = registration.register(a, b, rng)
        assert isinstance(estimate, PoseEstimate)
        errors.append(normalised_error(estimate))
    assert 0.4 < np.mean(errors) < 1.2
    assert max(errors) < 4


def test_a_third_of_the_matches_that_moves_slowly_bends_no_motion() -> None:
    # Pixels and depths are four times as exact as the settings say, and somebody's leg moved by
    # 12 mm: 1.5 to 6 px, of which the settings take the most for noise. Its own noise puts the
    # motion off by 0.5 mm; with the noise of the settings it is off by 1.9 mm.
    errors = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        points, descriptors = scattered(rng, 300), described(rng, 300)
        there = se3.transform(se3.inverse(MOTION), points)
        there[:100] += [0.012, 0, 0]
        exact = [CAMERA.project(p) + 0.25 * rng.standard_normal((300, 2)) for p in (points, there)]
        noise = CONFIG.depth_sigma_per_m2 / 4
        depths = [1 / (1 / p[:, 2] + noise * rng.standard_normal(300)) for p in (points, there)]
        a, b = (
            FrameFeatures(
                0, Features(px, descriptors, *np.ones((3, 300)), SPACE), CAMERA.unproject(px, z)
            )
            for px, z in zip(exact, depths, strict=True)
        )
        motion = estimated((a, b), seed).T_a_b
        errors.append(np.linalg.norm(motion[:3, 3] - MOTION[:3, 3]))
    assert np.mean(errors) < 0.0015


def test_more_matches_tell_more() -> None:
    # Twice the sigma for a quarter of the points; 20 % for their places.
    few, many = (estimated(views(3, count)).information for count in (100, 400))
    ratio = np.sqrt(np.diag(np.linalg.inv(few)) / np.diag(np.linalg.inv(many)))
    assert np.median(ratio) == pytest.approx(2, rel=0.2)


def test_wrong_matches_are_no_inliers() -> None:
    # A wrong match fits by chance where two of its three numbers happen to: less than 5 %.
    estimate = estimated(views(1, wrong=0.4))
    a, b = estimate.inliers.T
    assert (a == b).mean() > 0.95
    assert (a == b).sum() > 0.9 * 60


def test_features_of_b_without_depth_still_count() -> None:
    # Three quarters of b's depth are missing: no motion is fixed by 25 matches better than by 100.
    a, b = views(4)
    points = b.points_camera.copy()
    points[25:] = np.nan
    blind = estimated((a, FrameFeatures(0, b.features, points)))
    assert len(blind.inliers) > 90
    assert normalised_error(blind) < 4


def one_eyed(seed: int, count: int = 100) -> Views:
    """Two views of which every other feature has depth in a, and the others in b."""
    blind = []
    for n, view in enumerate(views(seed, count)):
        points = view.points_camera.copy()
        points[n::2] = np.nan
        points[:20] = view.points_camera[:20]  # what both have fixes the first motion
        blind.append(FrameFeatures(0, view.features, points))
    return blind[0], blind[1]


def test_where_a_has_no_depth_that_of_b_counts() -> None:
    assert len(estimated(one_eyed(4)).inliers) > 90


def test_depth_of_either_view_is_trusted_for_what_it_is() -> None:
    errors = [normalised_error(estimated(one_eyed(k), k)) for k in range(TRIALS)]
    assert 0.4 < np.mean(errors) < 1.2  # as in the test above
    assert max(errors) < 4


def test_a_prediction_finds_features_that_have_depth_in_b_only() -> None:
    estimate = estimated(one_eyed(4), predicted=MOTION)
    assert len(estimate.inliers) > 90


def test_the_other_way_round_is_the_inverse() -> None:
    # Each way weighs the same matches a little differently: equal within the noise of either.
    a, b = views(5)
    there, back = estimated((a, b)), estimated((b, a))
    apart = there.T_a_b @ back.T_a_b
    xi = np.concatenate([se3.log_so3(apart[:3, :3]), apart[:3, 3]])
    assert xi @ there.information @ xi < 6


def test_too_few_matches_are_a_reason() -> None:
    verdict = rejected(views(0, CONFIG.min_inliers - 1))
    assert verdict.reason == "too few matches"
    assert verdict.matches == CONFIG.min_inliers - 1


def test_no_features_are_too_few() -> None:
    nothing = FrameFeatures(0, views(0)[0].features[np.zeros(0, np.intp)], np.zeros((0, 3)))
    for pair in ((nothing, views(0)[1]), (views(0)[0], nothing), (nothing, nothing)):
        assert rejected(pair).reason == "too few matches"


def test_matches_that_agree_on_no_motion_are_rejected() -> None:
    # Every feature of b looks like one that lies elsewhere.
    verdict = rejected(views(0, wrong=1.0))
    assert verdict.reason in ("too few inliers", "too small a share of inliers")
    assert verdict.matches == 100
    assert verdict.inliers < CONFIG.min_inliers


def test_b_without_any_depth_is_rejected() -> None:
    a, b = views(0)
    blind = FrameFeatures(0, b.features, np.full((len(b.features), 3), np.nan))
    assert rejected((a, blind)).reason == "no consistent motion"


@pytest.mark.parametrize("thickness_m", [0.0, 0.005])
@pytest.mark.parametrize("seed", range(3))
def test_points_on_a_line_fix_no_motion(seed: int, thickness_m: float) -> None:
    # Depth noise at 3 m is 0.02 m: what spreads by less gives no rotation about the line.
    rng = np.random.default_rng(seed)
    line = np.outer(rng.uniform(-1, 1, 60), [1, 0.2, 0.3]) + [0, 0, 3]
    line += thickness_m * rng.standard_normal(line.shape)
    descriptors = described(rng, 60)
    verdict = rejected(two_views(rng, line, descriptors, descriptors))
    assert verdict.reason == "matches on a line"
    assert verdict.inliers > 50


def test_points_on_one_spot_fix_no_motion() -> None:
    rng = np.random.default_rng(0)
    descriptors = described(rng, 60)
    spot = 0.005 * rng.standard_normal((60, 3)) + [0, 0, 3]
    rejected(two_views(rng, spot, descriptors, descriptors))


def test_points_on_a_wall_fix_the_motion() -> None:
    rng = np.random.default_rng(6)
    descriptors = described(rng, 100)
    px = rng.uniform([20, 20], [619, 459], (100, 2))
    pair = two_views(rng, CAMERA.unproject(px, np.full(100, 2.5)), descriptors, descriptors)
    assert normalised_error(estimated(pair)) < 4


def test_the_same_seed_gives_the_same_bytes() -> None:
    pair = views(7, wrong=0.4)
    first, second = (estimated(pair, seed=1) for _ in range(2))
    assert first.T_a_b.tobytes() == second.T_a_b.tobytes()
    assert first.information.tobytes() == second.information.tobytes()
    assert first.inliers.tobytes() == second.inliers.tobytes()


def test_the_seed_reaches_the_sampler() -> None:
    # Refinement leads all samples to the same optimum; only its last digits know the way.
    pair = views(7, wrong=0.4)
    assert estimated(pair, seed=1).T_a_b.tobytes() != estimated(pair, seed=2).T_a_b.tobytes()


def repetitive(seed: int) -> Views:
    """Every feature has a twin elsewhere that looks the same: the ratio test fails everywhere."""
    rng = np.random.default_rng(seed)
    descriptors = np.repeat(described(rng, 50), 2, 0)
    return two_views(rng, scattered(rng, 100), descriptors, descriptors)


def test_a_prediction_tells_twins_apart_where_the_ratio_test_cannot() -> None:
    pair = repetitive(0)
    assert rejected(pair).reason == "too few matches"
    # Off by 1 degree and 2 cm, as a motion that goes on is: 10 px and, at 1 m, 10 px more.
    near = MOTION @ se3.exp([0.01, 0.01, -0.01, 0.01, -0.01, 0.01])
    estimate = estimated(pair, predicted=near)
    assert len(estimate.inliers) > 70
    assert normalised_error(estimate) < 4


def test_a_wrong_prediction_does_no_harm() -> None:
    estimate = estimated(views(8), predicted=se3.exp([0, 1.5, 0, 0, 0, 2]))
    assert normalised_error(estimate) < 4
    assert len(estimate.inliers) > 90


def test_what_b_turned_away_from_is_not_found_behind_it() -> None:
    # b looks back: nothing that it sees is what a saw, whatever the descriptors say.
    a, _ = views(9)
    behind = se3.transform(se3.inverse(se3.exp([0, np.pi, 0, 0, 0, 0])), a.points_camera)
    mirrored = behind * [1, 1, -1]
    b = measured(mirrored, a.features.descriptors, np.random.default_rng(0))
    assert rejected((a, b)).inliers < CONFIG.min_inliers


def decoyed(seed: int, wrong: np.ndarray) -> Views:
    """Where a wrong motion looks for 100 features of a, b has 30 alike, and 70 a little astray."""
    rng = np.random.default_rng(seed)
    points, descriptors = scattered(rng, 100), described(rng, 100)
    a = measured(points, descriptors, rng)
    astray = CAMERA.project(se3.transform(se3.inverse(wrong), points))
    astray[30:] += rng.uniform(-15, 15, (70, 2))
    depth = se3.transform(se3.inverse(wrong), points)[:, 2]
    similar = descriptors + rng.integers(0, 30, descriptors.shape)  # farther than the right ones
    there = np.concatenate(
        [se3.transform(se3.inverse(MOTION), points), CAMERA.unproject(astray, depth)]
    )
    return a, measured(there, np.concatenate([descriptors, similar]).astype(np.uint8), rng)


def test_a_motion_that_few_of_the_predicted_places_bear_out_gives_way_to_one_of_more() -> None:
    # 15 degrees off: the right features are out of reach of the predicted places.
    wrong = MOTION @ se3.exp([0, 0.26, 0, 0, 0, 0])
    pair = decoyed(0, wrong)
    estimate = estimated(pair, predicted=wrong)
    assert normalised_error(estimate) < 4
    assert len(estimate.inliers) > 70


def test_near_a_motion_its_own_matches_are_found_among_more_that_walk_along() -> None:
    # Somebody 1.2 m ahead, who walks as fast as the camera: his points stay where they are in it.
    rng, forward = np.random.default_rng(5), se3.exp([0, 0, 0, 0, 0, 0.06])
    room, walker = (
        scattered(rng, 80),
        CAMERA.unproject(rng.uniform(200, 440, (160, 2)), np.full(160, 1.2)),
    )
    descriptors = described(rng, 240)
    there = np.concatenate([se3.transform(se3.inverse(forward), room), walker])
    pair = (
        measured(np.concatenate([room, walker]), descriptors, rng),
        measured(there, descriptors, rng),
    )
    predicted = forward @ se3.exp([0.002, 0, 0, 0.002, 0, 0.003])

    found = PAIR.hypotheses_near(*pair, predicted)

    off = [np.linalg.norm((se3.inverse(forward) @ e.T_a_b)[:3, 3]) for e in found]
    assert min(off) < 0.005
    assert max(off) > 0.04  # that of the walker, on whom all matches together settle


def test_a_prediction_that_is_off_by_what_repeats_does_not_hide_the_right_motion() -> None:
    # A wall, every 0.3 m the same but for little; in the image 79 px, out of reach of the search.
    rng, period, count = np.random.default_rng(3), 0.3, 6
    tile = rng.uniform([-0.15, -0.8], [0.15, 0.8], (60, 2))
    x, y = np.concatenate([tile + [k * period, 0] for k in range(-count, count + 1)]).T
    wall = np.stack([x, y, np.full(len(x), 2.0)], 1)
    alike = np.tile(described(rng, len(tile)), (2 * count + 1, 1))
    descriptors = (alike + rng.integers(0, 8, alike.shape)).astype(np.uint8)
    motion, back = (se3.exp([0, 0, 0, step, 0, 0]) for step in (period, -period))
    there = wall @ motion[:3, :3] - motion[:3, 3]
    seen = [np.abs(CAMERA.project(p) - 320).max(1) < 230 for p in (wall, there)]
    a = measured(wall[seen[0]], descriptors[seen[0]], rng)
    b = measured(there[seen[1]], descriptors[seen[1]], rng)
    found = PAIR.hypotheses(a, b, rng, predicted=motion @ back)
    assert not isinstance(found, Rejected)
    off = [np.linalg.norm((se3.inverse(motion) @ e.T_a_b)[:3, 3]) for e in found]
    assert min(off) < 0.01
