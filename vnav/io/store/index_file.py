"""The index on disk: index/index.npz, uncompressed, so that it loads at once."""

from pathlib import Path

from vnav.core.map_index import MapIndex
from vnav.core.tree import VocabularyTree
from vnav.io.formats.arrays_file import save_arrays
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.schemas import load_table


def write_index(draft: Path, index: MapIndex) -> None:
    """Write the index into the draft of its stage."""
    save_arrays(draft / "index.npz", **{name: getattr(index, name) for name in MapIndex.names()})


def load_index(folder: MapFolder, tree: VocabularyTree) -> MapIndex:
    """The map's index, which was made by its tree.

    StaleArtifact where it was not made, MapError where it is damaged.
    """
    mend = f"run 'vnav index --map {folder.root}' again"
    return MapIndex(**load_table(folder, "index", "index", mend, {"T": len(tree.centres)}))
