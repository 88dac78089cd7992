"""The index on disk: index/index.npz, uncompressed, so that it loads at once."""

from pathlib import Path

import numpy as np

from vnav.core.map_index import MapIndex
from vnav.core.tree import VocabularyTree
from vnav.io.formats.arrays_file import save_arrays
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.schemas import load_table


def write_index(draft: Path, index: MapIndex) -> None:
    """Write the index into the draft of its stage."""
    arrays = {name: getattr(index, name) for name in MapIndex.names()}
    save_arrays(draft / "index.npz", **arrays | {"descriptors": index.descriptors.view(np.uint8)})


def load_index(folder: MapFolder, tree: VocabularyTree) -> MapIndex:
    """The map's index, which was made by its tree.

    StaleArtifact where it was not made, MapError where it is damaged.
    """
    mend = f"run 'vnav index --map {folder.root}' again"
    sizes = {"T": len(tree.centres), "W": tree.space.size}
    arrays = load_table(folder, "index", "index", mend, sizes)
    described = arrays["descriptors"].view(tree.space.dtype)
    return MapIndex(**arrays | {"descriptors": described})
