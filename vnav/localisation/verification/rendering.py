"""What the map's keyframes show from a view: their pixels, carried there by their depth."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.core.frame import Frame
from vnav.core.map_index import MapIndex
from vnav.localisation.pixels import Pixels
from vnav.localisation.verification.occlusion import occluded
from vnav.localisation.verification.prediction import local_keyframes
from vnav.localisation.view import MIN_DEPTH_M, View

KEYFRAMES = 8  # that share the most of the view
COLUMNS = 320  # of a keyframe's pixels that are carried
ASKED = 2000  # pixels that tell how bright a keyframe is
DARK = 4.0  # grey levels, which add to both sides of a ratio
FAR_M = 1e4  # beyond what any sensor sees
BEHIND = 1.05  # times as far as what stands before it
AROUND = np.ones((3, 3), np.uint8)

Depths = NDArray[np.float32]
Colors = NDArray[np.float32]  # (M, 3)
Point = tuple[float, float, float]
Carried = tuple[Rows, Depths, Colors]  # which pixels of the view they are seen in


def rendered(view: View, index: MapIndex, pixels: Pixels) -> NDArray[np.float32]:
    """The photo (H, W, 3) in small as a view would show it, NaN where no keyframe sees anything.

    What does not stand in the map any more, or never did, is left out: people, and what departed.
    So is what stands behind something that these keyframes do not see. Each keyframe is as bright,
    by channel, as the photo where it lies on it.
    """
    height, width = pixels.photo.shape[:2]
    nearest = np.full(height * width, FAR_M, np.float32)
    carried: list[Carried] = []
    for k in local_keyframes(view, index)[:KEYFRAMES].tolist():
        carried.append(_carried(pixels.keyframe(k), k, view, index, nearest, width))
    farthest = BEHIND * cv2.erode(nearest.reshape(height, width), AROUND).ravel()
    photo = pixels.photo.reshape(-1, 3)
    sums, counts = np.zeros((height * width, 3)), np.zeros((height * width, 1))
    for cells, depths, colors in carried:
        if len(cells):
            _add(cells, depths, colors, _gain(colors, photo[cells]), farthest, sums, counts)
    counts[_hidden(nearest, view, index, width)] = 0
    shown = np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)
    return shown.reshape(height, width, 3).astype(np.float32)


def _carried(
    frame: Frame, number: int, view: View, index: MapIndex, nearest: Depths, width: int
) -> Carried:
    """The pixels of a keyframe with depth that lie in a view in small; those nearest are noted."""
    step = max(1, round(frame.intrinsics.width / COLUMNS))
    every = np.s_[step // 2 :: step, step // 2 :: step]
    depth_m = np.ascontiguousarray(frame.depth_m[every])
    color = cv2.blur(np.asarray(frame.color), (step, step))[every].reshape(-1, 3)
    fx, fy, cx, cy = frame.intrinsics.pinhole
    camera = np.array([fx, fy, cx - step // 2, cy - step // 2]) / step
    poses = index.T_world_keyframe[number].copy(), view.T_camera_world.copy()
    into = np.array(view.intrinsics.scaled(width, len(nearest) // width).pinhole)
    voxels = index.voxels.away, index.voxels.origin.copy(), index.voxels.edge_m
    cells, depths = _projected(depth_m, camera, poses, into, voxels, nearest, width)
    seen = cells >= 0
    return cells[seen], depths[seen], color[seen].astype(np.float32)


def _hidden(nearest: Depths, view: View, index: MapIndex, width: int) -> Rows:
    """The pixels of a view in small whose nearest point stands behind something."""
    seen = np.flatnonzero(nearest < FAR_M)
    camera = view.intrinsics.scaled(width, len(nearest) // width)
    px = np.stack([seen % width, seen // width], 1).astype(np.float32)
    points = se3.transform(view.T_world_camera, camera.unproject(px, nearest[seen]))
    return seen[occluded(view, points.astype(np.float32), index.voxels)]


def _gain(colors: Colors, photo: Colors) -> Array:
    """How much brighter (3,) a photo is than the colours that lie on it."""
    few = max(1, len(colors) // ASKED)
    return np.asarray(np.median((photo[::few] + DARK) / (colors[::few] + DARK), axis=0), float)


@compiled
def _projected(
    depth_m: Depths,
    camera: Array,
    poses: tuple[Array, Array],
    into: Array,
    voxels: tuple[NDArray[np.uint8], Array, float],
    nearest: Depths,
    width: int,
) -> tuple[Rows, Depths]:
    """Which pixel of a view each pixel (M,) with depth lies in, and how deep; -1 where in none."""
    rows, columns = depth_m.shape
    height = len(nearest) // width
    cells, depths = np.full(rows * columns, -1, np.intp), np.zeros(rows * columns, np.float32)
    for n in range(rows * columns):
        z = float(depth_m[n // columns, n % columns])
        if not z > 0:
            continue
        x = (n % columns - camera[2]) / camera[0] * z
        y = (n // columns - camera[3]) / camera[1] * z
        point = _moved(poses[0], (x, y, z))
        right, down, deep = _moved(poses[1], point)
        if not deep > MIN_DEPTH_M or not _stands(point, voxels):
            continue
        column = int(np.floor(into[0] * right / deep + into[2] + 0.5))
        row = int(np.floor(into[1] * down / deep + into[3] + 0.5))
        if 0 <= column < width and 0 <= row < height:
            cells[n], depths[n] = row * width + column, deep
            nearest[cells[n]] = min(nearest[cells[n]], depths[n])
    return cells, depths


@compiled
def _moved(T: Array, point: Point) -> Point:
    """A point by a pose."""
    x, y, z = point
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@compiled
def _stands(point: Point, voxels: tuple[NDArray[np.uint8], Array, float]) -> bool:
    """Whether something stands in the voxel of a point, or in one beside it."""
    away, origin, edge_m = voxels
    x, y, z = (
        int(np.floor((point[0] - origin[0]) / edge_m)),
        int(np.floor((point[1] - origin[1]) / edge_m)),
        int(np.floor((point[2] - origin[2]) / edge_m)),
    )
    if x < 0 or y < 0 or z < 0:
        return False
    if x >= away.shape[0] or y >= away.shape[1] or z >= away.shape[2]:
        return False
    return bool(away[x, y, z] <= 1)


@compiled
def _add(
    cells: Rows,
    depths: Depths,
    colors: Colors,
    gain: Array,
    farthest: Depths,
    sums: Array,
    counts: Array,
) -> None:
    """Add colours (M, 3), so much brighter, to the sums (P, 3) and counts (P, 1) of their pixels.

    Not those that are farther away than what stands before them.
    """
    for n in range(len(cells)):
        cell = cells[n]
        if depths[n] <= farthest[cell]:
            counts[cell, 0] += 1
            for k in range(3):
                sums[cell, k] += (colors[n, k] + DARK) * gain[k] - DARK
