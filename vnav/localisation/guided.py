"""What the map predicts to be seen from a pose, and what of it the photo shows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.map_index import MapIndex
from vnav.localisation.atlas import Atlas
from vnav.localisation.matches import Matches
from vnav.localisation.photo import Photo
from vnav.localisation.view import View

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

KEYFRAMES = 16  # nearest in viewpoint whose landmarks are predicted
MAX_TURN = np.cos(np.deg2rad(45.0))  # between the rays of photo and keyframe: SIFT bears no more
MAX_OCTAVES = 1.0  # between the distances of photo and keyframe
PATCH_TURN_RAD = np.deg2rad(30.0)  # of a feature against the predicted orientation
PATCH_OCTAVES = 0.7  # of a feature against the predicted size
MIN_RADIUS_PX = 1.0  # of a patch that SIFT can find


@dataclass(frozen=True)
class Prediction:
    """Rows (P,) of the index that should be seen, where (P, 2), and their patches (P, 2).

    A patch is the vector in pixels from the point along its orientation to its edge.
    """

    rows: Rows
    px: Array
    patch_px: Array

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True)
class Hits:
    """Pairs of predicted row (position in the prediction) and feature that agree; (H,)."""

    predicted: Rows
    feature: Rows
    distance: NDArray[np.float32]


def predict(view: View, atlas: Atlas, keyframes: Rows) -> Prediction:
    """What some keyframes saw and the view should see: in the image, and from a like viewpoint."""
    index = atlas.index
    rows = atlas.rows_of(index.landmarks_of(keyframes))
    points = index.points_world[index.owner[rows]]
    px, depth = view.project(points)
    size = view.intrinsics.size
    inside = (depth > 0) & (px >= 0).all(1) & (px < size).all(1)
    rows, points, px = rows[inside], points[inside], px[inside]
    alike = _seen_alike(view, index, rows, points)
    rows, points, px = rows[alike], points[alike], px[alike]
    tip, _ = view.project(points + index.patch_world[rows])
    radius = np.linalg.norm(tip - px, axis=1)
    fits = (radius > MIN_RADIUS_PX) & (radius < max(size) / 4)
    return Prediction(rows[fits], px[fits], (tip - px)[fits])


def keyframes_around(view: View, landmarks: NDArray[np.int32], index: MapIndex) -> Rows:
    """The keyframes nearest in viewpoint, of those beside any that sees the landmarks."""
    seeing = np.unique(index.keyframes_of(landmarks)[1])
    candidates = np.flatnonzero(index.beside[seeing].any(0))
    T_world_camera = view.T_world_camera
    away = index.T_world_keyframe[candidates, :3, 3] - T_world_camera[:3, 3]
    depth = np.median(view.project(index.points_world[landmarks])[1])
    turn = 1 - index.T_world_keyframe[candidates, :3, 2] @ T_world_camera[:3, 2]
    difference = np.linalg.norm(away, axis=1) / max(depth, 0.1) + turn
    return candidates[np.argsort(difference, kind="stable")[:KEYFRAMES]]


def hits(prediction: Prediction, photo: Photo, atlas: Atlas, radius_px: float) -> Hits:
    """Features near their predicted place, alike in size, orientation and descriptor."""
    p, f = photo.near(prediction.px, radius_px)
    patch = prediction.patch_px[p]
    turn = np.arctan2(patch[:, 1], patch[:, 0]) - photo.features.angles_rad[f]
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    size = 2 * np.linalg.norm(patch, axis=1) / photo.features.scales_px[f]
    alike = (turn < PATCH_TURN_RAD) & (np.abs(np.log2(size)) < PATCH_OCTAVES)
    p, f = p[alike], f[alike]
    difference = atlas.index.descriptors[prediction.rows[p]].astype(np.float32)
    difference -= photo.features.descriptors[f]
    distance = np.sqrt(np.einsum("ij,ij->i", difference, difference))
    alike = distance < atlas.index.stranger
    return Hits(p[alike], f[alike], distance[alike])


def matched(hits: Hits, prediction: Prediction, atlas: Atlas) -> Matches:
    """The hits, one to one, the nearest descriptors first."""
    rows = prediction.rows[hits.predicted]
    return Matches(hits.feature, rows, atlas.index.owner[rows], hits.distance).one_to_one()


def _seen_alike(
    view: View, index: MapIndex, rows: Rows, points: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Which points some keyframe saw from a like direction and distance."""
    which, keyframe = index.keyframes_of(index.owner[rows])
    ours = (view.centre_world - points)[which]
    theirs = index.T_world_keyframe[keyframe, :3, 3] - points[which]
    our_distance, their_distance = np.linalg.norm(ours, axis=1), np.linalg.norm(theirs, axis=1)
    cosine = np.einsum("ij,ij->i", ours, theirs) / (our_distance * their_distance)
    octaves = np.abs(np.log2(our_distance / their_distance))
    alike = np.zeros(len(rows), bool)
    alike[which[(cosine > MAX_TURN) & (octaves < MAX_OCTAVES)]] = True
    return alike
