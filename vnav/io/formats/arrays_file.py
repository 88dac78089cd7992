"""Arrays on disk: npz, uncompressed, never pickled."""

import struct
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from vnav.errors import MapError

DAMAGED = (  # what numpy and zipfile raise for files that are not theirs
    *(OSError, ValueError, EOFError, KeyError, IndexError, TypeError, AttributeError, SyntaxError),
    *(RuntimeError, MemoryError, OverflowError, zipfile.BadZipFile, zlib.error, struct.error),
)
Arrays = dict[str, NDArray[Any]]


def save_arrays(path: Path, **arrays: NDArray[Any] | list[NDArray[Any]]) -> None:
    """Write arrays under their names; the same arrays give the same bytes.

    A list of arrays is written as one, along the first axis, and is never held as one.
    """
    with zipfile.ZipFile(path, "w") as file:
        for name, array in arrays.items():
            with file.open(f"{name}.npy", "w", force_zip64=True) as member:
                _write(member, array)


def _write(file: IO[bytes], array: NDArray[Any] | list[NDArray[Any]]) -> None:
    if not isinstance(array, list):
        npy.write_array(file, array, allow_pickle=False)
        return
    first = array[0]
    shape = (sum(len(part) for part in array), *first.shape[1:])
    description = npy.dtype_to_descr(first.dtype)
    head = {"descr": description, "fortran_order": False, "shape": shape}
    npy.write_array_header_1_0(file, head)
    for part in array:
        file.write(np.ascontiguousarray(part).data)


def load_arrays(path: Path, mend: str) -> Arrays:
    """All arrays of a file; MapError, with the command that mends it, where it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    except DAMAGED as error:
        raise MapError(f"expected arrays in {path}, found: {error}; {mend}") from error
