"""What every search must hold; a new one in SEARCHES is tested by being there."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vnav.config import SETTINGS, Config, LocateConfig, load
from vnav.config.registries import SEARCHES, registered
from vnav.core import se3
from vnav.core.camera import CameraPrior
from vnav.errors import ConfigError
from vnav.io.formats.trajectories import read_photo_poses, read_tum
from vnav.io.store.artifacts import load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query
from vnav.localisation.search.candidates import search
from vnav.localisation.search.methods import search_method
from vnav.stages.locate import Locator

OFF_M, OFF_DEG = 0.03, 1.0  # as photos of this map are off by the default search, and as much again


@pytest.fixture(params=sorted(SEARCHES))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def locator(whole_map: Path) -> Locator:
    return Locator.open(MapFolder(whole_map), Config())


@pytest.fixture(scope="module")
def photos(tiny_capture: Path) -> list[Path]:
    return sorted((tiny_capture / "photos").glob("*.jpg"))


@pytest.fixture(scope="module")
def T_truth_world(tiny_capture: Path, whole_map: Path) -> np.ndarray:
    true = read_tum(tiny_capture / "groundtruth.txt").T_world_camera[:, :3, 3]
    return se3.align(true, load_optimised(MapFolder(whole_map)).T_world_camera[:, :3, 3])


@pytest.fixture(scope="module")
def asked(locator: Locator, photos: list[Path]) -> Query:
    """The first photo, asked of the map by the defaults."""
    return Query(locator.locate(photos[0]).photo, locator.database, LocateConfig())


def by(name: str, query: Query, **settings: object) -> Query:
    config = dataclasses.replace(query.config, search=name, **settings)
    return dataclasses.replace(query, config=config)


def test_the_search_that_the_configuration_names_is_made(name: str) -> None:
    assert type(search_method(name)) is registered(SEARCHES, name)


def test_the_choice_of_the_setting_is_the_registry() -> None:
    with pytest.raises(ConfigError, match="locate.search"):
        load(settings=["locate.search=nonsense"])
    assert set(SETTINGS["locate.search"].allowed.values) == set(SEARCHES)


def test_photos_are_located_where_they_were_taken(
    name: str, locator: Locator, photos: list[Path], tiny_capture: Path, T_truth_world: np.ndarray
) -> None:
    config = load(settings=[f"locate.search={name}"])
    answers = [dataclasses.replace(locator, config=config).locate(photo) for photo in photos]
    assert all(answer.located for answer in answers)
    truth = read_photo_poses(tiny_capture / "photos" / "groundtruth.txt")
    for answer in answers:
        error = se3.inverse(truth[answer.path.name]) @ T_truth_world @ answer.T_world_camera
        assert np.linalg.norm(error[:3, 3]) < OFF_M
        assert np.rad2deg(se3.rotation_angle(error)) < OFF_DEG


def test_most_matches_of_the_fullest_cluster_are_right(
    name: str, asked: Query, locator: Locator, photos: list[Path]
) -> None:
    """By the pose that is found: within three thresholds of an inlier."""
    best = locator.locate(photos[0]).best
    assert best is not None
    found = search(by(name, asked)).candidates[0].matches
    points = asked.correspondences(found)
    errors = best.view.squared_errors(points.points_world, points.px)
    assert (errors < (3 * asked.inlier_threshold_px) ** 2).mean() > 0.5


def test_matches_are_one_to_one(name: str, asked: Query) -> None:
    for candidate in search(by(name, asked)).candidates:
        assert len(np.unique(candidate.matches.feature)) == len(candidate.matches)
        assert len(np.unique(candidate.matches.landmark)) == len(candidate.matches)


def test_the_same_photo_has_the_same_matches(name: str, asked: Query) -> None:
    first, second = (search(by(name, asked)).matches for _ in range(2))
    assert np.array_equal(first.feature, second.feature)
    assert np.array_equal(first.landmark, second.landmark)


@pytest.mark.parametrize("few", [0, 1])
def test_hardly_any_features_have_no_candidates(name: str, asked: Query, few: int) -> None:
    features, tree = asked.photo.features[np.arange(few)], asked.database.tree
    photo = prepare(features, CameraPrior(asked.photo.intrinsics), tree)
    assert search(by(name, dataclasses.replace(asked, photo=photo))).candidates == ()
