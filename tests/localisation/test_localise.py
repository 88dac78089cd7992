import dataclasses

import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.config.registries import SEARCHES
from vnav.core import se3
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.features.sift import SPACE
from vnav.io.photos.photo_files import CENTRE_SIGMA, DISTORTION_SIGMA, EXIF_SIGMA
from vnav.localisation import localise as rooms
from vnav.localisation.localise import localise
from vnav.localisation.photo import prepare
from vnav.localisation.prior import PlacePrior
from vnav.localisation.query import Query
from vnav.localisation.verdict.decision import Located, NotLocated
from vnav.localisation.verdict.uncertainty import focal_length_check, sigmas

CONFIG = LocateConfig()
POSE = (0.4, -0.3, 1.5), 40.0


def asked(world, features, *, config=CONFIG, camera=None, seed=0, prior=None):
    photo = prepare(features, camera or CameraPrior(world.camera), world.database.tree)
    query = Query(photo, world.database, config)
    return localise(query, np.random.default_rng(seed), prior), query


def errors(result, T_true):
    T = result.best.view.T_world_camera
    off = se3.rotation_angle(T[:3, :3].T @ T_true[:3, :3])
    return np.linalg.norm(T[:3, 3] - T_true[:3, 3]), float(off)


@pytest.fixture
def photo_features(world):
    T = world.looking(*POSE)
    return T, world.seen(T, world.things, np.random.default_rng(5))[0]


def test_a_photo_is_found_where_it_was_taken(world, photo_features):
    T_true, features = photo_features
    result, _ = asked(world, features)
    assert isinstance(result, Located)
    error_m, error_rad = errors(result, T_true)
    # About 100 inliers of 0.5 px at 525 px focal length and 3 m: below 1 mm and 0.1 mrad each;
    # the landmarks' 5 mm and the keyframes' noise leave a few millimetres.
    assert error_m < 0.01
    assert error_rad < 0.005


@pytest.mark.parametrize("solver", ["p3p", "dlt"])
def test_both_solvers_find_it(world, photo_features, solver):
    T_true, features = photo_features
    result, _ = asked(world, features, config=dataclasses.replace(CONFIG, solver=solver))
    assert isinstance(result, Located)
    assert errors(result, T_true)[0] < 0.01


def test_the_patents_levels_find_it(world, photo_features):
    T_true, features = photo_features
    levels = dataclasses.replace(CONFIG, level_2d_3d=3, level_3d_2d=5)
    result, _ = asked(world, features, config=levels)
    assert isinstance(result, Located)
    assert errors(result, T_true)[0] < 0.01


def test_a_photo_turned_on_its_side_is_found(world):
    T_true = world.looking(*POSE)
    T_true[:3, :3] = T_true[:3, :3] @ se3.exp_so3([0, 0, np.pi / 2])
    features, _ = world.seen(T_true, world.things, np.random.default_rng(6))
    result, _ = asked(world, features)
    assert isinstance(result, Located)
    assert errors(result, T_true)[0] < 0.01


def test_an_unknown_focal_length_is_found_with_its_uncertainty(world):
    camera = dataclasses.replace(world.camera, fx=640.0, fy=640.0)
    T_true = world.looking(*POSE)
    features, _ = world.seen(T_true, world.things, np.random.default_rng(7), camera=camera)
    result, _ = asked(world, features, camera=CameraPrior(world.camera, np.inf))  # 525 is the guess
    assert isinstance(result, Located)
    found, sigma = result.best.view.intrinsics.fx, sigmas(result.best, world.database.index).focal
    assert abs(found / 640 - 1) < 4 * sigma
    assert 0 < sigma < 0.01
    assert errors(result, T_true)[0] < 0.05


def roughly(focal_px, focal_sigma):
    """What is known of a camera that is not told."""
    camera = Intrinsics(640, 480, focal_px, focal_px, 319.5, 239.5)
    return CameraPrior(camera, focal_sigma, CENTRE_SIGMA, DISTORTION_SIGMA)


UNKNOWN, OF_EXIF = roughly(525.0, np.inf), roughly(650.0, EXIF_SIGMA)


@pytest.mark.parametrize("told", [UNKNOWN, OF_EXIF], ids=["unknown", "EXIF"])
@pytest.mark.parametrize("left_px", [0.0, 120.0, 250.0])
def test_a_cropped_photo_is_found_though_its_camera_is_not_told(world, left_px, told):
    """Cut off at the left; the middle of the image is where search starts."""
    camera = dataclasses.replace(world.camera, fx=640.0, fy=640.0, cx=world.camera.cx - left_px)
    T_true = world.looking(*POSE)
    features, _ = world.seen(T_true, world.things, np.random.default_rng(7), camera=camera)
    result, _ = asked(world, features, camera=told)
    assert isinstance(result, Located)
    sigma = sigmas(result.best, world.database.index)
    off_m, off_rad = errors(result, T_true)
    assert off_m < min(0.05, 4 * np.linalg.norm(sigma.position_m))
    assert off_rad < 4 * np.linalg.norm(sigma.rotation_rad)
    assert abs(result.best.view.intrinsics.cx - camera.cx) < 10


