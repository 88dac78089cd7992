"""What phone apps that record with ARKit share: depth of a lower resolution, axes, confidence.

Depth has the axis and the view of colour, in fewer pixels. Its confidence is low, medium or
high; low is stored as 0. The world's y points up.

Source: Apple's documentation of ARFrame.sceneDepth, ARConfidenceLevel and ARConfiguration.
"""

import numpy as np

from vnav.core.arrays import Array

MILLIMETRES = 1000.0  # units a metre
_R_UP_ARKIT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # y up to z up


def upright(T_arkit_camera: Array) -> Array:
    """Poses (N, 4, 4) in a world whose z points up."""
    T_up_arkit = np.eye(4)
    T_up_arkit[:3, :3] = _R_UP_ARKIT
    return np.asarray(T_up_arkit @ T_arkit_camera)
