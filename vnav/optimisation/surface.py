"""The surface that cameras saw, sampled from depth images as points with normals."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.volumes.cloud import voxels_of

COLUMNS = 80  # of sampled pixels in an image; normals reach from one to the next
AT_ONCE = 100_000  # points that are sorted out together, at least
VOXEL_M = 0.05  # of the surface, so that support is area and not time spent looking


@dataclass(frozen=True)
class Surface:
    """Points (N, 3) with unit normals (N, 3) towards the camera that saw them, in any frame."""

    points: Array
    normals: Array


def sample_surface(
    depths: Iterable[NDArray[np.float32]],
    cameras: Sequence[Intrinsics],
    T_any_camera: Array,
) -> Surface:
    """The surface in several depth images, one point a voxel; empty where nothing is seen.

    The first one of a voxel stays. They are sorted out on the way, so that memory follows the area.
    """
    parts = [np.zeros((0, 6))]  # sorted out, then what came since
    for depth, camera, T in zip(depths, cameras, T_any_camera, strict=True):
        parts.append(_in_image(depth, camera, T))
        if sum(map(len, parts[1:])) > max(len(parts[0]), AT_ONCE):
            parts = [_first_of_voxels(parts)]
    both = _first_of_voxels(parts)
    return Surface(both[:, :3], both[:, 3:])


def _first_of_voxels(parts: Sequence[Array]) -> Array:
    """Points and normals (N, 6), the first of each voxel, ordered by voxel."""
    both = np.concatenate(parts)
    return both[voxels_of(both[:, :3], VOXEL_M)[0]]


def _in_image(depth_m: NDArray[np.float32], camera: Intrinsics, T_any_camera: Array) -> Array:
    """Points and normals (N, 6) of one depth image, where it is smooth."""
    step = max(1, camera.width // COLUMNS)
    z = depth_m[::step, ::step].astype(float)
    v, u = np.mgrid[: z.shape[0], : z.shape[1]] * float(step)
    points = camera.unproject(np.stack([u, v], -1), z)
    right, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
    middle = points[1:-1, 1:-1]
    normals = np.cross(down, right)  # towards the camera
    length = np.linalg.norm(normals, axis=-1)
    around = np.stack([z[1:-1, 2:], z[1:-1, :-2], z[2:, 1:-1], z[:-2, 1:-1], z[1:-1, 1:-1]])
    smooth = (around.min(0) > 0) & (around.max(0) < 1.25 * around.min(0))
    good = smooth & (length > 1e-9)
    return np.concatenate(
        [
            se3.transform(T_any_camera, middle[good]),
            normals[good] / length[good][:, None] @ T_any_camera[:3, :3].T,
        ],
        1,
    )
