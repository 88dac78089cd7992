"""Recordings for the rerun viewer: rerun.io, by its package, which is optional and large.

Poses are of cameras that look along z, with y down. Pixels are counted from the corner of the first
one, so principal points have half a pixel more than here.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.core.posed_images import CORNER_PX
from vnav.core.trajectory import Trajectory
from vnav.errors import MapError
from vnav.io.files import write_bytes

WORLD = "world"  # what all is below, z up
TIMELINE = "stamp"  # of captures, in seconds since 1970
STAMP = "datetime64[us]"  # a float of today's seconds since 1970 holds no more
Color = tuple[int, int, int]


def require_rerun() -> None:
    """MapError where rerun-sdk is not installed."""
    try:
        import rerun  # noqa: F401
    except ImportError as error:
        raise MapError(
            "expected rerun-sdk to write a recording for rerun, found it not installed; run"
            " 'pip install vnav-rgbd[rerun]'"
        ) from error


class RerunRecording:
    """What the viewer is to show, in one world, z up; `require_rerun` first.

    A ``name`` is a path in it; a camera's images have the name of the camera.
    """

    def __init__(self) -> None:
        import rerun

        self._stream = rerun.RecordingStream("vnav", recording_id="map", send_properties=False)
        self._bytes = self._stream.binary_stream()
        self._add("", rerun.ViewCoordinates.RIGHT_HAND_Z_UP)

    def add_cloud(self, name: str, cloud: PointCloud) -> None:
        """Coloured points."""
        import rerun

        self._add(name, rerun.Points3D(cloud.points_world, colors=cloud.colors))

    def add_mesh(self, name: str, mesh: Mesh) -> None:
        """A coloured surface."""
        import rerun

        surface = rerun.Mesh3D(
            vertex_positions=mesh.vertices_world,
            vertex_normals=mesh.normals_world,
            vertex_colors=mesh.colors,
            triangle_indices=mesh.triangles.astype(np.uint32),
        )
        self._add(name, surface)

    def add_lines(self, name: str, lines: Sequence[Array], color: Color) -> None:
        """Lines (N, 3) through points of the world."""
        import rerun

        self._add(name, rerun.LineStrips3D(lines, colors=[color]))

    def add_camera(
        self, name: str, camera: Intrinsics, length_m: float, where: Array | Trajectory
    ) -> None:
        """A pinhole, drawn so long, at a pose ``T_world_camera`` or, over time, along many."""
        import rerun

        K = camera.K
        K[:2, 2] += CORNER_PX
        pinhole = rerun.Pinhole(
            image_from_camera=K,
            resolution=camera.size,
            camera_xyz=rerun.ViewCoordinates.RDF,
            image_plane_distance=length_m,
        )
        self._add(name, pinhole)
        if isinstance(where, Trajectory):
            T = where.T_world_camera
            poses = rerun.Transform3D.columns(translation=T[:, :3, 3], mat3x3=T[:, :3, :3])
            self._send(name, where.stamps_s, poses)
        else:
            self._add(name, rerun.Transform3D(translation=where[:3, 3], mat3x3=where[:3, :3]))

    def add_jpegs(self, name: str, stamps_s: NDArray[np.float64], images: list[bytes]) -> None:
        """What a camera sees, from each stamp to the next."""
        import rerun

        kinds = ["image/jpeg"] * len(images)
        self._send(name, stamps_s, rerun.EncodedImage.columns(blob=images, media_type=kinds))

    def write(self, path: Path) -> None:
        """Write all of it; OSError where the file cannot be written."""
        write_bytes(path, self._bytes.read(flush=True))

    def _add(self, name: str, what: Any) -> None:
        self._stream.log(f"{WORLD}/{name}", what, static=True)

    def _send(self, name: str, stamps_s: NDArray[np.float64], columns: Any) -> None:
        import rerun

        stamps = np.rint(stamps_s * 1e6).astype(np.int64).astype(STAMP)
        times = rerun.TimeColumn(TIMELINE, timestamp=stamps)
        self._stream.send_columns(f"{WORLD}/{name}", [times], columns)
