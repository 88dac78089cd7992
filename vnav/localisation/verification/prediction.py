"""What the map predicts to be seen from a pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Rows
from vnav.core.map_index import MapIndex
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.verification.occlusion import occluded
from vnav.localisation.view import MIN_DEPTH_M, View

LOCAL_KEYFRAMES = 64  # that share the most of the view: what they saw is predicted
MAX_ROWS = 10_000  # of descriptors that are looked at
PROBES = 24  # landmarks of a keyframe that its share is judged by
MAX_TURN = np.cos(np.deg2rad(45.0))  # between the rays of photo and keyframe: SIFT bears no more
MAX_OCTAVES = 1.0  # between the distances of photo and keyframe
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


def predict(view: View, database: LandmarkDatabase) -> Prediction:
    """What the view should see: in the image, and seen by a keyframe from a like viewpoint.

    Not what stands behind something else. Where the map knows very much, an even selection.
    """
    index = database.index
    rows = database.rows_of(index.landmarks_of(local_keyframes(view, index)))
    rows = rows[:: 1 + len(rows) // MAX_ROWS]
    rows = rows[_visible(index.owner[rows], view, index)]
    points = index.points_world[index.owner[rows]]
    return reprojected(rows[~occluded(view, points, index.voxels)], view, database)


def reprojected(rows: Rows, view: View, database: LandmarkDatabase) -> Prediction:
    """Where a view sees the landmarks of some rows: those in the image, large enough for SIFT."""
    points = database.index.points_world[database.index.owner[rows]]
    px, depth = view.project(points)
    tip, _ = view.project(points + database.index.patch_world[rows])
    prediction = Prediction(rows, px, tip - px)
    radius = np.linalg.norm(prediction.patch_px, axis=1)
    fits = (radius > MIN_RADIUS_PX) & (radius < max(view.intrinsics.size) / 4)
    inside = (depth > 0) & (px >= 0).all(1) & (px < view.intrinsics.size).all(1)
    return prediction[fits & inside]


def local_keyframes(view: View, index: MapIndex) -> Rows:
    """The keyframes that share the most of the view, judged by a few landmarks of each."""
    poses = index.T_world_keyframe
    count: Rows = _shared_probes(
        _unpacked(view), index.points_world, index.sees_start, index.sees, poses
    )
    best = np.argsort(-count, kind="stable")[:LOCAL_KEYFRAMES]
    return best[count[best] > 0]


def _visible(landmarks: NDArray[np.int32], view: View, index: MapIndex) -> NDArray[np.bool_]:
    """Which landmarks (N,) are in the image, and seen by a keyframe from a like viewpoint."""
    seen: NDArray[np.bool_] = _are_visible(
        _unpacked(view),
        landmarks,
        index.points_world,
        index.seen_start,
        index.seen_by,
        index.T_world_keyframe,
    )
    return seen


def _unpacked(view: View) -> tuple[Array, Array, Array]:
    """The view for compiled code: ``T_camera_world``, the centre, and fx, fy, cx, cy, size."""
    k = view.intrinsics
    camera = np.array([k.fx, k.fy, k.cx, k.cy, k.width, k.height])
    return np.ascontiguousarray(view.T_camera_world), view.T_world_camera[:3, 3].copy(), camera


@compiled
def _are_visible(
    camera: tuple[Array, Array, Array],
    landmarks: NDArray[np.int32],
    points: NDArray[np.float32],
    seen_start: NDArray[np.int32],
    seen_by: NDArray[np.int32],
    T_world_keyframe: Array,
) -> NDArray[np.bool_]:
    """See `_visible`."""
    seen = np.zeros(len(landmarks), np.bool_)
    for n in range(len(landmarks)):
        landmark = landmarks[n]
        if not _inside(camera, points[landmark]):
            continue
        for row in range(seen_start[landmark], seen_start[landmark + 1]):
            if _similar_viewpoint(points[landmark], camera[1], T_world_keyframe[seen_by[row]]):
                seen[n] = True
                break
    return seen


@compiled
def _shared_probes(
    camera: tuple[Array, Array, Array],
    points: NDArray[np.float32],
    sees_start: NDArray[np.int32],
    sees: NDArray[np.int32],
    T_world_keyframe: Array,
) -> Rows:
    """How many of each keyframe's probes (K,) the view sees from a like viewpoint."""
    count = np.zeros(len(T_world_keyframe), np.intp)
    for k in range(len(count)):
        begin, end = sees_start[k], sees_start[k + 1]
        step = max((end - begin) // PROBES, 1)
        for n in range(PROBES if end > begin else 0):
            point = points[sees[min(begin + step * n, end - 1)]]
            if _inside(camera, point) and _similar_viewpoint(point, camera[1], T_world_keyframe[k]):
                count[k] += 1
    return count


@compiled
def _inside(camera: tuple[Array, Array, Array], point: NDArray[np.float32]) -> bool:
    """Whether a point (3,) projects into the image."""
    T, _, (fx, fy, cx, cy, width, height) = camera
    X, Y, Z = point
    depth = T[2, 0] * X + T[2, 1] * Y + T[2, 2] * Z + T[2, 3]
    if not depth > 0:
        return False
    z = max(depth, MIN_DEPTH_M)
    x = fx * (T[0, 0] * X + T[0, 1] * Y + T[0, 2] * Z + T[0, 3]) / z + cx
    y = fy * (T[1, 0] * X + T[1, 1] * Y + T[1, 2] * Z + T[1, 3]) / z + cy
    return bool(x >= 0 and y >= 0 and x < width and y < height)


@compiled
def _similar_viewpoint(point: NDArray[np.float32], centre: Array, T_world_keyframe: Array) -> bool:
    """Whether a keyframe sees a point (3,) from a like direction and distance as our centre."""
    product, our_squared, their_squared = 0.0, 0.0, 0.0
    for k in range(3):
        ours, theirs = centre[k] - point[k], T_world_keyframe[k, 3] - point[k]
        product += ours * theirs
        our_squared += ours * ours
        their_squared += theirs * theirs
    if not product > MAX_TURN * np.sqrt(our_squared * their_squared):
        return False
    most = 4**MAX_OCTAVES
    return bool(our_squared < most * their_squared and their_squared < most * our_squared)
