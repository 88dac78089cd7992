"""Clouds and meshes come back from their files, and other programs read them."""

from pathlib import Path

import numpy as np
import pytest

from vnav.core.point_cloud import Mesh, PointCloud
from vnav.errors import MapError
from vnav.io.formats.ply import read_cloud, read_mesh, write_cloud, write_mesh, write_obj

RNG = np.random.default_rng(0)


def cloud(count: int = 7) -> PointCloud:
    return PointCloud(RNG.random((count, 3)), RNG.integers(0, 256, (count, 3)))


def tetrahedron() -> Mesh:
    vertices = np.vstack([np.zeros(3), np.eye(3)])
    triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    return Mesh(vertices, vertices, np.arange(12).reshape(4, 3), triangles)


@pytest.mark.parametrize("count", [0, 7])
def test_a_cloud_comes_back(count: int, tmp_path: Path) -> None:
    written = cloud(count)
    write_cloud(tmp_path / "cloud.ply", written)
    read = read_cloud(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(read.points_world, written.points_world)
    np.testing.assert_array_equal(read.colors, written.colors)


def test_a_mesh_comes_back(tmp_path: Path) -> None:
    write_mesh(tmp_path / "mesh.ply", tetrahedron())
    read = read_mesh(tmp_path / "mesh.ply")
    for name, value in vars(tetrahedron()).items():
        np.testing.assert_array_equal(getattr(read, name), value)


def test_a_header_says_what_follows(tmp_path: Path) -> None:
    write_mesh(tmp_path / "mesh.ply", tetrahedron())
    header = (tmp_path / "mesh.ply").read_bytes().split(b"end_header\n")[0].decode().split("\n")
    assert header[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 4"]
    assert header[-3:] == ["element face 4", "property list uchar int vertex_indices", ""]
    assert [line.split()[1:] for line in header if "property" in line][:4] == [
        ["float", "x"],
        ["float", "y"],
        ["float", "z"],
        ["float", "nx"],
    ]


def test_an_obj_counts_from_one_and_holds_colours(tmp_path: Path) -> None:
    write_obj(tmp_path / "mesh.obj", tetrahedron())
    lines = (tmp_path / "mesh.obj").read_text("ascii").splitlines()
    assert len(lines) == 4 + 4 + 4
    assert lines[1] == "v 1.00000 0.00000 0.00000 0.012 0.016 0.020"  # 3, 4 and 5 of 255
    assert lines[8] == "f 1//1 3//3 2//2"


@pytest.mark.parametrize("content", [b"", b"ply\n", b"no ply at all"])
def test_another_file_is_an_error_that_names_it(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "cloud.ply").write_bytes(content)
    with pytest.raises(MapError, match=r"expected a PLY file written by vnav in .*cloud\.ply"):
        read_cloud(tmp_path / "cloud.ply")


@pytest.mark.parametrize("cut", [1, 60])
def test_a_file_that_is_cut_short_is_an_error(cut: int, tmp_path: Path) -> None:
    write_mesh(tmp_path / "mesh.ply", tetrahedron())
    content = (tmp_path / "mesh.ply").read_bytes()
    (tmp_path / "mesh.ply").write_bytes(content[:-cut])
    with pytest.raises(MapError, match="expected a PLY file"):
        read_mesh(tmp_path / "mesh.ply")


def test_a_mesh_is_no_cloud(tmp_path: Path) -> None:
    write_mesh(tmp_path / "mesh.ply", tetrahedron())
    with pytest.raises(MapError, match="expected a PLY file"):
        read_cloud(tmp_path / "mesh.ply")


def test_a_missing_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="No such file"):
        read_cloud(tmp_path / "none.ply")
