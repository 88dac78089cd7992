import dataclasses

import numpy as np

from vnav.localisation.verification.evidence import evidence, posterior
from vnav.localisation.verification.image_cells import (
    COLUMNS,
    PATCHES,
    ROWS,
    cell_counts,
    cells_of,
)
from vnav.localisation.verification.prediction import Prediction
from vnav.localisation.verification.projection_matching import ProjectionMatches


def test_where_the_photo_shows_nothing_nothing_is_missed(scene):
    """A black box over the left half: no features there, and no landmarks counted."""
    photo, prediction = scene
    rows = np.arange(0, len(prediction), 3)
    left = prediction.px[:, 0] < 320
    covered = dataclasses.replace(photo, features=photo.features[~left])
    rows = rows[~left[rows]]
    found = ProjectionMatches(rows, rows, np.zeros(len(rows), np.float32))
    counts = cell_counts(prediction, found, covered).reshape(2, ROWS, COLUMNS)
    assert (counts[:, :, : COLUMNS // 2] == 0).all()
    assert posterior([evidence(counts.reshape(2, -1))])[0] > 0.95


def test_what_is_covered_is_not_missed_in_a_cell_that_is_partly_covered(scene):
    """The box ends in the fifth column, 80 pixels wide as each."""
    photo, _ = scene
    px = np.random.default_rng(0).uniform((0, 0), (640, 480), (3000, 2))
    row = np.arange(len(px)) % len(photo.features)
    features = dataclasses.replace(photo.features[row], keypoints_px=px.astype(np.float32))
    edge_px = 380
    covered = dataclasses.replace(photo, features=features[px[:, 0] >= edge_px])
    none = ProjectionMatches(np.arange(0), np.arange(0), np.zeros(0, np.float32))
    prediction = Prediction(np.arange(len(px)), px, np.ones((len(px), 2)))
    columns = cell_counts(prediction, none, covered)[1].reshape(ROWS, COLUMNS).sum(0)
    in_column = (px[:, 0] >= 320) & (px[:, 0] < 400)
    near = px[:, 0] >= edge_px - 2 * 80 / PATCHES
    assert (in_column & (px[:, 0] >= edge_px)).sum() <= columns[4] <= (in_column & near).sum()


def test_every_pixel_lies_in_a_cell():
    corners = np.array([[0, 0], [639.9, 0], [0, 479.9], [639.9, 479.9], [640.2, 480.0]])
    last = COLUMNS * ROWS - 1
    expected = [0, COLUMNS - 1, last - COLUMNS + 1, last, last]
    assert cells_of(corners, (640, 480)).tolist() == expected
