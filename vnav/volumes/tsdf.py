"""A truncated signed distance volume and the mesh of its surface; sole user of open3d.

Source: Curless and Levoy 1996; Dong et al., ASH (open3d's VoxelBlockGrid), 2022. Only blocks of
space near a surface are stored. Importing open3d takes a second: import this module where needed.
"""

import numpy as np
import open3d.core as o3c
from numpy.typing import NDArray
from open3d.t.geometry import Image, VoxelBlockGrid

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.point_cloud import Mesh
from vnav.errors import VnavError

BLOCK_VOXELS = 8  # edge of a block; 16, open3d's default, stores twice as much empty space
BLOCKS = 8192  # room to begin with (50 MB), doubled by open3d when it is full
TRUNCATION_VOXELS = 8.0  # distances beyond this many voxels are not kept
UNITS_PER_METRE = 5000.0  # open3d integrates 8-bit colour together with 16-bit depth only
TOO_FEW = 1.0  # a surface that only so many frames saw is left out of the mesh


class TsdfVolume:
    """Signed distances and colours in voxels of ``voxel_m`` around what was seen."""

    def __init__(self, voxel_m: float, max_range_m: float) -> None:
        self._max_range_m = max_range_m
        self._device = o3c.Device("CPU:0")
        self._grid = VoxelBlockGrid(
            ("tsdf", "weight", "color"),
            (o3c.float32, o3c.uint16, o3c.uint16),
            ((1,), (1,), (3,)),
            voxel_m,
            BLOCK_VOXELS,
            BLOCKS,
            self._device,
        )

    def integrate(
        self,
        depth_m: NDArray[np.float32],
        color: NDArray[np.uint8],
        camera: Intrinsics,
        T_world_camera: NDArray[np.float64],
    ) -> None:
        """Add a frame: depth (H, W) in metres, 0 where there is none, and RGB (H, W, 3)."""
        units = np.rint(depth_m * UNITS_PER_METRE).astype(np.uint16)
        depth, image = Image(o3c.Tensor(units)), Image(o3c.Tensor(np.ascontiguousarray(color)))
        K, T_camera_world = o3c.Tensor(camera.K), o3c.Tensor(se3.inverse(T_world_camera))
        limits = (UNITS_PER_METRE, self._max_range_m, TRUNCATION_VOXELS)
        try:
            blocks = self._grid.compute_unique_block_coordinates(depth, K, T_camera_world, *limits)
        except RuntimeError as error:
            if "No block is touched" not in str(error):
                raise
            return  # open3d looks at every fourth pixel, and none of them has depth in range
        self._grid.integrate(blocks, depth, image, K, K, T_camera_world, *limits)

    def mesh(self) -> Mesh:
        """The surface where the distance is zero, the same bytes for the same frames."""
        if not self._grid.hashmap().size():
            return _canonical(np.zeros((0, 9), np.float32), np.zeros((0, 3), np.int64))
        mesh = self._grid.extract_triangle_mesh(TOO_FEW)
        if not len(mesh.vertex.positions):
            return _canonical(np.zeros((0, 9), np.float32), np.zeros((0, 3), np.int64))
        vertex = (mesh.vertex.positions, mesh.vertex.normals, mesh.vertex.colors)
        rows = np.hstack([part.numpy() for part in vertex])
        return _canonical(rows, mesh.triangle.indices.numpy())


def _canonical(vertices: NDArray[np.float32], triangles: NDArray[np.int64]) -> Mesh:
    """A mesh whose order does not depend on threads; vertices are position, normal, colour.

    open3d numbers vertices as its threads find them. Here they are sorted, equal ones joined,
    and triangles begin with their least vertex and are sorted.
    """
    order = np.lexsort(vertices.T[::-1])
    rows = vertices[order]
    new = np.ones(len(rows), bool)
    new[1:] = (rows[1:] != rows[:-1]).any(1)
    number = np.empty(len(rows), np.int32)
    number[order] = np.cumsum(new) - 1
    turned = number[triangles].reshape(-1, 3)
    first = turned.argmin(1)[:, None]
    turned = np.take_along_axis(turned, (first + np.arange(3)) % 3, 1)
    turned = turned[np.lexsort(turned.T[::-1])]
    rows = rows[new]
    colors = np.rint(np.clip(rows[:, 6:], 0, 1) * 255).astype(np.uint8)
    return Mesh(rows[:, :3], rows[:, 3:6], colors, turned)


def self_test() -> None:
    """Fuse views of a wall and measure it in the mesh; VnavError where open3d gets it wrong."""
    camera = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    volume = TsdfVolume(0.05, 3.0)
    for _ in range(2):
        depth, color = np.full((48, 64), 1.5, np.float32), np.full((48, 64, 3), 200, np.uint8)
        volume.integrate(depth, color, camera, np.eye(4))
    mesh = volume.mesh()
    off_m = np.abs(mesh.vertices_world[:, 2] - 1.5)
    if not len(off_m) or off_m.max() > 0.005 or not (mesh.colors == 200).all():
        raise VnavError(
            f"expected open3d to put a wall at 1.5 m within 5 mm, found {len(off_m)} vertices off"
            f" by up to {off_m.max(initial=0):.3f} m; reinstall open3d-cpu"
        )
