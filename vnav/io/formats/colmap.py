"""Sparse models of COLMAP as text: colmap.github.io/format.html.

COLMAP, hloc and tools for splatting read them. A pose is world to camera, x right, y down, z
forward as here. The centre of the upper left pixel is (0.5, 0.5) there, and (0, 0) here.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.posed_images import CORNER_PX, PosedImage, PosedImages
from vnav.io.files import write_text

NO_POINT = -1


def write_model(folder: Path, views: PosedImages) -> list[Path]:
    """Write cameras.txt, images.txt and points3D.txt; which they are.

    Ids are those of vnav, counted from 1: capture, keyframe number, landmark. An image has all its
    keypoints, in the order of its features.
    """
    texts = {
        "cameras.txt": _cameras(views.cameras),
        "images.txt": _images(views),
        "points3D.txt": _points(views),
    }
    for name, lines in texts.items():
        write_text(folder / name, "".join(f"{line}\n" for line in lines))
    return [folder / name for name in texts]


def _cameras(cameras: Iterable[Intrinsics]) -> Iterator[str]:
    yield "# CAMERA_ID, MODEL, WIDTH, HEIGHT, fx, fy, cx, cy"
    for number, c in enumerate(cameras, 1):
        values = c.fx, c.fy, c.cx + CORNER_PX, c.cy + CORNER_PX
        yield f"{number} PINHOLE {c.width} {c.height} {_numbers(values)}"


def _images(views: PosedImages) -> Iterator[str]:
    """Two lines an image: its pose, and its keypoints with the landmarks that they are of."""
    yield "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
    yield "# POINTS2D[] as X, Y, POINT3D_ID"
    seen = views.landmarks
    for image in views.images:
        T_camera_world = se3.inverse(image.T_world_camera)
        x, y, z, w = se3.quat_xyzw(T_camera_world)
        pose = _numbers((w, x, y, z, *T_camera_world[:3, 3]))
        yield f"{image.number + 1} {pose} {image.camera + 1} {image.name}.jpg"
        point = np.full(len(image.keypoints_px), NO_POINT)
        rows = seen.keyframe == image.number
        point[seen.feature[rows]] = seen.landmark[rows] + 1
        keypoints = (image.keypoints_px.astype(float) + CORNER_PX).tolist()
        pairs = zip(keypoints, point.tolist(), strict=True)
        yield " ".join(f"{u:.9g} {v:.9g} {known}" for (u, v), known in pairs)


def _points(views: PosedImages) -> Iterator[str]:
    """One line a landmark, with the mean of its reprojection errors in pixels."""
    yield "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"
    seen = views.landmarks
    count = np.bincount(seen.landmark, minlength=len(seen))
    error_px = np.bincount(seen.landmark, _errors_px(views), len(seen)) / np.maximum(count, 1)
    begins = np.searchsorted(seen.landmark, np.arange(len(seen) + 1))
    for number, (begin, end) in enumerate(zip(begins, begins[1:], strict=False)):
        position = _numbers(seen.points_world[number].tolist())
        color = " ".join(map(str, views.colors[number]))
        tracked = zip(seen.keyframe[begin:end] + 1, seen.feature[begin:end], strict=True)
        track = " ".join(f"{image} {feature}" for image, feature in tracked)
        yield f"{number + 1} {position} {color} {error_px[number]:.4f} {track}"


def _errors_px(views: PosedImages) -> Array:
    """How far each observation (M,) is from where its landmark projects to."""
    seen = views.landmarks
    errors_px = np.zeros(len(seen.landmark))
    for image in views.images:
        rows = seen.keyframe == image.number
        errors_px[rows] = _errors_in(image, views, rows)
    return errors_px


def _errors_in(image: PosedImage, views: PosedImages, rows: Any) -> Array:
    seen = views.landmarks
    T_camera_world = se3.inverse(image.T_world_camera)
    points_camera = se3.transform(T_camera_world, seen.points_world[seen.landmark[rows]])
    found = views.cameras[image.camera].project(points_camera)
    return np.asarray(np.hypot(*(found - image.keypoints_px[seen.feature[rows]]).T))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.17g}" for value in values)
