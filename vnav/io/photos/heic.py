"""HEIC, as phones write it: read by pillow-heif, which is optional."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.errors import PhotoError

EXIF_HEADER = b"Exif\0\0"
DAMAGED = (OSError, ValueError, RuntimeError, EOFError, SyntaxError)  # what pillow-heif raises
BRANDS = (b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1")


def is_heic(path: Path) -> bool:
    """Whether a file begins like HEIC; False for one that cannot be read, or for what is none."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            head = file.read(12)
    except OSError:
        return False
    return head[4:8] == b"ftyp" and head[8:12] in BRANDS


def read_heic(path: Path) -> NDArray[np.uint8]:
    """The image (H, W, 3) uint8, RGB, upright.

    PhotoError for a damaged file, and where pillow-heif is not installed.
    """
    try:
        image = _opened(path).to_pillow().convert("RGB")
    except DAMAGED as error:
        raise PhotoError(f"expected a whole HEIC image in {path}, found: {error}") from error
    return np.array(image, np.uint8)


def heic_exif(path: Path) -> bytes:
    """The TIFF block of a HEIC file's EXIF, empty where it has none; PhotoError as `read_heic`."""
    exif: bytes = _opened(path).info.get("exif") or b""
    return exif.removeprefix(EXIF_HEADER)


def _opened(path: Path) -> Any:
    try:
        import pillow_heif
    except ImportError as error:
        raise PhotoError(
            f"expected pillow-heif to read {path}, which is HEIC, found it not installed; run"
            " 'pip install vnav-rgbd[heic]', or convert the photo to JPEG"
        ) from error
    try:
        return pillow_heif.open_heif(path)
    except DAMAGED as error:
        raise PhotoError(f"expected a whole HEIC image in {path}, found: {error}") from error
