"""A cloud as it looks from above, drawn without a graphics library."""

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.point_cloud import PointCloud

SHADE_PER_M = 3.5  # how much darker a pixel is, by the mean rise to its neighbours
FILLED_BY = 4  # an empty pixel with so many full neighbours takes their mean
BACKGROUND = (0.13, 0.15, 0.17)
Image = NDArray[np.float32]


def seen_from_above(cloud: PointCloud, pixel_m: float) -> Image:
    """RGB (H, W, 3) in 0 to 1 of the highest point in each pixel, darker beside higher ones.

    Rows run along +y and columns along +x from the cloud's least x and y; a pixel is ``pixel_m``
    wide. The cloud has at least one point.
    """
    image, height_m = _filled(*_highest(cloud, pixel_m))
    rises_m = np.zeros_like(height_m)
    for neighbour in _neighbours(height_m, np.nan):
        rises_m += np.nan_to_num(neighbour - height_m).clip(0, 1) / 8
    lit = image * np.exp(-SHADE_PER_M * rises_m)[..., None]
    return np.where(np.isnan(lit), np.array(BACKGROUND, np.float32), lit)


def _highest(cloud: PointCloud, pixel_m: float) -> tuple[Image, Image]:
    """Colour (H, W, 3) and height (H, W) of the highest point in each pixel, NaN where none is."""
    rising = np.argsort(cloud.points_world[:, 2], kind="stable")
    points, colors = cloud.points_world[rising], cloud.colors[rising]
    column, row = np.floor((points[:, :2] - points[:, :2].min(0)) / pixel_m).astype(int).T
    image = np.full((row.max() + 1, column.max() + 1, 3), np.nan, np.float32)
    height_m = np.full(image.shape[:2], np.nan, np.float32)
    image[row, column] = colors / 255
    height_m[row, column] = points[:, 2]
    return image, height_m


def _filled(image: Image, height_m: Image) -> tuple[Image, Image]:
    """The same with lone empty pixels filled."""
    both = np.dstack([image, height_m])
    full = np.isfinite(height_m)
    beside = np.zeros(full.shape, int)
    for is_full in _neighbours(full, False):
        beside += is_full
    hole = ~full & (beside >= FILLED_BY)
    total = np.zeros((hole.sum(), 4), np.float32)
    for neighbour in _neighbours(both, np.nan):
        total += np.nan_to_num(neighbour[hole])
    both[hole] = total / beside[hole, None]
    return both[..., :3], both[..., 3]


def _neighbours(image: NDArray[Any], outside: float) -> Iterator[NDArray[Any]]:
    """The image (H, W, ...) moved to each of its eight sides."""
    border = [(1, 1), (1, 1), *[(0, 0)] * (image.ndim - 2)]
    padded = np.pad(image, border, constant_values=outside)
    for y, x in product(range(3), range(3)):
        if (y, x) != (1, 1):
            yield padded[y : y + image.shape[0], x : x + image.shape[1]]
