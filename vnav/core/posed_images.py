"""Images with known cameras, as tools for splatting and reconstruction take them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import Landmarks

CORNER_PX = 0.5  # where COLMAP and Nerfstudio have the first pixel's centre, which is 0 here


@dataclass(frozen=True)
class PosedImage:
    """One keyframe: undistorted, its pose known.

    ``number`` among the map's keyframes; ``row`` in the frame table; ``camera``: row of
    `PosedImages.cameras`; ``keypoints_px`` (N, 2) float32.
    """

    number: int
    row: int
    camera: int
    T_world_camera: Array
    keypoints_px: NDArray[np.float32]

    @property
    def name(self) -> str:
        """What its files are called, without suffix."""
        return f"{self.row:06d}"


@dataclass(frozen=True)
class PosedImages:
    """All keyframes that have a pose, and what they see.

    ``landmarks`` name keyframes by number and keypoints by row; ``colors`` (L, 3) uint8 RGB, each
    landmark's in the first image that sees it.
    """

    cameras: tuple[Intrinsics, ...]
    images: tuple[PosedImage, ...]
    landmarks: Landmarks
    colors: NDArray[np.uint8]
