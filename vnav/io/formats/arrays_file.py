"""Arrays on disk: npz, uncompressed, never pickled."""

import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.errors import MapError

DAMAGED = (  # what numpy and zipfile raise for files that are not theirs
    *(OSError, ValueError, EOFError, KeyError, IndexError, TypeError, AttributeError, SyntaxError),
    *(RuntimeError, MemoryError, OverflowError, zipfile.BadZipFile, zlib.error, struct.error),
)
Arrays = dict[str, NDArray[Any]]


def save_arrays(path: Path, **arrays: NDArray[Any]) -> None:
    """Write arrays under their names; the same arrays give the same bytes."""
    with path.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def load_arrays(path: Path, mend: str) -> Arrays:
    """All arrays of a file; MapError, with the command that mends it, where it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    except DAMAGED as error:
        raise MapError(f"expected arrays in {path}, found: {error}; {mend}") from error
