"""A walk by vnav's own odometry: its first floor is never seen, and a box stands beside it."""

import dataclasses
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray
from scipy import ndimage

from vnav.cli.main import cli
from vnav.config import CaptureConfig, Config, FeaturesConfig, PlanConfig
from vnav.core import se3
from vnav.core.frame import Rejected
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.io.formats.grid_files import read_grid
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.artifacts import load_grid, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.planning.planner import Plan
from vnav.reporting.plan_picture import plan_figure
from vnav.stages import fuse, loops, odometry, optimise, vocabulary
from vnav.stages.plan import plan
from vnav.synthetic import MINIATURE, SCENES, write_capture
from vnav.synthetic.furniture import cupboard
from vnav.synthetic.scene import Scene, closed_tour, placed

GOAL = "3.0,0.0"  # seen floor, ahead of where the walk begins
BOX = placed(cupboard(0.3, 0.25, 0.3), 2.9, 2.45, 0)  # 0.25 m high, 0.1 m beside the walk


def _scene(seed: int) -> Scene:
    """Ahead and back, looking ahead: a camera 1.1 m high sees no floor within 1.7 m."""
    room = SCENES["one_room"](seed)
    tour = closed_tour((1.5, 2.0, 0), (2.6, 2.0, 0), (3.6, 2.1, 0), (2.6, 2.2, 0))
    return dataclasses.replace(room, pieces=(*room.pieces, BOX), tour=tour)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("captures") / "walk"
    spec = dataclasses.replace(MINIATURE, scene="walk", frames=24, photos=1, pitch_deg=-8.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SCENES, "walk", _scene)
        write_capture(folder, spec)
    return folder


@pytest.fixture(scope="module")
def folder(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> MapFolder:
    """Its map, and the first frame's pose as the current one."""
    folder = MapFolder.create(tmp_path_factory.mktemp("maps") / "walk")
    config = Config(features=FeaturesConfig(max_features=700))
    odometry.run(folder, open_capture(capture, CaptureConfig()), config)
    for stage in (vocabulary, loops, optimise, fuse):
        stage.run(folder, config)
    first = load_optimised(folder).T_world_camera[0]
    folder.write_current({"T_world_camera": first.tolist()})
    return folder


@pytest.fixture(scope="module")
def true_clearance_m(capture: Path, folder: MapFolder) -> NDArray[np.float64]:
    """How far each cell of the map's grid is from what really stands between 0.10 and 1.40 m.

    Negative inside of it.
    """
    grid, truth = load_grid(folder), read_grid(capture / "truth" / "grid.yaml")
    true = read_tum(capture / "groundtruth.txt").T_world_camera[0]
    T_true_map = true @ se3.inverse(load_optimised(folder).T_world_camera[0])
    xy = grid.centres_of(np.moveaxis(np.indices(grid.cells.shape), 0, -1))
    points = np.concatenate([xy, np.zeros((*xy.shape[:2], 1))], -1)
    cells = truth.cells_at(se3.transform(T_true_map, points.reshape(-1, 3))[:, :2])
    is_occupied = truth.cells == OCCUPIED
    away, inside = (ndimage.distance_transform_edt(part) for part in (~is_occupied, is_occupied))
    away_m = (away - inside) * truth.resolution_m
    row, column = np.clip(cells, 0, np.array(truth.cells.shape) - 1).T
    return np.asarray(away_m[row, column].reshape(grid.cells.shape))


def _run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli, ["plan", *map(str, arguments)], standalone_mode=False, catch_exceptions=False
    )


def _never(_photo: Path) -> Rejected:
    raise AssertionError("no photo is asked about")


def _around(grid: Grid) -> Iterator[tuple[int, int]]:
    """The cells within 0.1 m of the first camera, which stands at the origin."""
    row, column = grid.cells_at((0.0, 0.0)).tolist()
    return ((row + r, column + c) for r in range(-2, 3) for c in range(-2, 3))


def test_where_the_walk_begins_no_floor_was_seen_and_that_is_walked(folder: MapFolder) -> None:
    grid, seen = load_grid(folder), read_grid(folder.root / "fuse" / "grid.yaml")
    assert all(seen.cells[cell] == UNKNOWN for cell in _around(seen))
    assert all(grid.cells[cell] == WALKED for cell in _around(grid))


def test_nothing_stands_where_it_is_walked(
    folder: MapFolder, true_clearance_m: NDArray[np.float64]
) -> None:
    walked = load_grid(folder).cells == WALKED
    assert walked.sum() * 0.05**2 > 0.5  # of 1.7 m that are 0.4 m wide
    assert true_clearance_m[walked].min() >= -0.05  # a cell: both grids are rounded to cells


def test_a_path_from_there_is_found_clear_of_the_box(
    folder: MapFolder, true_clearance_m: NDArray[np.float64]
) -> None:
    answer = plan(folder, "current", GOAL, PlanConfig(), _never)
    assert isinstance(answer.plan, Plan)
    assert answer.plan.start.moved_m == 0
    assert 1.2 < answer.plan.walked_m < answer.plan.length_m - 0.5
    row, column = answer.costs.grid.cells_at(answer.plan.poses[:, :2]).T
    assert set(answer.costs.grid.cells[row, column].tolist()) == {FREE, WALKED}
    assert true_clearance_m[row, column].min() > PlanConfig().robot_radius_m - 0.05  # a cell


def test_no_walked_keeps_to_floor_that_was_seen(folder: MapFolder) -> None:
    ask = "--map", folder.root, "--from", "current", "--to", GOAL
    found, refused = _run(*ask, "--json"), _run(*ask, "--no-walked")
    assert (found.return_value, json.loads(found.stdout)["walked_m"] > 1.2) == (0, True)
    assert refused.return_value == 3
    assert re.search(
        r"^no path: the start \(.*\) lies in unknown space; the nearest cell the robot can be in is"
        r" 1\.\d\d m away, the tolerance is 0\.5 m; there is a way through unknown space",
        refused.stdout,
    )


def test_people_are_told_how_far_the_path_is_walked(folder: MapFolder) -> None:
    said = _run("--map", folder.root, "--from", "current", "--to", GOAL).stdout
    assert " m of it, over floor that no frame shows\n" in said
    seen = _run("--map", folder.root, "--from", "2.6,0", "--to", GOAL).stdout
    assert seen.startswith("path")
    assert "walked" not in seen


@pytest.mark.parametrize("allowed", [True, False])
def test_the_picture_shows_what_is_walked_where_that_is_allowed(
    folder: MapFolder, allowed: bool
) -> None:
    answer = plan(folder, "current", GOAL, PlanConfig(allow_walked=allowed), _never)
    figure = plan_figure(answer)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("walked, not seen" in labels) == allowed
