"""The vocabulary tree on disk: vocabulary/tree.npz."""

from pathlib import Path

import numpy as np

from vnav.core.tree import VocabularyTree
from vnav.io.formats.arrays_file import save_arrays
from vnav.io.store.artifacts import load_descriptor_space
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.schemas import load_table


def write_tree(draft: Path, tree: VocabularyTree) -> None:
    """Write the tree into the draft of its stage."""
    save_arrays(draft / "tree.npz", **tree.to_arrays() | {"centres": tree.centres.view(np.uint8)})


def load_tree(folder: MapFolder) -> VocabularyTree:
    """The map's tree; StaleArtifact where it was not made, MapError where it is damaged."""
    mend, space = f"run 'vnav vocabulary --map {folder.root}' again", load_descriptor_space(folder)
    arrays = load_table(folder, "vocabulary", "tree", mend, {"W": space.size})
    followed = int(arrays.pop("paths_followed", np.array(1)))
    arrays["centres"] = arrays["centres"].view(space.dtype)
    return VocabularyTree(**arrays, space=space, paths_followed=followed)
