"""Clouds and meshes as files: binary little-endian PLY, and OBJ."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.point_cloud import Mesh, PointCloud
from vnav.errors import MapError
from vnav.io.files import whole_file, write_bytes

POSITION = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
NORMAL = [("nx", "<f4"), ("ny", "<f4"), ("nz", "<f4")]
COLOR = [("red", "u1"), ("green", "u1"), ("blue", "u1")]
TRIANGLE = [("corners", "u1"), ("a", "<i4"), ("b", "<i4"), ("c", "<i4")]
CLOUD_VERTEX, MESH_VERTEX = np.dtype(POSITION + COLOR), np.dtype(POSITION + NORMAL + COLOR)
NAMES = {"<f4": "float", "|u1": "uchar"}


def write_cloud(path: Path, cloud: PointCloud) -> None:
    """Write positions and colours."""
    vertices = _table(CLOUD_VERTEX, cloud.points_world, cloud.colors)
    write_bytes(path, _header(vertices) + vertices.tobytes())


def read_cloud(path: Path) -> PointCloud:
    """A cloud that `write_cloud` wrote; MapError where it is missing or damaged."""
    vertices, _ = _read(path, CLOUD_VERTEX)
    return PointCloud(_columns(vertices, POSITION), _columns(vertices, COLOR))


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write positions, normals, colours and triangles."""
    vertices = _table(MESH_VERTEX, mesh.vertices_world, mesh.normals_world, mesh.colors)
    corners = np.full((len(mesh.triangles), 1), 3)
    triangles = _table(np.dtype(TRIANGLE), corners, mesh.triangles)
    header = _header(vertices, len(triangles))
    write_bytes(path, header + vertices.tobytes() + triangles.tobytes())


def read_mesh(path: Path) -> Mesh:
    """A mesh that `write_mesh` wrote; MapError where it is missing or damaged."""
    vertices, triangles = _read(path, MESH_VERTEX)
    points, normals, colors = (_columns(vertices, part) for part in (POSITION, NORMAL, COLOR))
    return Mesh(points, normals, colors, _columns(triangles, TRIANGLE[1:]))


def write_obj(path: Path, mesh: Mesh) -> None:
    """Write a mesh as Wavefront OBJ: colours 0 to 1 behind the positions, as MeshLab reads them."""
    vertices = np.hstack([mesh.vertices_world, mesh.colors / 255])
    corners = np.repeat(mesh.triangles + 1, 2, axis=1)
    with whole_file(path) as file:
        np.savetxt(file, vertices, "v %.5f %.5f %.5f %.3f %.3f %.3f")
        np.savetxt(file, mesh.normals_world, "vn %.4f %.4f %.4f")
        np.savetxt(file, corners, "f %d//%d %d//%d %d//%d")


def _table(dtype: np.dtype[Any], *parts: NDArray[Any]) -> NDArray[Any]:
    table = np.empty(len(parts[0]), dtype)
    columns = (column for part in parts for column in part.T)
    for name, column in zip(dtype.names or (), columns, strict=True):
        table[name] = column
    return table


def _columns(table: NDArray[Any], part: list[tuple[str, str]]) -> NDArray[Any]:
    return np.stack([table[name] for name, _ in part], 1)


def _header(vertices: NDArray[Any], triangles: int | None = None) -> bytes:
    properties = vertices.dtype.descr
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property {NAMES[str(kind)]} {name}" for name, kind, *_ in properties]
    if triangles is not None:
        lines += [f"element face {triangles}", "property list uchar int vertex_indices"]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def _read(path: Path, vertex: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices and triangles of a file that vnav wrote."""
    try:
        header, end, body = path.read_bytes().partition(b"end_header\n")
        counts = [int(line.split()[-1]) for line in header.split(b"\n") if b"element" in line]
        vertices = np.frombuffer(body, vertex, counts[0])
        triangles = np.frombuffer(body, TRIANGLE, -1, vertices.nbytes)
        whole = header + end == _header(vertices, *counts[1:])
        damage = "" if whole and len(triangles) == sum(counts[1:]) else "another layout"
    except (OSError, ValueError, IndexError) as error:
        damage = str(error)
    if damage:
        raise MapError(
            f"expected a PLY file written by vnav in {path}, found: {damage}; run 'vnav fuse'"
        )
    return vertices, triangles
