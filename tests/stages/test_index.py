import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config, IndexConfig, load
from vnav.errors import MapError, StaleArtifact
from vnav.io.formats.arrays_file import load_arrays, save_arrays
from vnav.io.store.artifacts import load_optimised
from vnav.io.store.index_file import load_index
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.tree_file import load_tree
from vnav.stages import index, vocabulary
from vnav.volumes.octree import Octree


@pytest.fixture
def folder(tmp_path: Path, whole_map: Path) -> MapFolder:
    """All but the index."""
    shutil.copytree(whole_map, tmp_path / "map", ignore=shutil.ignore_patterns("index"))
    return MapFolder(tmp_path / "map")


def test_every_landmark_of_the_map_is_indexed(folder: MapFolder) -> None:
    report = index.run(folder, Config())
    found = load_index(folder, load_tree(folder))
    landmarks = load_optimised(folder).landmarks
    np.testing.assert_array_equal(found.points_world, landmarks.points_world)
    assert report.values["landmarks"] == len(landmarks)
    assert report.values["descriptors"] == len(found.descriptors) >= len(landmarks)


def test_levels_that_the_tree_does_not_have_are_warned_of(folder: MapFolder) -> None:
    config = load(settings=["locate.level_3d_2d=20"])
    (warning,) = index.run(folder, config).warnings
    assert "locate.level_3d_2d" in warning


def test_landmarks_of_what_has_departed_are_kept_and_not_matched(
    folder: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    landmarks = load_optimised(folder).landmarks
    departed = np.arange(len(landmarks)) % 10 == 0
    monkeypatch.setattr(index, "load_departed", lambda *_: departed)
    report = index.run(folder, Config())
    found = load_index(folder, load_tree(folder))
    np.testing.assert_array_equal(found.retired, departed)
    np.testing.assert_array_equal(found.points_world, landmarks.points_world)
    assert not departed[found.owner].any()
    assert np.isin(np.flatnonzero(~departed), found.owner).all()
    assert report.values["retired"] == departed.sum()
    assert f"{departed.sum()} are retired" in report.lines[0]
    assert report.values["keyframes_found"] == 5


@pytest.mark.parametrize(
    ("stage", "file", "column"),
    [("optimise", "map.npz", "feature"), ("fuse", "departed.npz", "landmarks")],
)
def test_crafted_landmarks_are_refused(
    folder: MapFolder,
    altering: Callable[[MapFolder, str], AbstractContextManager[Path]],
    stage: str,
    file: str,
    column: str,
) -> None:
    with altering(folder, stage) as draft:
        arrays = load_arrays(draft / file, "")
        values = arrays[column]
        changed = values[:-1] if column == "landmarks" else values + 10**6
        save_arrays(draft / file, **arrays | {column: changed})
    with pytest.raises(MapError, match=rf"expected .*{file}"):
        index.run(folder, Config())


def test_keyframes_are_found_again(folder: MapFolder) -> None:
    report = index.run(folder, Config())
    assert report.values["keyframes_asked"] == 5
    assert report.values["keyframes_found"] == 5
    assert report.lines[0].endswith("; 5 of 5 keyframes are found again")


def test_what_is_occupied_stands_in_the_way(folder: MapFolder) -> None:
    index.run(folder, Config())
    leaves = Octree.read(folder.stage("fuse") / "occupancy.bt").leaves()
    voxels = load_index(folder, load_tree(folder)).voxels
    np.testing.assert_array_equal(voxels.stands_at(leaves.centres_world), leaves.occupied)
    outside = leaves.centres_world.max(0) + 1
    assert not voxels.stands_at(outside)


def test_an_index_that_is_up_to_date_is_kept(folder: MapFolder) -> None:
    index.run(folder, Config())
    assert index.run(folder, Config()).reused
    assert not index.run(folder, Config(index=IndexConfig(neighbours=20))).reused


def test_the_same_map_gives_the_same_bytes(folder: MapFolder) -> None:
    index.run(folder, Config())
    first = (folder.stage("index") / "index.npz").read_bytes()
    index.run(folder, Config(index=IndexConfig(neighbours=20)))
    index.run(folder, Config())
    assert (folder.stage("index") / "index.npz").read_bytes() == first


def test_without_an_index_the_command_that_makes_it_is_named(folder: MapFolder) -> None:
    with pytest.raises(StaleArtifact, match="vnav index"):
        load_index(folder, load_tree(folder))


@pytest.mark.parametrize("keep", [0, 1000])
def test_a_damaged_index_is_told(folder: MapFolder, keep: int) -> None:
    index.run(folder, Config())
    path = folder.stage("index") / "index.npz"
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(MapError, match="vnav index"):
        load_index(folder, load_tree(folder))


def test_a_damaged_tree_is_told(folder: MapFolder) -> None:
    path = folder.stage("vocabulary") / "tree.npz"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(MapError, match="vnav vocabulary"):
        load_tree(folder)


def test_the_tree_is_kept_while_nothing_changed(folder: MapFolder) -> None:
    from vnav.config import FeaturesConfig

    config = Config(features=FeaturesConfig(max_features=700))
    assert vocabulary.run(folder, config).reused


def test_an_index_of_another_format_is_made_anew(
    folder: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    index.run(folder, Config())
    monkeypatch.setattr(index, "FORMAT", index.FORMAT + 1)
    assert not index.run(folder, Config()).reused
