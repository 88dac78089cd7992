"""A picture written to where a user wants it."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.errors import VnavError
from vnav.io.files import write_bytes


def write_picture(path: Path, picture: NDArray[np.uint8], option: str) -> None:
    """Write a picture (H, W, 3), BGR; VnavError, which names the option, where that cannot be."""
    try:
        _, data = cv2.imencode(path.suffix, picture)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, data.tobytes())
    except (OSError, cv2.error) as error:
        found = error.strerror if isinstance(error, OSError) else "another suffix"
        raise VnavError(
            f"expected to write a picture to {path}, found: {found}; name a .jpg or .png that can"
            f" be written with {option}"
        ) from error
