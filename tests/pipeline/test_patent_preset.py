"""The whole chain by the preset that follows the text of the method to the letter."""

from pathlib import Path

import numpy as np
import pytest

import vnav
from vnav.api.map import Map
from vnav.io.formats.trajectories import read_photo_poses
from vnav.io.store.artifacts import kept_rows, load_odometry
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.tree_file import load_tree
from vnav.stages.locate import Locator

pytestmark = pytest.mark.slow

ATE_M = 0.02  # without bundle adjustment: as in the chain of the other front-ends
OFF_M = 0.10


@pytest.fixture(scope="module")
def made(tiny_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Map:
    return vnav.build_map(tiny_capture, tmp_path_factory.mktemp("maps") / "map", config="patent")


@pytest.fixture(scope="module")
def folder(made: Map) -> MapFolder:
    return MapFolder.open(made.root)


def test_every_frame_is_tracked_and_fused(made: Map, folder: MapFolder, tiny_capture: Path) -> None:
    assert kept_rows(folder, 60) == list(range(60))
    assert len(load_odometry(folder).keyframes) < 60
    fused = next(r for r in made.built.reports if r.stage == "fuse")
    assert fused.values["frames"] == 60
    off = vnav.score(made.trajectory(), tiny_capture / "groundtruth.txt")
    assert off.pairs == 60
    assert off.ate.translation_m.rmse < ATE_M


def test_keyframes_are_found_by_their_numbers_among_all_frames(folder: MapFolder) -> None:
    """As where places that look alike are compared by what keyframes show of them."""
    locator, odometry = Locator.open(folder, vnav.load_config("patent")), load_odometry(folder)
    for number, row in enumerate(odometry.keyframe_rows.tolist()):
        assert locator.keyframe(number).index == odometry.frames.index[row]


def test_poses_are_those_of_the_pose_graph(made: Map) -> None:
    optimised = next(r for r in made.built.reports if r.stage == "optimise")
    assert optimised.values["rms_px_before"] == optimised.values["rms_px_after"]
    assert "without bundle adjustment" in optimised.lines[1]


def test_words_are_flat(folder: MapFolder) -> None:
    tree = load_tree(folder)
    assert (tree.level[tree.children == 0] == tree.levels).all()
    assert tree.paths_followed > 1


def test_photos_are_found_where_they_were_taken_and_a_path_joins_them(
    made: Map, tiny_capture: Path
) -> None:
    photos = sorted((tiny_capture / "photos").glob("*.jpg"))
    answers = list(made.locate_all(photos, config="patent"))
    located = [answer for answer in answers if answer.located]
    assert len(located) >= 2
    off = vnav.score(made.trajectory(), tiny_capture / "groundtruth.txt")
    truth = read_photo_poses(tiny_capture / "photos" / "groundtruth.txt")
    for answer in located:
        wanted = off.ate.T_truth_world @ answer.T_world_camera
        assert np.linalg.norm((wanted - truth[answer.path.name])[:3, 3]) < OFF_M
    assert made.plan(*located[:2], config="patent").found
