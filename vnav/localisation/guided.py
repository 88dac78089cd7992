"""What the map predicts to be seen from a pose, and what of it the photo shows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.map_index import MapIndex
from vnav.localisation.atlas import Atlas
from vnav.localisation.hidden import hidden
from vnav.localisation.matches import Matches
from vnav.localisation.photo import Photo
from vnav.localisation.view import View

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

KEYFRAMES = 64  # that share the most of the view: what they saw is predicted
MAX_ROWS = 10_000  # of descriptors that are looked at
PROBES = 24  # landmarks of a keyframe that its share is judged by
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

    def __getitem__(self, chosen: NDArray[np.bool_]) -> "Prediction":
        """The chosen rows."""
        return Prediction(self.rows[chosen], self.px[chosen], self.patch_px[chosen])


@dataclass(frozen=True)
class Hits:
    """Pairs of predicted row (position in the prediction) and feature that agree; all (H,).

    ``distance``: between descriptors; ``offset_px``: of the feature from its predicted place.
    """

    predicted: Rows
    feature: Rows
    distance: NDArray[np.float32]
    offset_px: Array

    def __getitem__(self, chosen: NDArray[np.bool_]) -> "Hits":
        """The chosen pairs."""
        return Hits(
            self.predicted[chosen],
            self.feature[chosen],
            self.distance[chosen],
            self.offset_px[chosen],
        )


def predict(view: View, atlas: Atlas) -> Prediction:
    """What the view should see: in the image, and seen by a keyframe from a like viewpoint.

    Not what stands behind something else. Where the map knows very much, an even selection.
    """
    index = atlas.index
    rows = atlas.rows_of(index.landmarks_of(keyframes_around(view, index)))
    rows = rows[:: 1 + len(rows) // MAX_ROWS]
    rows = rows[_inside(view, index.points_world[index.owner[rows]])]
    which, keyframe = index.keyframes_of(index.owner[rows])
    points = index.points_world[index.owner[rows]]
    alike = _alike(view, points[which], index.T_world_keyframe[keyframe, :3, 3])
    seen = np.bincount(which[alike], minlength=len(rows)) > 0
    rows, points = rows[seen], points[seen]
    return reprojected(rows[~hidden(view, points, index.voxels)], view, atlas)


def reprojected(rows: Rows, view: View, atlas: Atlas) -> Prediction:
    """Where a view sees the landmarks of some rows: those in the image, large enough for SIFT."""
    points = atlas.index.points_world[atlas.index.owner[rows]]
    px, depth = view.project(points)
    tip, _ = view.project(points + atlas.index.patch_world[rows])
    prediction = Prediction(rows, px, tip - px)
    radius = np.linalg.norm(prediction.patch_px, axis=1)
    fits = (radius > MIN_RADIUS_PX) & (radius < max(view.intrinsics.size) / 4)
    return prediction[fits & _in_image(px, depth, view)]


def keyframes_around(view: View, index: MapIndex) -> Rows:
    """The keyframes that share the most of the view, judged by a few landmarks of each."""
    start, end = index.sees_start[:-1], index.sees_start[1:]
    step = np.maximum((end - start) // PROBES, 1)[:, None]
    probe = np.minimum(start[:, None] + step * np.arange(PROBES), end[:, None] - 1)
    keyframe = np.repeat(np.arange(index.keyframes), PROBES)
    points = index.points_world[index.sees[probe.ravel()]]
    shared = _inside(view, points)
    shared[shared] = _alike(view, points[shared], index.T_world_keyframe[keyframe[shared], :3, 3])
    count = np.bincount(keyframe[shared], minlength=index.keyframes) * (end > start)
    best = np.argsort(-count, kind="stable")[:KEYFRAMES]
    return best[count[best] > 0]


def hits(prediction: Prediction, photo: Photo, atlas: Atlas, radius_px: float) -> Hits:
    """Features near their predicted place, alike in size, orientation and descriptor."""
    p, f = photo.near(prediction.px, radius_px)
    patch = prediction.patch_px
    octave = np.log2(2 * np.linalg.norm(patch, axis=1))
    found_octave = np.log2(photo.features.scales_px)
    alike = np.abs(octave.take(p) - found_octave.take(f)) < PATCH_OCTAVES
    p, f = p[alike], f[alike]
    angle = np.arctan2(patch[:, 1], patch[:, 0])
    turn = np.abs(angle.take(p) - photo.features.angles_rad.take(f)) % (2 * np.pi)
    alike = (turn < PATCH_TURN_RAD) | (turn > 2 * np.pi - PATCH_TURN_RAD)
    p, f = p[alike], f[alike]
    difference = atlas.index.descriptors.take(prediction.rows[p], 0).astype(np.float32)
    difference -= photo.database.descriptors.take(f, 0)
    distance = np.sqrt(np.einsum("ij,ij->i", difference, difference))
    offset = np.linalg.norm(photo.features.keypoints_px[f] - prediction.px[p], axis=1)
    return Hits(p, f, distance, offset)[distance < atlas.index.stranger]


def matched(hits: Hits, prediction: Prediction, atlas: Atlas) -> Matches:
    """The hits, one to one, the nearest descriptors first."""
    rows = prediction.rows[hits.predicted]
    return Matches(hits.feature, rows, atlas.index.owner[rows], hits.distance).one_to_one()


def _inside(view: View, points: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which points (N, 3) project into the image."""
    return _in_image(*view.project(points), view)


def _in_image(px: Array, depth: Array, view: View) -> NDArray[np.bool_]:
    return np.asarray((depth > 0) & (px >= 0).all(1) & (px < view.intrinsics.size).all(1))


def _alike(view: View, points: NDArray[np.float32], centres: Array) -> NDArray[np.bool_]:
    """Which points (N, 3) a camera at its centre (N, 3) sees from a like direction and distance."""
    ours, theirs = view.centre_world - points, centres - points
    product, our_squared, their_squared = (
        np.einsum("ij,ij->i", a, b) for a, b in ((ours, theirs), (ours, ours), (theirs, theirs))
    )
    like_direction = product > MAX_TURN * np.sqrt(our_squared * their_squared)
    ratio, most = our_squared / their_squared, 4**MAX_OCTAVES
    return np.asarray(like_direction & (ratio < most) & (ratio > 1 / most))
