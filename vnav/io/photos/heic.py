"""HEIC, as phones write it: read by pillow-heif, which is optional."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.errors import PhotoError

BRANDS = (b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1")


def is_heic(path: Path) -> bool:
    """Whether a file begins like HEIC; False for one that cannot be read."""
    try:
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
        import pillow_heif
    except ImportError as error:
        raise PhotoError(
            f"expected pillow-heif to read {path}, which is HEIC, found it not installed; run"
            " 'pip install vnav[heic]', or convert the photo to JPEG"
        ) from error
    try:
        image = pillow_heif.read_heif(path).to_pillow().convert("RGB")
    except (OSError, ValueError, RuntimeError, EOFError) as error:
        raise PhotoError(f"expected a whole HEIC image in {path}, found: {error}") from error
    return np.array(image, np.uint8)
