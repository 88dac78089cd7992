"""COLMAP's cameras.txt: one camera a line, ``CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]``.

COLMAP puts the origin on the corner of the image. It knows no depth.

Source: https://colmap.github.io/format.html and https://colmap.github.io/cameras.html; models.h.
"""

import math
from typing import Any

from vnav.io.cameras.tables import Tables, brown_conrady, from_corner

NAME = "COLMAP"
FILES: tuple[str, ...] = ("cameras.txt", "sparse/cameras.txt", "sparse/0/cameras.txt")

MODELS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": (
        *("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
        *("k3", "k4", "k5", "k6"),
    ),
}
_DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def recognises(content: Any) -> bool:
    """Whether a line begins as a camera does."""
    return isinstance(content, str) and any(
        words[0].isdecimal() and words[1].isupper() for words in _lines(content) if len(words) >= 4
    )


def tables(content: Any) -> Tables:
    """The one camera that all images share; ValueError for several, or for another model."""
    lines = _lines(content)
    if len(lines) != 1:
        raise ValueError(
            f"expected one camera of all images, found {len(lines)}; reconstruct with"
            " --ImageReader.single_camera 1"
        )
    _, model, width, height, *numbers = lines[0]
    if model not in MODELS:
        raise ValueError(
            f"expected a camera model of {', '.join(MODELS)}, found {model}; undistort the images"
            " with colmap image_undistorter"
        )
    keys, values = MODELS[model], [_number(word) for word in numbers]
    if len(values) != len(keys):
        raise ValueError(f"expected {len(keys)} parameters of {model}, found {len(values)}")
    found = dict(zip(keys, values, strict=True))
    color: dict[str, Any] = {"width": _number(width), "height": _number(height)}
    color |= {key: found.get(key, found.get("f")) for key in ("fx", "fy", "cx", "cy")}
    color["distortion"] = brown_conrady([found.get(key, 0) for key in _DISTORTION], model)
    return {"color": from_corner(color)}


def _lines(content: str) -> list[list[str]]:
    lines = (line.split() for line in content.splitlines())
    return [words for words in lines if words and not words[0].startswith("#")]


def _number(word: str) -> int | float:
    """A number as it is written; NaN, which is refused where all is checked, for another word."""
    try:
        return int(word) if word.isdecimal() else float(word)
    except ValueError:
        return math.nan
