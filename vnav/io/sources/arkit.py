"""What phone apps that record with ARKit share: depth of a lower resolution, axes, confidence.

Depth has the optical axis and the view of colour, in fewer pixels. Its confidence is low, medium or
high; low is stored as 0. The world's y points up.

Source: Apple's documentation of ARFrame.sceneDepth, ARConfidenceLevel and ARConfiguration.
"""

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import Camera, Intrinsics

MILLIMETRES = 1000.0  # units a metre
_AT_COLOR = tuple(map(tuple, np.eye(4).tolist()))
_R_UP_ARKIT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # y up to z up


def phone_camera(color: Intrinsics, depth_size: tuple[int, int]) -> Camera:
    """The camera of a frame whose depth has this size (width, height), in millimetres."""
    if depth_size == color.size:
        return Camera(color, MILLIMETRES)
    return Camera(color, MILLIMETRES, color.scaled(*depth_size), _AT_COLOR)


def upright(T_arkit_camera: Array) -> Array:
    """Poses (N, 4, 4) in a world whose z points up."""
    T_up_arkit = np.eye(4)
    T_up_arkit[:3, :3] = _R_UP_ARKIT
    return np.asarray(T_up_arkit @ T_arkit_camera)
