"""A damaged tree or index is told, never a traceback."""

import shutil
from pathlib import Path

import pytest

from vnav.errors import MapError, StaleArtifact
from vnav.io.store.index_file import load_index
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.tree_file import load_tree

LOADERS = {
    "vocabulary/tree.npz": load_tree,
    "index/index.npz": lambda folder: load_index(folder, load_tree(folder)),
}


@pytest.mark.parametrize("name", LOADERS)
@pytest.mark.parametrize("kept", [0, 100, -50])
def test_a_truncated_file_is_named_with_the_command_that_mends_it(
    name: str, kept: int, whole_map: Path, tmp_path: Path
) -> None:
    folder = MapFolder(shutil.copytree(whole_map, tmp_path / "map"))
    path = folder.root / name
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(StaleArtifact, match=f"{path}.*run 'vnav {name.split('/')[0]} "):
        LOADERS[name](folder)


@pytest.mark.parametrize("name", LOADERS)
def test_a_file_of_other_arrays_is_named(name: str, whole_map: Path, tmp_path: Path) -> None:
    folder = MapFolder(shutil.copytree(whole_map, tmp_path / "map"))
    stage, file = name.split("/")
    with folder.writing(stage, {}, {}) as draft:
        shutil.copy(whole_map / "odometry" / "edges.npz", draft / file)
    with pytest.raises(MapError, match=f"expected '.*' as vnav writes it.*run 'vnav {stage} "):
        LOADERS[name](folder)