def test_a_camera_that_is_not_known_leaves_a_pose_less_certain(world, photo_features):
    _, features = photo_features
    answers = (asked(world, features, camera=c)[0] for c in (None, UNKNOWN))
    of_known, of_unknown = (sigmas(r.best, world.database.index) for r in answers)
    assert (of_unknown.position_m > 2 * of_known.position_m).all()


def test_a_wrong_focal_length_is_noticed(world):
    camera = dataclasses.replace(world.camera, fx=570.0, fy=570.0)
    features, _ = world.seen(
        world.looking(*POSE), world.things, np.random.default_rng(8), camera=camera
    )
    result, query = asked(world, features)  # taken for 525
    assert isinstance(result, Located)
    factor, sigma = focal_length_check(result.best, query)
    assert factor == pytest.approx(570 / 525, abs=0.02)
    assert factor - 1 > 3 * sigma


def test_the_right_focal_length_is_not_doubted(world, photo_features):
    result, query = asked(world, photo_features[1])
    factor, sigma = focal_length_check(result.best, query)
    assert abs(factor - 1) < 4 * sigma


def test_a_photo_of_another_room_is_not_located(world, other_room):
    features, _ = world.seen(world.looking(*POSE), other_room, np.random.default_rng(9))
    result, _ = asked(world, features)
    assert isinstance(result, NotLocated)
    assert result.reason in ("too few matches", "no consistent pose")


def test_two_rooms_that_look_the_same_are_ambiguous(twin_world):
    T_true = twin_world.looking(*POSE)
    features, _ = twin_world.seen(T_true, twin_world.things, np.random.default_rng(10))
    result, _ = asked(twin_world, features)
    assert isinstance(result, NotLocated)
    assert result.reason == "ambiguous"
    centres = [h.view.centre_world for h in result.hypotheses[:2]]
    assert abs(centres[0][0] - centres[1][0]) == pytest.approx(20, abs=0.05)
    assert min(result.chances[:2]) > 0.1


def test_a_view_of_what_only_one_of_two_rooms_has_is_located(furnished_twins):
    for x0 in (0, 20):
        T_true = furnished_twins.looking((x0 + 0.3, -0.2, 1.4), 5.0)
        features, _ = furnished_twins.seen(
            T_true, furnished_twins.things, np.random.default_rng(12 + x0)
        )
        result, _ = asked(furnished_twins, features)
        assert isinstance(result, Located)
        assert errors(result, T_true)[0] < 0.02


@pytest.mark.parametrize("search", sorted(SEARCHES))
@pytest.mark.parametrize("enough", [25, CONFIG.enough_matches])
def test_a_view_of_what_both_rooms_have_is_ambiguous(furnished_twins, search, enough):
    """By any search: one that has enough in the first room that matches is told of the other."""
    T_true = furnished_twins.looking((0.3, -0.2, 1.4), 185.0)
    features, _ = furnished_twins.seen(T_true, furnished_twins.things, np.random.default_rng(13))
    config = dataclasses.replace(CONFIG, search=search, enough_matches=enough)
    result, _ = asked(furnished_twins, features, config=config)
    assert isinstance(result, NotLocated)
    assert result.reason == "ambiguous"


@pytest.mark.parametrize("x0", [0, 20])
def test_a_photo_before_in_one_of_two_rooms_tells_which_it_is(furnished_twins, x0):
    """And a pose that is not given without it says so."""
    T_true = furnished_twins.looking((x0 + 0.3, -0.2, 1.4), 185.0)
    features, _ = furnished_twins.seen(T_true, furnished_twins.things, np.random.default_rng(13))
    prior = PlacePrior("before.jpg", T_true[:3, 3] + [0.5, 0, 0], 0.99, step_m=1.0, told=98)
    result, _ = asked(furnished_twins, features, prior=prior)
    assert isinstance(result, Located)
    assert errors(result, T_true)[0] < 0.01  # as without a rival
    assert result.prior is prior


def test_in_rooms_that_look_the_same_no_pose_is_wrong(furnished_twins):
    """All around: whatever is located, is located in the right room."""
    located = 0
    for k, heading_deg in enumerate(range(0, 360, 45)):
        T_true = furnished_twins.looking((20.2, 0.1, 1.5), heading_deg)
        features, _ = furnished_twins.seen(
            T_true, furnished_twins.things, np.random.default_rng(20 + k)
        )
        result, _ = asked(furnished_twins, features)
        if isinstance(result, Located):
            located += 1
            assert errors(result, T_true)[0] < 0.02
    assert located > 0


def test_before_a_shelf_that_repeats_itself_a_thing_that_was_moved_tells_no_place(shelf_world):
    """A cart was pushed on by one board: it says one place, the shelf says any."""
    moved = shelf_world.cart.moved((0.0, shelf_world.period_m, 0.0))
    features, _ = shelf_world.seen(
        shelf_world.looking((0.2, 0.1, 1.4), 2.0),
        shelf_world.shelf + moved,
        np.random.default_rng(11),
    )
    result, _ = asked(shelf_world, features)
    assert isinstance(result, NotLocated)
    assert result.reason == "ambiguous"


