"""Guided matching: features near where landmarks project (ORB-SLAM's SearchByProjection).

Source: Mur-Artal, Montiel, Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system",
2015.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.descriptors import squared_distance
from vnav.core.arrays import Array, Floats, Rows
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.matches import Matches
from vnav.localisation.photo import Photo
from vnav.localisation.verification.prediction import Prediction

PATCH_TURN_RAD = np.deg2rad(30.0)  # of a feature against the predicted orientation
PATCH_OCTAVES = 0.7  # of a feature against the predicted size


@dataclass(frozen=True)
class ProjectionMatches:
    """Pairs of predicted row (position in the prediction) and feature that agree; all (H,).

    ``distance``: between descriptors.
    """

    predicted: Rows
    feature: Rows
    distance: Floats


def match_by_projection(
    prediction: Prediction, photo: Photo, database: LandmarkDatabase, radius_px: float
) -> ProjectionMatches:
    """Features near their predicted place, of like size, orientation and descriptor."""
    patch, space = prediction.patch_px, database.tree.space
    octave = np.log2(2 * np.linalg.norm(patch, axis=1))
    angle = np.arctan2(patch[:, 1], patch[:, 0]) % (2 * np.pi)
    buckets = photo.buckets(radius_px)
    p, f, squared = _pairs(
        np.column_stack([prediction.px, octave, angle]),
        photo.geometry[buckets.order],
        (buckets.start, buckets.order, buckets.columns),
        (
            prediction.rows,
            space.comparable(database.index.descriptors),
            space.comparable(photo.features.descriptors),
        ),
        (
            radius_px,
            PATCH_OCTAVES if space.has_scales else np.inf,
            PATCH_TURN_RAD if space.has_angles else np.inf,
            space.squared(float(database.index.distractor_distance[0])),
        ),
    )
    return ProjectionMatches(p, f, space.distance(squared))


def one_to_one(
    found: ProjectionMatches, prediction: Prediction, database: LandmarkDatabase
) -> Matches:
    """Each feature and each landmark once, the nearest descriptors first."""
    rows = prediction.rows[found.predicted]
    return Matches(found.feature, rows, database.index.owner[rows], found.distance).one_to_one()


@compiled
def _pairs(
    predicted: Array,
    found: Array,
    buckets: tuple[Rows, Rows, int],
    described: tuple[Rows, NDArray[Any], NDArray[Any]],
    limits: tuple[float, float, float, float],
) -> tuple[Rows, Rows, Floats]:
    """Pairs that agree: of predicted, of found, and squared distance.

    ``predicted`` (P, 4), ``found`` (N, 4) in the buckets' order: x, y, octave, and angle below
    2 pi; ``limits``: of the place, octave, angle, and squared distance.
    """
    start, order, columns = buckets
    rows, descriptors, of_photo = described
    radius, octaves, turn, most = limits
    pairs = [(0, 0, np.float32(0)) for _ in range(0)]
    for p in range(len(predicted)):
        x, y = predicted[p, 0], predicted[p, 1]
        cell = (int(np.floor(y / radius)) + 1) * columns + int(np.floor(x / radius)) + 1
        for side in (cell - columns, cell, cell + columns):
            # Three cells side by side are one run of the sorted features.
            for place in range(start[side - 1], start[side + 2]):
                if _is_near(predicted[p], found[place], radius, octaves, turn):
                    f = order[place]
                    squared = squared_distance(descriptors[rows[p]], of_photo[f])
                    if squared < most:
                        pairs.append((p, f, np.float32(squared)))
    return (
        np.array([p for p, _, _ in pairs], np.intp),
        np.array([f for _, f, _ in pairs], np.intp),
        np.array([squared for _, _, squared in pairs], np.float32),
    )


@compiled
def _is_near(
    predicted: Array, found: Array, radius: float, octaves: float, most_turn: float
) -> bool:
    """Whether a feature (4,) lies near a prediction (4,) in place, octave and angle.

    One branch instead of several that cannot be foreseen.
    """
    dx, dy = found[0] - predicted[0], found[1] - predicted[1]
    turn = abs(predicted[3] - found[3])
    return bool(
        (dx * dx + dy * dy < radius * radius)
        & (abs(predicted[2] - found[2]) < octaves)
        & ((turn < most_turn) | (turn > 2 * np.pi - most_turn))
    )
