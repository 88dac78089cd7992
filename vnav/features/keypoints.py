"""OpenCV's keypoints as a table, and back."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features

X, Y, LEVEL, ANGLE_DEG, RESPONSE, SIZE = range(6)


def table_of(keypoints: Any) -> Array:
    """x, y, level, angle in degrees, response and size of each keypoint (N, 6)."""
    rows = [(*k.pt, k.octave, k.angle, k.response, k.size) for k in keypoints]
    return np.array(rows, float).reshape(-1, 6)


def keypoints_of(table: Array) -> list[Any]:
    """The inverse of `table_of`."""
    return [
        cv2.KeyPoint(x, y, size, angle, response, int(level))
        for x, y, level, angle, response, size in table.tolist()
    ]


def strongest_first(table: Array) -> NDArray[np.intp]:
    """Rows (N,) by response; ties in an order that does not depend on threads."""
    return np.lexsort((*table[:, [ANGLE_DEG, LEVEL, X, Y]].T, -table[:, RESPONSE]))


def features_of(table: Array, descriptors: NDArray[Any], space: DescriptorSpace) -> Features:
    """Described keypoints of a space, in the order of the table."""
    columns = table.astype(np.float32)
    angles = np.deg2rad(columns[:, ANGLE_DEG]) if space.has_angles else 0 * columns[:, ANGLE_DEG]
    return Features(
        columns[:, :2], descriptors, columns[:, RESPONSE], columns[:, SIZE], angles, space
    )
