"""The index on disk: index/index.npz, uncompressed, so that it loads at once."""

from pathlib import Path

from vnav.core.map_index import MapIndex
from vnav.errors import MapError
from vnav.io.formats.arrays_file import load_arrays, save_arrays
from vnav.io.store.map_folder import MapFolder

NAME = "index.npz"


def write_index(draft: Path, index: MapIndex) -> None:
    """Write the index into the draft of its stage."""
    save_arrays(draft / NAME, **{name: getattr(index, name) for name in MapIndex.names()})


def load_index(folder: MapFolder) -> MapIndex:
    """The map's index; StaleArtifact where it was not made, MapError where it is damaged."""
    path = folder.file("index", NAME)
    mend = f"run 'vnav index --map {folder.root}' again"
    try:
        return MapIndex(**load_arrays(path, mend))
    except (ValueError, TypeError) as error:
        raise MapError(f"expected an index in {path}, found: {error}; {mend}") from error
