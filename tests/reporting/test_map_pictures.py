"""What the pictures of a map show."""

import shutil
from pathlib import Path

import cv2
import numpy as np

from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.core.point_cloud import PointCloud
from vnav.io.formats.grid_files import read_grid
from vnav.io.store.artifacts import load_loops, load_odometry, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_pictures as pictures

GRID = Grid((-1.0, 2.0), 0.5, np.array([[FREE, OCCUPIED, UNKNOWN], [FREE, FREE, FREE]]))


def legend_of(figure: object) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]  # type: ignore[attr-defined]


def test_the_grid_lies_where_its_cells_are_in_the_world() -> None:
    image = pictures.grid_figure(GRID).axes[0].images[0]
    assert tuple(image.get_extent()) == (-1.0, 0.5, 2.0, 3.0)
    assert image.origin == "lower"
    assert len(np.unique(image.get_array().reshape(-1, 3), axis=0)) == 3


def test_the_grid_legend_says_areas() -> None:
    legend = legend_of(pictures.grid_figure(GRID))
    assert legend == ["free, 1.0 m²", "occupied, 0.2 m²", "unknown, 0.2 m²", "walked, 0.0 m²"]


def test_the_trajectory_counts_keyframes_loops_and_frames_without_a_pose(fused_map: Path) -> None:
    folder = MapFolder(fused_map)
    figure = pictures.trajectory_figure(
        read_grid(fused_map / "fuse" / "grid.yaml"),
        load_odometry(folder),
        load_optimised(folder).T_world_camera,
        load_loops(folder),
    )
    legend = legend_of(figure)
    assert "keyframes (12)" in legend
    assert "accepted loops (1)" in legend
    assert "frames without a pose (1)" in legend


def test_a_path_beyond_the_grid_is_shown_whole(fused_map: Path) -> None:
    folder = MapFolder(fused_map)
    poses = load_optimised(folder).T_world_camera
    figure = pictures.trajectory_figure(GRID, load_odometry(folder), poses, ())
    (left, right), (bottom, top) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    x, y = poses[np.isfinite(poses[:, 0, 3]), :2, 3].T
    assert left < x.min()
    assert x.max() < right
    assert bottom < y.min()
    assert y.max() < top


def test_a_cloud_above_the_cut_is_an_empty_picture() -> None:
    high = PointCloud(np.array([[0, 0, 9]]), np.zeros((1, 3)))
    assert not pictures.cloud_figure(high).axes[0].images


def test_a_large_cloud_keeps_to_the_longest_side() -> None:
    corners = PointCloud(np.array([[0, 0, 0], [300, 30, 0]]), np.zeros((2, 3)))
    shape = pictures.cloud_figure(corners).axes[0].images[0].get_array().shape
    assert shape[1] <= pictures.LONGEST_PX + 1


def test_pictures_are_drawn_again_where_they_are_gone(fused_map: Path, tmp_path: Path) -> None:
    shutil.copytree(fused_map, tmp_path / "map")
    shutil.rmtree(tmp_path / "map" / "reports")
    paths = pictures.draw(MapFolder(tmp_path / "map"))
    assert [p.name for p in paths] == ["trajectory.png", "grid.png", "cloud.png"]
    for path in paths:
        picture = cv2.imread(str(path))
        assert picture.shape[1] > 500
        assert len(np.unique(picture)) > 10
