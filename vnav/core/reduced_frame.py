"""Frames made small, so that all their pixels can be asked at little cost."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, frozen
from vnav.core.camera import Intrinsics

FEW = 0.5  # share with depth, of blocks or features, below which those without are asked, too
BLOCK_PX = 4  # edge of the square of pixels that becomes one


@dataclass(frozen=True, eq=False)
class ReducedFrame:
    """Brightness and depth in blocks of pixels; two are equal if they are one.

    ``grey`` (H, W) float32: a block's mean; ``inverse_depth`` (H, W) float32 in 1/m: a block's
    mean, 0 where it has too little depth or a depth edge; ``intrinsics`` of both. ``twist`` (6,) of
    the camera in its own axes, rotation first, rad/s and m/s: 0 where nothing tells. ``masked``
    (H, W): what moves, or is not of the scene, without depth; None where there is no such thing.
    """

    stamp_s: float
    grey: NDArray[np.float32]
    inverse_depth: NDArray[np.float32]
    intrinsics: Intrinsics
    twist: Array = field(default_factory=lambda: np.zeros(6))
    masked: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        shape = self.intrinsics.height, self.intrinsics.width
        for name in ("grey", "inverse_depth"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float32, shape))

    @property
    def lacks_depth(self) -> bool:
        """Whether few blocks have depth, so that those without it are asked, too."""
        return bool((self.inverse_depth > 0).mean() < FEW)

    def without(self, masked: NDArray[np.bool_]) -> "ReducedFrame":
        """The same without the depth of what moves, or is not of the scene (H, W)."""
        left = np.where(masked, np.float32(0), self.inverse_depth)
        all_masked = masked if self.masked is None else masked | self.masked
        return replace(self, inverse_depth=left, masked=all_masked)

    def moving(self, twist: Array) -> "ReducedFrame":
        """The same, of a camera that moves by a twist."""
        return replace(self, twist=twist)


Seen = Callable[[int], ReducedFrame]  # a keyframe's pixels by its row


def reduced_camera(camera: Intrinsics, block_px: int) -> Intrinsics:
    """The pinhole camera of an image in blocks; its distortion is left out."""
    width, height = camera.width // block_px, camera.height // block_px
    cx, cy = ((c + 0.5) / block_px - 0.5 for c in (camera.cx, camera.cy))
    return Intrinsics(width, height, camera.fx / block_px, camera.fy / block_px, cx, cy)


def pixels_of_blocks(image: NDArray[Any], block_px: int) -> NDArray[np.float32]:
    """The pixels (P, h, w) of every block of an image (H, W): the first of each, and so on."""
    height, width = (n // block_px * block_px for n in image.shape)
    parts = [image[v:height:block_px, u:width:block_px] for v, u in np.ndindex(block_px, block_px)]
    return np.stack(parts).astype(np.float32)


def blocks_of(
    blocks: NDArray[np.bool_], keypoints_px: NDArray[np.float32], size: tuple[int, int]
) -> NDArray[np.bool_]:
    """What holds of blocks (h, w), for each keypoint (N, 2) of an image of that width and height.

    What is left over beside the last block belongs to it.
    """
    edge = size[0] // blocks.shape[1]
    height, width = blocks.shape
    columns, rows = np.rint(keypoints_px).astype(np.intp).T // edge
    return np.asarray(blocks[rows.clip(0, height - 1), columns.clip(0, width - 1)])


def in_pixels(blocks: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """What holds of blocks (h, w), for each pixel of an image of that height and width."""
    edge = shape[1] // blocks.shape[1]
    height, width = blocks.shape
    rows, columns = (np.arange(size) // edge for size in shape[:2])
    return np.asarray(blocks[np.ix_(rows.clip(max=height - 1), columns.clip(max=width - 1))])
