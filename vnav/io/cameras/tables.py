"""What every reader of camera files shares: the tables of a camera.toml, and how to fill them."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard, cast

from vnav.core.camera import MOST

Tables = dict[str, dict[str, Any]]  # [color] and [depth] of a camera.toml, not yet checked

# Row by row: where a calibration matrix has zeros and its one.
_FIXED = {1: 0, 3: 0, 6: 0, 7: 0, 8: 1}
_COLUMNS = (0, 3, 6, 1, 4, 7, 2, 5, 8)


def is_number(value: object) -> TypeGuard[float]:
    """Whether it is a number that a camera may have: no NaN, no text, nothing too large."""
    return type(value) in (int, float) and abs(cast(float, value)) < MOST


def pinhole(K: Any, *, by_columns: bool = False) -> dict[str, Any]:
    """fx, fy, cx, cy of a calibration matrix of 9 numbers, row by row or column by column.

    ValueError where it is no such matrix, or is stored the other way.
    """
    if not isinstance(K, Sequence) or len(K) != 9:
        raise ValueError(f"expected a calibration matrix of 9 numbers, found {K!r}")
    rows = [K[k] for k in _COLUMNS] if by_columns else list(K)
    if any(rows[k] != value for k, value in _FIXED.items()):
        order = "fx, 0, 0, 0, fy, 0, cx, cy, 1" if by_columns else "fx, 0, cx, 0, fy, cy, 0, 0, 1"
        raise ValueError(f"expected a calibration matrix {order}, found {list(K)}")
    return {"fx": rows[0], "fy": rows[4], "cx": rows[2], "cy": rows[5]}


def from_corner(values: Mapping[str, Any]) -> dict[str, Any]:
    """A principal point measured from the image's corner, now from the centre of its first pixel.

    What is no number is left as it is, to be refused where all is checked.
    """
    return {
        key: value - 0.5 if key in ("cx", "cy") and is_number(value) else value
        for key, value in values.items()
    }


def brown_conrady(coefficients: Sequence[Any], model: str) -> list[Any]:
    """k1, k2, p1, p2, k3 of coefficients in OpenCV's order, missing ones 0.

    ValueError where there are others and one of them is not 0: the model of vnav has five.
    """
    if any(coefficients[5:]):
        raise ValueError(
            f"expected a distortion of at most k1, k2, p1, p2, k3, found {model} with"
            f" {list(coefficients)}; undistort the images, and give the camera of what results"
        )
    return [*coefficients[:5], *[0] * (5 - len(coefficients))]
