"""The vocabulary tree on disk: vocabulary/tree.npz."""

from pathlib import Path

import numpy as np

from vnav.core.tree import VocabularyTree
from vnav.errors import MapError
from vnav.io.map_folder import MapFolder

NAME = "tree.npz"


def write_tree(draft: Path, tree: VocabularyTree) -> None:
    """Write the tree into the draft of its stage, uncompressed, so that it loads at once."""
    with (draft / NAME).open("wb") as file:
        np.savez(file, **tree.to_arrays())  # type: ignore[arg-type]


def load_tree(folder: MapFolder) -> VocabularyTree:
    """The map's tree; StaleArtifact where it was not made, MapError where it is damaged."""
    path = folder.stage("vocabulary") / NAME
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return VocabularyTree.from_arrays(arrays)
    except (OSError, ValueError, KeyError) as error:
        raise MapError(
            f"expected a vocabulary tree in {path}, found: {error};"
            f" run 'vnav vocabulary --map {folder.root}' again"
        ) from error
