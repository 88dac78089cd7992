"""How many landmarks each cell of an image should show, and how many of them it does."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.localisation.photo import Photo
from vnav.localisation.verification.prediction import Prediction
from vnav.localisation.verification.projection_matching import ProjectionMatches

COLUMNS, ROWS = 8, 6
MIN_COUNT = 3  # landmarks, and features, in a cell that says anything
PATCHES = 4  # across a cell: a landmark counts where the photo has a feature in its patch or beside


def cell_counts(
    prediction: Prediction, matches: ProjectionMatches, photo: Photo
) -> NDArray[np.intp]:
    """How many landmarks are found, and how many are predicted (2, C), in each cell.

    Only where the photo shows something, in the cell and near the landmark: what is covered, black
    or plain tells neither.
    """
    size = photo.intrinsics.size
    cells, of_features = (cells_of(px, size) for px in (prediction.px, photo.features.keypoints_px))
    found = np.zeros(len(cells), bool)
    found[matches.predicted] = True
    expected = found | _shown(prediction.px, photo)
    rows = cells[found], cells[expected], of_features
    counts = [np.bincount(r, minlength=COLUMNS * ROWS) for r in rows]
    return np.stack(counts[:2]) * (counts[2] >= MIN_COUNT)


def _shown(px: NDArray[Any], photo: Photo) -> NDArray[np.bool_]:
    """Whether the photo has a feature near each pixel (N, 2)."""
    grid = COLUMNS * PATCHES, ROWS * PATCHES
    size = photo.intrinsics.size
    column, row = _bins(photo.features.keypoints_px, size, grid)
    taken = np.zeros(grid[::-1], np.uint8)
    taken[row, column] = 1
    column, row = _bins(px, size, grid)
    return np.asarray(cv2.dilate(taken, np.ones((3, 3), np.uint8))[row, column] > 0)


def cells_of(px: NDArray[Any], size: tuple[int, int]) -> NDArray[np.intp]:
    """Number of the cell that each pixel (N, 2) lies in."""
    column, row = _bins(px, size, (COLUMNS, ROWS))
    return np.asarray(row * COLUMNS + column)


def _bins(px: NDArray[Any], size: tuple[int, int], grid: tuple[int, int]) -> NDArray[np.intp]:
    """Column and row (2, N) of the part of an evenly cut image that each pixel (N, 2) lies in."""
    column_row = np.floor(px / size * grid).astype(np.intp)
    return np.asarray(column_row.clip(0, np.array(grid) - 1).T)
