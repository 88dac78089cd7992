"""A room with known poses is fused; what comes out is held against the room."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config, FuseConfig
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.errors import MapError
from vnav.io.formats.grid_files import read_grid
from vnav.io.formats.ply import read_cloud, read_mesh
from vnav.io.store import artifacts
from vnav.io.store.map_folder import MapFolder
from vnav.masking.regions import LEAST_SHARE
from vnav.stages import fuse
from vnav.volumes.octree import Octree

FILES = (
    *("cloud.ply", "mesh.ply", "occupancy.ot", "occupancy.bt"),
    *("grid.pgm", "grid.yaml", "walked.pgm", "walked.yaml", "departed.npz"),
)


@pytest.fixture(scope="module")
def true_grid(tiny_capture: Path) -> Grid:
    return read_grid(tiny_capture / "truth" / "grid.yaml")


@pytest.fixture(scope="module")
def grid(fused_map: Path) -> Grid:
    return read_grid(fused_map / "fuse" / "grid.yaml")


def true_states_near(grid: Grid, truth: Grid, cells: np.ndarray, reach: int) -> np.ndarray:
    """The true states (N, (2 reach + 1)^2) of the cells around those that hold the centres."""
    steps = np.arange(-reach, reach + 1)
    around = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    found = truth.cells_at(grid.centres_of(cells))[:, None] + around
    inside = np.clip(found, 0, np.array(truth.cells.shape) - 1)
    return truth.cells[inside[..., 0], inside[..., 1]]


def test_late_depth_is_fused_from_where_the_camera_was_by_then(
    fused_map: Path,
    tmp_path: Path,
    altering: Callable[[MapFolder, str], AbstractContextManager[Path]],
) -> None:
    """A whole frame late: from where the next frame was, but for how much faster that moves."""
    shutil.copytree(fused_map, tmp_path / "map", ignore=shutil.ignore_patterns("fuse", "index"))
    folder = MapFolder(tmp_path / "map")
    odometry, result = artifacts.load_odometry(folder), artifacts.load_optimised(folder)
    frames = replace(odometry.frames, stamp_s=0.05 * np.arange(len(odometry.frames)))
    with altering(folder, "odometry") as draft:
        artifacts.save_odometry(draft, replace(odometry, frames=frames))
    with altering(folder, "optimise") as draft:
        artifacts.save_optimised(
            draft, replace(result, depth_delay_s=np.full(len(odometry.frames), 0.05))
        )
    rows, poses = odometry.keyframe_rows[:-1], result.T_world_camera
    found = np.array([view.T_world_camera for view in fuse.PosedFrames(folder)])[: len(rows)]
    off_m = np.linalg.norm(found[:, :3, 3] - poses[rows + 1, :3, 3], axis=1)
    step_m = np.linalg.norm(poses[rows, :3, 3] - poses[rows + 1, :3, 3], axis=1)
    assert np.median(off_m) < 0.2 * np.median(step_m)


def test_every_file_of_the_stage_is_written(fused_map: Path) -> None:
    assert {p.name for p in (fused_map / "fuse").iterdir()} == {*FILES, "stage.json"}


def test_occupied_cells_are_where_something_stands(grid: Grid, true_grid: Grid) -> None:
    # One cell for rounding on both grids, one for axial noise: 0.0025 z^2 is 4 cm at 4 m.
    occupied = np.argwhere(grid.cells == OCCUPIED)
    near = (true_states_near(grid, true_grid, occupied, 2) == OCCUPIED).any(1)
    assert len(occupied) > 100
    assert near.mean() > 0.99


def test_no_cell_is_free_where_something_was_measured_above_it(fused_map: Path, grid: Grid) -> None:
    # Heights one voxel inside the limits of what counts as an obstacle. Some voxels are seen at
    # their rim only and swept by other rays; a cell with five points of a 2 cm cloud is more.
    points = read_cloud(fused_map / "fuse" / "cloud.ply").points_world
    standing = points[(points[:, 2] > 0.15) & (points[:, 2] < 1.35)]
    cells, counts = np.unique(grid.cells_at(standing[:, :2]), axis=0, return_counts=True)
    measured = cells[counts >= 5]
    assert len(measured) > 300
    assert (grid.cells[tuple(measured.T)] == OCCUPIED).mean() > 0.97


def test_most_of_the_free_floor_is_found(grid: Grid, true_grid: Grid) -> None:
    assert 0.85 < grid.area_m2(FREE) / true_grid.area_m2(FREE) < 1.1


def test_the_report_says_shares_and_areas(fused_map: Path, grid: Grid) -> None:
    values = json.loads((fused_map / "reports" / "fuse.json").read_text("utf-8"))["values"]
    assert sum(values["share"].values()) == pytest.approx(1, abs=2e-4)  # printed to 1e-4
    assert values["area_m2"]["free"] == pytest.approx((grid.cells == FREE).sum() * 0.05**2)
    assert values["keyframes"] == 12


def test_cloud_mesh_and_octree_agree_on_the_floor(fused_map: Path) -> None:
    # Half the octree's voxel: all three show the same floor, noise far below that at its range.
    cloud = read_cloud(fused_map / "fuse" / "cloud.ply").points_world
    mesh = read_mesh(fused_map / "fuse" / "mesh.ply").vertices_world
    leaves = Octree.read(fused_map / "fuse" / "occupancy.ot").most_likely.leaves()
    occupied = leaves.centres_world[leaves.occupied]
    for points in (cloud, mesh, occupied):
        low = points[np.abs(points[:, 2]) < 0.1, 2]
        assert len(low) > 100
        assert abs(np.median(low)) <= 0.026


def test_a_finished_stage_is_reused(fused_map: Path) -> None:
    before = (fused_map / "fuse" / "stage.json").stat().st_mtime_ns
    assert fuse.run(MapFolder(fused_map), Config()).reused
    assert (fused_map / "fuse" / "stage.json").stat().st_mtime_ns == before


@pytest.mark.parametrize("threads", ["1", "8"])
def test_the_same_bytes_whatever_the_number_of_threads(
    threads: str, fused_map: Path, posed_map: Path, tmp_path: Path
) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    code = (
        "import sys; from pathlib import Path; from vnav.config import Config;"
        "from vnav.io.store.map_folder import MapFolder; from vnav.stages import fuse;"
        "fuse.run(MapFolder(Path(sys.argv[1])), Config())"
    )
    subprocess.run(
        [sys.executable, "-P", "-c", code, str(tmp_path / "map")],
        check=True,
        env={"OMP_NUM_THREADS": threads, "MPLBACKEND": "agg", "PATH": ""},
    )
    for name in (*FILES, "stage.json"):
        made = (tmp_path / "map" / "fuse" / name).read_bytes()
        assert made == (fused_map / "fuse" / name).read_bytes(), name


def test_depth_beyond_the_range_is_an_error_that_says_so(posed_map: Path, tmp_path: Path) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    config = Config(fuse=FuseConfig(max_range_m=0.01))
    with pytest.raises(MapError, match=r"within 0.01 m.*fuse.max_range_m"):
        fuse.run(MapFolder(tmp_path / "map"), config)
    assert not (tmp_path / "map" / "fuse").exists()


def test_a_keyframe_without_a_pose_is_left_out(posed_map: Path, tmp_path: Path) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    folder = MapFolder(tmp_path / "map")
    result = artifacts.load_optimised(folder)
    poses = result.T_world_camera.copy()
    poses[5] = np.nan
    views = fuse.PosedFrames(folder)
    assert len(views) == 12
    with folder.writing("optimise", {}, folder.inputs_of("odometry", "loops")) as draft:
        artifacts.save_optimised(draft, replace(result, T_world_camera=poses))
    assert [view.frame.index for view in fuse.PosedFrames(folder)] == [0, *range(10, 60, 5)]


def test_what_moves_and_the_blocks_beside_it_are_not_fused(
    posed_map: Path,
    tmp_path: Path,
    altering: Callable[[MapFolder, str], AbstractContextManager[Path]],
) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    folder = MapFolder(tmp_path / "map")
    before = next(iter(fuse.PosedFrames(folder))).frame.depth_m
    height, width = before.shape
    moving = np.zeros((height // 4, width // 4), bool)
    moving[10:20, 10:20] = True
    with altering(folder, "odometry") as draft:
        artifacts.save_keyframe_mask(draft, 0, moving)
    after = next(iter(fuse.PosedFrames(folder))).frame.depth_m
    assert not after[28:92, 40:80].any()
    assert not after[40:80, 28:92].any()
    gone = (before > 0) & (after == 0)
    np.testing.assert_array_equal(after[~gone], before[~gone])
    gone[28:92, 28:92] = False
    assert gone.mean() < LEAST_SHARE  # small things beside it, which may be of it
