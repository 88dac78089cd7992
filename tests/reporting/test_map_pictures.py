"""What the pictures of a map show."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.patches import Patch

from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.core.mapping import Odometry
from vnav.core.places import GOAL, KEEP_OUT, ONE_WAY, Anchor, LostPlace, NamedPlace
from vnav.core.point_cloud import PointCloud
from vnav.io.formats.grid_files import read_grid
from vnav.io.store.artifacts import load_loops, load_odometry, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_pictures as pictures
from vnav.reporting.figures import legend, map_figure

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


def test_the_grid_has_the_places_with_a_name_that_lie_in_the_map() -> None:
    anchor = Anchor("", 0, np.eye(4))
    triangle = np.array([(-1.0, 2.0), (0.0, 2.0), (0.0, 3.0)])
    places: dict[str, NamedPlace | LostPlace] = {
        "desk": NamedPlace(GOAL, np.array([(0.2, 2.5)]), None, anchor),
        "rug": NamedPlace(KEEP_OUT, triangle, None, anchor),
        "aisle": NamedPlace(ONE_WAY, triangle + 0.1, np.pi / 2, anchor),
        "gone": LostPlace(KEEP_OUT, "its frame has no pose"),
    }
    figure = pictures.grid_figure(GRID, places)
    axes = figure.axes[0]
    assert {"desk", "rug", "aisle"} <= {text.get_text() for text in axes.texts}
    assert "gone" not in {text.get_text() for text in axes.texts}
    assert legend_of(figure)[4:] == ["to keep out of", "one way, as the arrows", "goal"]
    arrows = [text for text in axes.texts if getattr(text, "arrow_patch", None)]
    assert arrows
    for arrow in arrows:
        (x, y), tip = arrow.get_position(), arrow.xy  # type: ignore[attr-defined]
        np.testing.assert_allclose(np.subtract(tip, (x, y)) @ (1, 0), 0, atol=1e-9)
        assert tip[1] > y


@pytest.mark.parametrize("extent", [(0, 0.5, 0, 20), (0, 3, 0, 3), (0, 20, 0, 0.5)])
@pytest.mark.parametrize("longest_in", [5.5, 10.0])
def test_the_scale_bar_covers_neither_the_title_nor_the_map(
    extent: tuple[float, float, float, float], longest_in: float
) -> None:
    figure, axes = map_figure(extent, "Cloud, up to 2 m above the floor", longest_in)
    legend(figure, [Patch(label=label) for label in ("free", "occupied")])
    figure.draw_without_rendering()
    bar, length = axes.lines[0], axes.texts[0]
    assert "m" in length.get_text()
    title, above = axes.title.get_window_extent(), axes.get_window_extent().y1
    for part in (bar, length):
        box = part.get_window_extent()
        assert not box.overlaps(title)
        assert box.y0 >= above


def test_where_a_path_ends_where_it_began_both_ends_are_seen(fused_map: Path) -> None:
    folder = MapFolder(fused_map)
    odometry, poses = load_odometry(folder), load_optimised(folder).T_world_camera.copy()
    poses[-1] = poses[0]
    figure = pictures.trajectory_figure(GRID, odometry, poses, ())
    figure.draw_without_rendering()
    at = poses[0, :2, 3]
    start, end = (
        line for line in figure.axes[0].lines if np.array_equal(line.get_xydata(), at[None])
    )
    assert start.get_color() != end.get_color()
    # the end, a filled square, lies on the start, a ring whose inside is wider than its diagonal
    inside = start.get_markersize() - start.get_markeredgewidth()
    assert end.get_zorder() > start.get_zorder()
    assert start.get_markerfacecolor() == "none"
    assert inside > end.get_markersize() * np.sqrt(2)


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


def interrupted_after(odometry: Odometry, row: int) -> Odometry:
    """The same, where the next frame comes a second later."""
    frames = odometry.frames
    later = np.arange(len(frames)) > row
    return replace(odometry, frames=replace(frames, stamp_s=frames.stamp_s + later))


def test_no_line_claims_the_way_where_the_camera_was_not_followed(fused_map: Path) -> None:
    folder = MapFolder(fused_map)
    poses = load_optimised(folder).T_world_camera
    odometry = interrupted_after(load_odometry(folder), 20)
    figure = pictures.trajectory_figure(GRID, odometry, poses, ())
    drawn = {line.get_linestyle(): [] for line in figure.axes[0].lines}
    for line in figure.axes[0].lines:
        drawn[line.get_linestyle()].append(line.get_xydata().tolist())
    across = poses[20:22, :2, 3].tolist()
    assert across in drawn[":"]
    assert not any(a in line and b in line for line in drawn["-"] for a, b in [across])
    assert "frames without a pose (1), interruptions (1)" in legend_of(figure)


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
    assert [*pictures.draw(MapFolder(tmp_path / "map"))] == ["trajectory", "grid", "cloud"]
    for name in ("trajectory", "grid", "cloud"):
        picture = cv2.imread(str(tmp_path / "map" / "reports" / f"{name}.png"))
        assert picture.shape[1] > 500
        assert len(np.unique(picture)) > 10