def test_the_confidence_of_a_clear_answer_is_high(world, photo_features):
    result, _ = asked(world, photo_features[1])
    assert 0.97 < result.confidence <= 1
    assert result.chances[0] >= result.confidence


def test_a_pose_that_may_be_far_off_is_not_given(world, photo_features):
    """Keypoints that are good to 200 pixels only tell the place, not the pose."""
    vague = dataclasses.replace(CONFIG, pixel_sigma_px=200.0)
    result, _ = asked(world, photo_features[1], config=vague)
    assert isinstance(result, NotLocated)
    assert result.reason.startswith("the pose is too uncertain: give or take")


def test_few_matches_are_a_reason(world):
    """Features enough, but of nothing that the map has."""
    rng = np.random.default_rng(14)
    features, _ = world.seen(world.looking(*POSE), world.things, rng, found=0.0, clutter=200)
    result, _ = asked(world, features)
    assert isinstance(result, NotLocated)
    assert result.reason == "too few matches"


def test_a_picture_of_a_mapped_picture_in_an_unknown_place_is_not_located(world, other_room):
    """A few square decimetres look as on the map, all around them nothing does."""
    near = np.linalg.norm(world.things.points - [2.7, 0.5, 1.5], axis=1) < 0.7
    assert near.sum() > 15
    picture = type(world.things)(
        world.things.points[near], world.things.patches[near], world.things.descriptors[near]
    )
    around = np.linalg.norm(other_room.points - [2.7, 0.5, 1.5], axis=1) > 0.9
    rest = type(world.things)(
        other_room.points[around], other_room.patches[around], other_room.descriptors[around]
    )
    features, _ = world.seen(
        world.looking((0.2, 0.0, 1.4), 10.0), picture + rest, np.random.default_rng(11), found=1.0
    )
    result, _ = asked(world, features)
    assert isinstance(result, NotLocated)


def test_few_features_are_a_reason(world, photo_features):
    result, _ = asked(world, photo_features[1][np.arange(10)])
    assert isinstance(result, NotLocated)
    assert result.reason == "too few features"


def test_no_features_at_all_are_legal(world, photo_features):
    result, _ = asked(world, photo_features[1][np.arange(0)])
    assert isinstance(result, NotLocated)


def test_an_empty_map_locates_nothing(world, photo_features):
    from vnav.config import IndexConfig, VocabularyConfig
    from vnav.core.mapping import Landmarks
    from vnav.core.voxels import Voxels
    from vnav.localisation.database import LandmarkDatabase
    from vnav.localisation.indexing import build
    from vnav.vocabulary import train

    none = np.zeros(0, np.int32)
    landmarks = Landmarks(np.zeros((0, 3)), np.zeros(0), none, none, none)
    tree = train(SPACE.none(), SPACE, VocabularyConfig(), 0)
    nothing = Voxels.filled(np.zeros((0, 3)), np.zeros(0), 0.05)
    rng = np.random.default_rng(0)
    index = build(landmarks, none > 0, [], tree, nothing, IndexConfig(), rng)
    database = LandmarkDatabase(index, tree)
    photo = prepare(photo_features[1], CameraPrior(world.camera), tree)
    result = localise(Query(photo, database, CONFIG), np.random.default_rng(0))
    assert isinstance(result, NotLocated)
    assert result.reason == "too few matches"


def test_rivals_go_through_the_rooms_before_the_verdict(world, photo_features, monkeypatch):
    """Two rounds of search, hypotheses and verification, the displaced views, then one verdict."""
    called = []

    def noted(name, function):
        return lambda *arguments: (called.append(name), function(*arguments))[1]

    for name in ("search", "search_repeated", "hypothesise", "displaced", "verify", "decide"):
        monkeypatch.setattr(rooms, name, noted(name, getattr(rooms, name)))
    asked(world, photo_features[1])
    first, second = (
        ["search", "hypothesise", "verify"],
        ["search_repeated", "hypothesise", "verify"],
    )
    assert called == [*first, *second, "displaced", "verify", "decide"]


def test_the_answer_is_the_same_every_time(world, photo_features):
    poses = [asked(world, photo_features[1])[0].best.view.T_world_camera for _ in range(2)]
    np.testing.assert_array_equal(*poses)


def test_standard_deviations_tell_the_size_of_the_errors(world):
    """Over 20 photos the errors over their sigmas have a root mean square about 1.

    60 numbers of unit variance: its standard deviation is 0.09; the keyframes' noise in the
    landmarks is shared by all photos, which widens the band.
    """
    normed = []
    for k in range(20):
        rng = np.random.default_rng(100 + k)
        T_true = world.looking((*rng.uniform(-0.6, 0.6, 2), 1.4), rng.uniform(0, 360))
        result, _ = asked(world, world.seen(T_true, world.things, rng)[0])
        assert isinstance(result, Located)
        offset = result.best.view.centre_world - T_true[:3, 3]
        normed.append(offset / sigmas(result.best, world.database.index).position_m)
    assert 0.2 < np.sqrt(np.mean(np.square(normed))) < 1.5
