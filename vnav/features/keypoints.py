"""OpenCV's keypoints as a table, and back; and features made of them."""

from itertools import chain
from operator import attrgetter
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features

BESIDE_PLACE = attrgetter("octave", "angle", "response", "size")
X, Y, LEVEL, ANGLE_DEG, RESPONSE, SIZE = range(6)


def table_of(keypoints: Any) -> Array:
    """x, y, level, angle in degrees, response and size of each keypoint (N, 6)."""
    rest = chain.from_iterable(map(BESIDE_PLACE, keypoints))
    columns = np.fromiter(rest, float, 4 * len(keypoints)).reshape(-1, 4)
    return np.hstack([np.reshape(cv2.KeyPoint.convert(keypoints), (-1, 2)), columns])


def keypoints_of(table: Array) -> list[Any]:
    """The inverse of `table_of`."""
    return [
        cv2.KeyPoint(x, y, size, angle, response, int(level))
        for x, y, level, angle, response, size in table.tolist()
    ]


def strongest_first(table: Array) -> NDArray[np.intp]:
    """Rows (N,) by response; ties in an order that does not depend on threads."""
    return np.lexsort((*table[:, [LEVEL, ANGLE_DEG, Y, X]].T, -table[:, RESPONSE]))


def described(
    describer: Any, gray: NDArray[np.uint8], table: Array, space: DescriptorSpace
) -> tuple[Array, NDArray[Any]]:
    """Keypoints of a table that OpenCV can describe, strongest first, and their descriptors."""
    keypoints, descriptors = describer.compute(gray, keypoints_of(table))
    if descriptors is None:
        return table[:0], space.none()
    found = table_of(keypoints)
    order = strongest_first(found)
    return found[order], descriptors[order]


def features_of(table: Array, descriptors: NDArray[Any], space: DescriptorSpace) -> Features:
    """Described keypoints of a space, in the order of the table."""
    columns = table.astype(np.float32)
    angles = np.deg2rad(columns[:, ANGLE_DEG]) if space.has_angles else 0 * columns[:, ANGLE_DEG]
    return Features(
        columns[:, :2], descriptors, columns[:, RESPONSE], columns[:, SIZE], angles, space
    )
