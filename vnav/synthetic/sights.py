"""What a camera sees of people who stand at places of a scene, roughly: upright rectangles."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.synthetic.places import Net

Array = NDArray[np.float64]
WIDTH_M, HEIGHT_M = 0.42, 1.7  # of the rectangle, which faces the camera
FILLED = 0.65  # share of it that a body covers
NEAREST_M = 0.2


@dataclass(frozen=True)
class Sight:
    """A camera's view of a net at one time.

    ``depth_m`` (H, W) of the scene, infinite where there is nothing; ``box`` (R, C, 4): pixels
    x0, y0, x1, y1 of who stands at a node, ends exclusive, empty out of view; ``z_m`` (R, C).
    """

    depth_m: Array
    box: NDArray[np.int64]
    z_m: Array


def sight_of(
    depth_m: NDArray[np.float32], net: Net, view: Intrinsics, T_world_camera: Array
) -> Sight:
    """What the camera sees from there, where the scene without anybody has such depth (H, W)."""
    right = T_world_camera[:2, 0] / np.hypot(*T_world_camera[:2, 0])
    corners = [
        np.dstack([net.xy + side * WIDTH_M / 2 * right, np.full(net.free.shape, z)])
        for side in (-1, 1)
        for z in (0.0, HEIGHT_M)
    ]
    points = se3.transform(se3.inverse(T_world_camera), np.stack(corners))
    z_m = points[..., 2].mean(0)
    points[..., 2] = np.maximum(points[..., 2], NEAREST_M)
    px = np.clip(np.rint(view.project(points)), 0, view.size).astype(np.int64)
    box = np.concatenate([px.min(0), px.max(0)], -1)
    box[(z_m < NEAREST_M) | ~net.free] = 0
    return Sight(np.where(depth_m > 0, depth_m.astype(float), np.inf), box, z_m)


def covered(sight: Sight, others: Iterable[NDArray[np.intp]]) -> tuple[float, Array]:
    """Share of the view that bodies at nodes (2,) cover, and what one at each node (R, C) adds."""
    left = np.ones_like(sight.depth_m)
    for row, column in others:
        x0, y0, x1, y1 = sight.box[row, column]
        seen = sight.depth_m[y0:y1, x0:x1] > sight.z_m[row, column]
        left[y0:y1, x0:x1] *= np.where(seen, 1 - FILLED, 1.0)
    added = FILLED * _seen_sums(left, sight.depth_m, sight.box, sight.z_m) / left.size
    return float(1 - left.mean()), added


@compiled
def _seen_sums(left: Array, depth_m: Array, box: NDArray[np.int64], z_m: Array) -> Array:
    """Sum of ``left`` (H, W) over the pixels of each box before which nothing stands."""
    sums = np.zeros(z_m.shape)
    for row in range(z_m.shape[0]):
        for column in range(z_m.shape[1]):
            x0, y0, x1, y1 = box[row, column]
            for y in range(y0, y1):
                for x in range(x0, x1):
                    if depth_m[y, x] > z_m[row, column]:
                        sums[row, column] += left[y, x]
    return sums
