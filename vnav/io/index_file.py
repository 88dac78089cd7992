"""The index on disk: index/index.npz, uncompressed, so that it loads at once."""

from pathlib import Path

import numpy as np

from vnav.core.map_index import MapIndex
from vnav.errors import MapError
from vnav.io.map_folder import MapFolder

NAME = "index.npz"


def write_index(draft: Path, index: MapIndex) -> None:
    """Write the index into the draft of its stage."""
    with (draft / NAME).open("wb") as file:
        np.savez(file, **{name: getattr(index, name) for name in MapIndex.names()})


def load_index(folder: MapFolder) -> MapIndex:
    """The map's index; StaleArtifact where it was not made, MapError where it is damaged."""
    path = folder.stage("index") / NAME
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return MapIndex(**{name: arrays[name] for name in MapIndex.names()})
    except (OSError, ValueError, KeyError) as error:
        raise MapError(
            f"expected an index in {path}, found: {error};"
            f" run 'vnav index --map {folder.root}' again"
        ) from error
