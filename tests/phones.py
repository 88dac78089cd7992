"""Recordings of Record3D, as its app writes them."""

import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray


def packed(values: NDArray[Any]) -> bytes:
    """An array in LZFSE."""
    imagecodecs = pytest.importorskip(
        "imagecodecs", reason="imagecodecs is not installed: pip install 'vnav-rgbd[record3d]'"
    )
    found: bytes = imagecodecs.lzfse_encode(np.ascontiguousarray(values).tobytes())
    return found


def members(
    color: Sequence[NDArray[np.uint8]],
    depth_m: Sequence[NDArray[np.float32]],
    metadata: Mapping[str, Any],
) -> dict[str, bytes]:
    """What the app puts into a file; colour (H, W, 3) RGB by a codec that loses nothing."""
    found = {"metadata": json.dumps(metadata).encode(), "icon": b""}
    for k, (image, depth) in enumerate(zip(color, depth_m, strict=True)):
        found[f"rgbd/{k}.jpg"] = cv2.imencode(".png", image[..., ::-1])[1].tobytes()
        found[f"rgbd/{k}.depth"] = packed(depth.astype("<f4"))
        found[f"rgbd/{k}.conf"] = packed(np.full(depth.shape, 2, np.uint8))
    return found


def write_r3d(path: Path, content: Mapping[str, bytes]) -> Path:
    """A file of these members."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return path
