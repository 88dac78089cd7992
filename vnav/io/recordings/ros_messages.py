"""What messages of ROS say that a capture needs, the same for ROS 1 and ROS 2.

Their fields and units: sensor_msgs/Image, CompressedImage and CameraInfo, tf2_msgs/TFMessage at
docs.ros.org; frames of cameras: REP 103 (z forward, x right, y down, "optical").
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array


@dataclass(frozen=True)
class RosImage:
    """Pixels as they are, row by row, each row ``step`` bytes long."""

    stamp_ns: int
    frame: str
    encoding: str
    width: int
    height: int
    step: int
    is_bigendian: bool
    data: NDArray[np.uint8]


@dataclass(frozen=True)
class RosCompressedImage:
    """An image file, or for ``compressedDepth`` one behind a header of 12 bytes."""

    stamp_ns: int
    frame: str
    encoding: str  # of the image before it was compressed, "" where not told
    codec: str  # what comes after it, as in "16UC1; compressedDepth png"
    data: NDArray[np.uint8]


@dataclass(frozen=True)
class RosCameraInfo:
    """A calibrated camera: K (3, 3) and D of images as taken, P (3, 4) of rectified ones."""

    frame: str
    width: int
    height: int
    distortion_model: str
    D: tuple[float, ...]
    K: tuple[float, ...]
    P: tuple[float, ...]
    is_part: bool  # of the camera's pixels, by binning or a region of interest


@dataclass(frozen=True)
class RosTransform:
    """T_parent_child (4, 4) at a time."""

    stamp_ns: int
    parent: str
    child: str
    T_parent_child: Array


AnyImage = RosImage | RosCompressedImage
RosMessage = AnyImage | RosCameraInfo | tuple[RosTransform, ...]
