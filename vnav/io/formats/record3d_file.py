"""Files of Record3D: zips, whose members may be compressed by LZFSE once more.

LZFSE is decoded by imagecodecs, which is optional.
"""

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vnav.errors import CaptureError

MOST_BYTES = 2**26  # of a member: no phone's image has as many
# What zipfile raises for archives that are damaged, encrypted, or packed as it does not know.
_DAMAGED = (
    OSError,
    EOFError,
    LookupError,
    RuntimeError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)


def require_imagecodecs(path: Path) -> None:
    """CaptureError where imagecodecs is not installed, which a file needs."""
    try:
        import imagecodecs  # noqa: F401
    except ImportError as error:
        raise CaptureError(
            f"expected imagecodecs to read {path}, whose depth is compressed as LZFSE, found it not"
            " installed; run 'pip install vnav-rgbd[record3d]'"
        ) from error


class Record3dArchive:
    """The members of a recording; may be read from several threads."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._zip = zipfile.ZipFile(path)
        except _DAMAGED as error:
            raise CaptureError(
                f"expected a recording of Record3D in {path}, a zip, found: {error}"
            ) from error
        self.sizes = {member.filename: member.file_size for member in self._zip.infolist()}

    def where(self, name: str) -> str:
        """What a member is called in messages."""
        return f"{self.path}/{name}"

    def read(self, name: str) -> bytes:
        """What a member holds; CaptureError where it is missing, damaged or huge."""
        if self.sizes.get(name, 0) > MOST_BYTES:
            raise CaptureError(
                f"expected at most {MOST_BYTES} bytes in {self.where(name)}, found"
                f" {self.sizes[name]}"
            )
        try:
            return self._zip.read(name)
        except _DAMAGED as error:
            raise CaptureError(
                f"expected {self.where(name)} to be whole, found: {error}"
            ) from error

    def image(self, name: str, dtype: DTypeLike, size: tuple[int, int]) -> NDArray[Any]:
        """A member in LZFSE as an image of a size (width, height); CaptureError as `values`."""
        width, height = size
        values = self.values(name, dtype, min(width * height, MOST_BYTES))
        if len(values) != width * height:
            raise CaptureError(
                f"expected {width} x {height} pixels in {self.where(name)}, found {len(values)}"
            )
        return values.reshape(height, width)

    def values(self, name: str, dtype: DTypeLike, most: int) -> NDArray[Any]:
        """Values (N,) of a member in LZFSE; CaptureError as `read`, and where there are more."""
        from imagecodecs import lzfse_decode

        packed, kind = self.read(name), np.dtype(dtype)
        try:
            data = bytes(lzfse_decode(packed, out=most * kind.itemsize + 1))
            if len(data) <= most * kind.itemsize:
                return np.frombuffer(data, kind)
        except (RuntimeError, ValueError) as error:  # LzfseError is a RuntimeError
            raise CaptureError(
                f"expected values in LZFSE in {self.where(name)}, found: {error}"
            ) from error
        raise CaptureError(f"expected at most {most} values in {self.where(name)}, found more")
