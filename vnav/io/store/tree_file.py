"""The vocabulary tree on disk: vocabulary/tree.npz."""

from pathlib import Path

from vnav.core.tree import VocabularyTree
from vnav.errors import MapError
from vnav.io.formats.arrays_file import load_arrays, save_arrays
from vnav.io.store.map_folder import MapFolder

NAME = "tree.npz"


def write_tree(draft: Path, tree: VocabularyTree) -> None:
    """Write the tree into the draft of its stage."""
    save_arrays(draft / NAME, **tree.to_arrays())


def load_tree(folder: MapFolder) -> VocabularyTree:
    """The map's tree; StaleArtifact where it was not made, MapError where it is damaged."""
    path = folder.file("vocabulary", NAME)
    mend = f"run 'vnav vocabulary --map {folder.root}' again"
    try:
        return VocabularyTree.from_arrays(load_arrays(path, mend))
    except (ValueError, KeyError) as error:
        raise MapError(f"expected a vocabulary tree in {path}, found: {error}; {mend}") from error
