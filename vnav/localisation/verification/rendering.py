"""What the map's keyframes show from a view: their pixels, carried there by their depth."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.core.frame import Frame
from vnav.core.map_index import MapIndex
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

Colors = NDArray[np.float32]  # (..., 3) RGB


@dataclass(frozen=True)
class StandingPoints:
    """Points (M, 3) of the world that a keyframe sees, and their colours (M, 3)."""

    world: NDArray[np.float32]
    colors: Colors


def standing_points(frame: Frame, number: int, index: MapIndex) -> StandingPoints:
    """What a keyframe sees of what stands in the map: neither people nor what departed since."""
    step = max(1, round(frame.intrinsics.width / COLUMNS))
    rows, columns = np.nonzero(frame.depth_m[step // 2 :: step, step // 2 :: step])
    v, u = (k * step + step // 2 for k in (rows, columns))
    points = frame.intrinsics.unproject(np.stack([u, v], 1), frame.depth_m[v, u])
    world = se3.transform(index.T_world_keyframe[number], points).astype(np.float32)
    voxels = index.voxels
    cells = np.floor((world - voxels.origin) / voxels.edge_m).astype(np.intp)
    stands = voxels.away_from(cells.T) <= 1
    colors = cv2.blur(np.asarray(frame.color), (step, step))[v, u]
    return StandingPoints(world[stands], colors[stands].astype(np.float32))


def rendered(
    view: View, photo: Colors, index: MapIndex, points_of: Callable[[int], StandingPoints]
) -> Colors:
    """A photo (H, W, 3) in small as a view would show it, NaN where no keyframe sees anything.

    What stands behind something that these keyframes do not see is left out. Each keyframe is as
    bright, by channel, as the photo where it lies on it. ``points_of``: a keyframe's by its number.
    """
    height, width = photo.shape[:2]
    small = View(view.T_camera_world, view.intrinsics.scaled(width, height))
    keyframes = local_keyframes(view, index)[:KEYFRAMES].tolist()
    if not keyframes:
        return np.full(photo.shape, np.nan, np.float32)
    seen = [_seen(points_of(k), small, photo.reshape(-1, 3)) for k in keyframes]
    cells, depths, colors = (np.concatenate(column) for column in zip(*seen, strict=True))
    nearest = np.full(height * width, FAR_M)
    np.minimum.at(nearest, cells, depths)
    front = depths <= BEHIND * cv2.erode(nearest.reshape(height, width), AROUND).ravel()[cells]
    cells, colors = cells[front], colors[front]
    counts = np.bincount(cells, minlength=height * width)
    counts[_hidden(nearest, small, index)] = 0
    sums = np.stack([np.bincount(cells, c, height * width) for c in colors.T], 1)
    shown = np.full((height * width, 3), np.nan, np.float32)
    is_shown = counts > 0
    shown[is_shown] = sums[is_shown] / counts[is_shown, None]
    return shown.reshape(height, width, 3)


def _seen(points: StandingPoints, view: View, photo: Colors) -> tuple[Rows, Array, Colors]:
    """In which pixels of a view points are seen, how deep, and their colours, as bright as there.

    ``photo`` (P, 3): what the view's pixels have.
    """
    k = view.intrinsics
    camera = np.array([*k.pinhole, *k.size])
    cells, depths = _projected(points.world, view.T_camera_world.copy(), camera)
    inside = cells >= 0
    cells, colors = cells[inside], points.colors[inside] + DARK
    if len(cells):
        few = np.s_[:: max(1, len(cells) // ASKED)]
        colors *= np.median((photo[cells[few]] + DARK) / colors[few], axis=0)
    return cells, depths[inside], colors - DARK


@compiled
def _projected(
    points: NDArray[np.float32], T_camera_world: Array, camera: Array
) -> tuple[Rows, Array]:
    """Which pixel each point (M,) lies in, -1 where in none, and how deep.

    ``camera``: fx, fy, cx, cy, width, height.
    """
    T, (fx, fy, cx, cy, width, height) = T_camera_world, camera
    cells, depths = np.full(len(points), -1, np.intp), np.zeros(len(points))
    for n in range(len(points)):
        x, y, z = points[n]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if depth > MIN_DEPTH_M:
            right = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            column = np.floor(fx * right / depth + cx + 0.5)
            row = np.floor(fy * down / depth + cy + 0.5)
            if 0 <= column < width and 0 <= row < height:
                cells[n], depths[n] = int(row * width + column), depth
    return cells, depths


def _hidden(nearest: Array, view: View, index: MapIndex) -> Rows:
    """The pixels of a view whose nearest point stands behind something."""
    seen = np.flatnonzero(nearest < FAR_M)
    row, column = np.divmod(seen, view.intrinsics.width)
    points = view.intrinsics.unproject(np.stack([column, row], 1), nearest[seen])
    points_world = se3.transform(view.T_world_camera, points).astype(np.float32)
    return seen[occluded(view, points_world, index.voxels)]
