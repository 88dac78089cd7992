import csv
import dataclasses
import json
import shutil
import subprocess
import sys
from itertools import permutations
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result
from matplotlib.text import Annotation
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from vnav.api.map import open_map
from vnav.cli.main import cli
from vnav.config import PlanConfig
from vnav.core import se3
from vnav.core.frame import Features, Rejected
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.core.mapping import FrameFeatures, FrameTable, Landmarks, Odometry, OptimisedMap, World
from vnav.core.places import GOAL, KEEP_OUT, ONE_WAY
from vnav.errors import MapError, StaleArtifact, VnavError
from vnav.features.sift import SPACE
from vnav.io.store.artifacts import load_grid, save_grid, save_odometry, save_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.places_file import add_place
from vnav.io.store.records import MappedCapture
from vnav.planning.costmap import Costmap, costmap
from vnav.planning.planner import Plan
from vnav.reporting.plan_picture import plan_figure, write_picture
from vnav.reporting.plan_text import summary, write_csv
from vnav.stages.plan import FloorPose, PlanAnswer, map_uncertainty_m, plan

CONFIG = PlanConfig()
ROS = get_typestore(Stores.ROS2_HUMBLE)
LEVEL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)  # looks along x


def _optimised(sigma_m: float, position_sigma_m: float) -> OptimisedMap:
    """One keyframe and three landmarks, as sure of where they are as said."""
    covariance = np.diag([1e-6] * 3 + [position_sigma_m**2] * 3)[None]
    none = np.zeros(0, np.int32)
    landmarks = Landmarks(np.zeros((3, 3)), np.full(3, sigma_m), none, none, none)
    return OptimisedMap(
        np.eye(4)[None], covariance, landmarks, World("floor", 100, 0.01), np.zeros(1)
    )


def _odometry() -> Odometry:
    """One frame, a keyframe without features."""
    none = Features(np.zeros((0, 2)), SPACE.none(), *np.zeros((3, 0)), SPACE)
    keyframe = FrameFeatures(0, none, np.zeros((0, 3), np.float32))
    first = np.zeros(1, np.int32)
    return Odometry(
        FrameTable(first, first, np.zeros(1)), np.eye(4)[None], first, ("",), (), (keyframe,)
    )


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map whose grid shows two rooms of 4 m x 5 m, joined by a door of 1 m."""
    cells = np.full((100, 165), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[:, 80:84] = OCCUPIED
    cells[40:60, 80:84] = FREE
    folder = MapFolder.create(tmp_path_factory.mktemp("maps") / "rooms")
    camera = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5}
    folder.set_captures([MappedCapture(id=0, name="one", fingerprint="f", camera=camera)])
    with folder.writing("odometry", {}, {}) as draft:
        save_odometry(draft, _odometry())
    with folder.writing("optimise", {}, {}) as draft:
        save_optimised(draft, _optimised(0.003, 0.004))
    with folder.writing("fuse", {}, folder.inputs_of("optimise")) as draft:
        save_grid(draft, Grid((-1.0, -2.0), 0.05, cells))
    folder.write_current({"T_world_camera": _camera_at(0.5, 0.5, yaw_deg=90).tolist()})
    return folder.root


def _camera_at(x: float, y: float, yaw_deg: float) -> NDArray[np.float64]:
    return se3.make(se3.exp_so3([0, 0, np.deg2rad(yaw_deg)]) @ LEVEL, [x, y, 1.2])


def _blind(photo: Path) -> Rejected:
    return Rejected("too few matches")


def _ask(folder: Path, start: str, goal: str) -> PlanAnswer:
    return plan(MapFolder.open(folder), start, goal, CONFIG, _blind)


def _run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli, ["plan", *map(str, arguments)], standalone_mode=False, catch_exceptions=False
    )


def test_a_path_joins_two_points_through_the_door(rooms: Path) -> None:
    answer = _ask(rooms, "0,2", "6, -1.5")
    assert isinstance(answer.plan, Plan)
    at_door = np.abs(answer.plan.poses[:, 0] - 3.1).argmin()
    assert 0.2 < answer.plan.poses[at_door, 1] < 0.8
    assert answer.plan.length_m < 1.1 * (np.hypot(3.1, 1.4) + np.hypot(2.9, 2.1))


def test_current_is_where_the_last_photo_was_located_and_stays_so(rooms: Path) -> None:
    before = (rooms / "state" / "current.json").read_bytes()
    answer = plan(
        MapFolder.open(rooms), "current", "goal.jpg", CONFIG, lambda _: _camera_at(2, 2, -30)
    )
    assert answer.as_dict()["start"]["asked"] == [0.5, 0.5]
    assert (rooms / "state" / "current.json").read_bytes() == before


def test_a_path_is_the_maps_last_one_only_when_it_is_to_be_remembered(rooms: Path) -> None:
    folder, mapped = MapFolder(rooms), open_map(rooms)
    mapped.plan((0.0, 0.0), (1.0, 0.0))
    assert folder.planned() is None
    found = mapped.plan((0.0, 0.0), (1.0, 0.0), remember=True).found
    planned = folder.planned()
    assert found is not None
    assert planned is not None
    np.testing.assert_array_equal(planned["path_m"], found.poses)
    mapped.plan((0.0, 0.0), (90.0, 90.0), remember=True)  # there is none
    assert folder.planned() == planned


def test_a_path_that_cannot_be_remembered_is_told(
    rooms: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: MapFolder, path: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(MapFolder, "write_planned", refuse)
    answer = open_map(rooms).plan((0.0, 0.0), (1.0, 0.0), remember=True)
    assert answer.found is not None
    assert answer.warnings == (f"the path could not be remembered in {rooms}: Permission denied",)


def test_the_last_yaw_is_where_the_goals_photo_looks(rooms: Path) -> None:
    asked: list[Path] = []

    def locate(photo: Path) -> NDArray[np.float64]:
        asked.append(photo)
        return _camera_at(2, 2, yaw_deg=-30)

    answer = plan(MapFolder.open(rooms), "0,0", "goal.jpg", CONFIG, locate)
    assert isinstance(answer.plan, Plan)
    assert answer.plan.poses[-1] == pytest.approx([2, 2, np.deg2rad(-30)])
    assert asked == [Path("goal.jpg")]


@pytest.mark.parametrize(("start", "goal"), [("a.jpg", "1,1"), ("1,1", "a.jpg")])
def test_a_photo_that_is_not_located_gives_no_path_but_the_reason(
    rooms: Path, start: str, goal: str
) -> None:
    values = _ask(rooms, start, goal).as_dict()
    assert not values["found"]
    assert values["reason"] == "the photo a.jpg was not located: too few matches"
    assert values["path_m"] == []
    assert None in (values["start"]["asked"], values["goal"]["asked"])


@pytest.mark.parametrize(("climbed_m", "where"), [(2.7, "3.9 m above"), (-2.7, "1.5 m below")])
def test_a_photo_of_another_storey_gives_no_path_but_says_so(
    rooms: Path, climbed_m: float, where: str
) -> None:
    elsewhere = _camera_at(2, 2, 0)
    elsewhere[2, 3] += climbed_m
    answer = plan(MapFolder.open(rooms), "0,0", "goal.jpg", CONFIG, lambda _: elsewhere)
    assert answer.found is None
    assert answer.reason.startswith(f"the photo goal.jpg was taken on another storey, {where} the")
    assert "--set fuse.floor_m=" in answer.reason


def test_a_photo_of_the_storey_that_the_grid_is_of_gives_a_path(
    rooms: Path, tmp_path: Path
) -> None:
    shutil.copytree(rooms, tmp_path / "upstairs")
    folder = MapFolder.open(tmp_path / "upstairs")
    grid, settings = load_grid(folder), {"fuse": {"floor_m": 2.7}}
    with folder.writing("fuse", settings, folder.inputs_of("optimise")) as draft:
        save_grid(draft, grid)
    elsewhere = _camera_at(2, 2, 0)
    elsewhere[2, 3] += 2.7
    assert plan(folder, "0,0", "goal.jpg", CONFIG, lambda _: elsewhere).found is not None


def test_without_a_located_photo_current_is_an_error_that_says_what_to_do(tmp_path: Path) -> None:
    folder = MapFolder.create(tmp_path / "map")
    with pytest.raises(StaleArtifact, match="vnav fuse"):
        plan(folder, "current", "1,1", CONFIG, _blind)
    with folder.writing("odometry", {}, {}) as draft:
        save_odometry(draft, _odometry())
    with folder.writing("optimise", {}, {}) as draft:
        save_optimised(draft, _optimised(0.01, 0.01))
    with folder.writing("fuse", {}, {}) as draft:
        save_grid(draft, Grid((0, 0), 0.05, np.full((40, 40), FREE, np.uint8)))
    with pytest.raises(MapError, match="run 'vnav locate PHOTO"):
        plan(folder, "current", "1,1", CONFIG, _blind)
    for crafted in (None, 1, [[1, 0, 0, 0]], [["x"] * 4] * 4):
        folder.write_current({"T_world_camera": crafted})
        with pytest.raises(MapError, match="run 'vnav locate PHOTO"):
            plan(folder, "current", "1,1", CONFIG, _blind)


def test_the_maps_uncertainty_is_inflated_up_to_a_limit() -> None:
    assert map_uncertainty_m(_optimised(0.03, 0.04)) == pytest.approx(0.05, rel=1e-6)
    assert map_uncertainty_m(_optimised(np.nan, np.nan)) == 0.0


def test_a_map_that_is_less_sure_keeps_farther_off(rooms: Path, tmp_path: Path) -> None:
    sure = _ask(rooms, "0,0", "-0.73,0")
    assert sure.costs.uncertainty_m == pytest.approx(0.005, rel=1e-6)
    folder = MapFolder.create(tmp_path / "map")
    with folder.writing("odometry", {}, {}) as draft:
        save_odometry(draft, _odometry())
    with folder.writing("optimise", {}, {}) as draft:
        save_optimised(draft, _optimised(1.0, 1.0))
    with folder.writing("fuse", {}, {}) as draft:
        for name in ("grid.pgm", "grid.yaml", "walked.pgm", "walked.yaml"):
            (draft / name).write_bytes((rooms / "fuse" / name).read_bytes())
    unsure = _ask(folder.root, "0,0", "-0.73,0")
    assert unsure.costs.uncertainty_m == CONFIG.max_uncertainty_m
    assert isinstance(sure.plan, Plan)
    assert isinstance(unsure.plan, Plan)
    # 0.22 m from the wall: far enough for 0.205 m, not for 0.25 m
    assert (sure.plan.goal.moved_m, unsure.plan.goal.moved_m > 0) == (0, True)


def test_json_has_the_documented_fields(rooms: Path) -> None:
    result = _run("--map", rooms, "--from", "-0.5,-1.5", "--to", "current", "--json")
    values = json.loads(result.stdout)
    assert list(values) == [
        *("found", "reason", "path_m", "length_m", "clearance_min_m", "walked_m"),
        *("start", "goal", "via", "expanded", "narrowest", "seconds"),
    ]
    assert values["found"] is True
    assert values["reason"] is None
    assert values["start"] == {"asked": [-0.5, -1.5], "snapped": [-0.5, -1.5], "moved_m": 0.0}
    assert values["path_m"][0][:2] == [-0.5, -1.5]
    assert values["path_m"][-1] == pytest.approx([0.5, 0.5, np.pi / 2])
    assert values["length_m"] >= np.hypot(1, 2)
    assert values["clearance_min_m"] >= CONFIG.robot_radius_m
    assert set(values["seconds"]) == {"load", "locate", "plan"}


def test_no_path_is_exit_code_3_and_a_path_is_0(rooms: Path) -> None:
    no = _run("--map", rooms, "--from", "0,0", "--to", "9,9")
    assert no.return_value == 3
    assert no.stdout.startswith("no path: the goal (9.00, 9.00) lies outside the grid")
    wide = _run("--map", rooms, "--from", "0,0", "--to", "5,0", "--robot-radius", "0.6", "--json")
    assert wide.return_value == 3
    assert json.loads(wide.stdout)["reason"].startswith("start and goal lie in separate regions")
    assert _run("--map", rooms, "--from", "0,0", "--to", "5,0").return_value == 0


def test_the_summary_says_how_far_an_end_was_moved(rooms: Path) -> None:
    lines = summary(_ask(rooms, "0,0", "3.04,2.04"), "0,0", "3.04,2.04")
    # The wall's first cells have their centres at x = 3.025; 0.2 m, 0.005 m of uncertainty and
    # half a diagonal from there, the nearest centre is at x = 2.775 and y = 2.025.
    assert lines[-1] == "goal       (3.04, 2.04), moved 0.27 m to (2.78, 2.03)  3.04,2.04"


def test_tolerance_says_how_far_an_end_may_be_moved(rooms: Path) -> None:
    ask = ("--map", rooms, "--from", "0,0", "--to", "3.05,2.0", "--tolerance")
    assert _run(*ask, "0.1").return_value == 3
    assert _run(*ask, "0.6").return_value == 0


def test_the_csv_holds_the_path(rooms: Path, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    _run("--map", rooms, "--from", "0,0", "--to", "6,0", "--csv", path)
    answer = _ask(rooms, "0,0", "6,0")
    assert isinstance(answer.plan, Plan)
    with path.open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["x", "y", "yaw"]
    np.testing.assert_allclose(np.array(rows[1:], float), answer.plan.poses, atol=5e-7)


def test_the_yaml_is_a_ros_path_of_the_same_poses(rooms: Path, tmp_path: Path) -> None:
    path = tmp_path / "path.yaml"
    _run("--map", rooms, "--from", "0,0", "--to", "6,0", "--yaml", path)
    answer = _ask(rooms, "0,0", "6,0")
    assert isinstance(answer.plan, Plan)
    message = _message("nav_msgs/msg/Path", yaml.safe_load(path.read_text("utf-8")))
    ROS.serialize_cdr(message, "nav_msgs/msg/Path")  # which holds every field against its type
    found = [each.pose for each in message.poses]
    assert {each.header.frame_id for each in message.poses} == {message.header.frame_id} == {"map"}
    turned = [[q.x, q.y, q.z, q.w] for q in (pose.orientation for pose in found)]
    yaw_rad = Rotation.from_quat(turned).as_euler("ZYX")[:, 0]
    points = np.column_stack([[(p.position.x, p.position.y) for p in found], yaw_rad])
    np.testing.assert_allclose(points, answer.plan.poses, atol=1e-6)  # six digits


def _message(kind: str, values: dict[str, Any]) -> Any:
    """A ROS message of these fields, and no others, by ROS' own definitions."""
    made = {}
    for name, (node, detail) in ROS.fielddefs[kind][1]:
        value = values.pop(name)
        if node == Nodetype.NAME:
            value = _message(detail, value)
        elif node == Nodetype.SEQUENCE:
            value = [_message(detail[0][1], each) for each in value]
        made[name] = value
    assert not values
    return ROS.types[kind](**made)


@pytest.mark.parametrize("goal", ["6,0", "9,9"])
def test_the_picture_is_drawn_with_and_without_a_path(
    rooms: Path, tmp_path: Path, goal: str
) -> None:
    path = tmp_path / "path.png"
    _run("--map", rooms, "--from", "0,0", "--to", goal, "--png", path)
    image = cv2.imread(str(path))
    assert min(image.shape[:2]) > 400


def test_the_picture_shows_path_ends_and_legend(rooms: Path) -> None:
    answer = _ask(rooms, "0,0", "3.05,2.0")
    figure = plan_figure(answer)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert isinstance(answer.plan, Plan)
    wanted = ["occupied", "unknown", "too near an obstacle"]
    ends = "start", "goal", "as asked, then moved"
    assert labels == [*wanted, f"path, {answer.plan.length_m:.2f} m", *ends]
    drawn = [line.get_xydata() for line in figure.axes[0].lines]
    assert any(np.array_equal(line, answer.plan.poses[:, :2]) for line in drawn)
    for end in (answer.plan.start, answer.plan.goal):
        assert any(np.array_equal(line, [end.asked]) for line in drawn)
        assert any(np.allclose(line, [end.snapped]) for line in drawn)


def test_the_start_looks_where_its_photo_looked(rooms: Path) -> None:
    """And the path leaves it another way."""
    answer = _ask(rooms, "0,0", "6,0")
    assert isinstance(answer.plan, Plan)
    start = FloorPose(answer.plan.start.asked, 2.0)
    turned = dataclasses.replace(answer, places=(start, answer.places[1]))
    texts = plan_figure(turned).axes[0].texts
    arrow = next(text for text in texts if isinstance(text, Annotation))
    x, y = np.subtract(arrow.xy, arrow.xyann)
    assert np.arctan2(y, x) == pytest.approx(2.0)
    assert abs(answer.plan.poses[0, 2]) < 1.0


def test_without_a_path_the_legend_shows_places_as_they_are_drawn(rooms: Path) -> None:
    answer = _ask(rooms, "0,0", "40,0")
    assert not isinstance(answer.plan, Plan)
    (legend,) = plan_figure(answer).legends
    entries = dict(
        zip([t.get_text() for t in legend.get_texts()], legend.legend_handles, strict=True)
    )
    assert entries["start"].get_markerfacecolor() == "none"


def test_the_legend_has_no_moved_place_where_none_was_moved(rooms: Path) -> None:
    figure = plan_figure(_ask(rooms, "0,0", "6,0"))
    assert "as asked, then moved" not in {t.get_text() for t in figure.legends[0].get_texts()}


def test_a_file_that_cannot_be_written_is_an_error(rooms: Path, tmp_path: Path) -> None:
    answer = _ask(rooms, "0,0", "6,0")
    assert isinstance(answer.plan, Plan)
    with pytest.raises(VnavError, match="name another file with --csv"):
        write_csv(tmp_path / "missing" / "path.csv", answer.plan)
    with pytest.raises(VnavError, match="name another file with --png"):
        write_picture(tmp_path / "missing" / "path.png", answer)


@pytest.fixture
def named(rooms: Path, tmp_path: Path) -> Path:
    """The rooms with a goal in the second one, and floor to keep out of before a wall of it."""
    folder = MapFolder(shutil.copytree(rooms, tmp_path / "map"))
    add_place(folder, "desk", GOAL, np.array([[6.0, 0.0]]), np.pi / 2)
    add_place(folder, "flowers", KEEP_OUT, np.array([[4.0, 2.0], [5.0, 2.0], [5.0, 2.8]]))
    return folder.root


def test_a_goal_s_name_is_where_it_lies_and_how_a_robot_stands_there(named: Path) -> None:
    found = _ask(named, "0,0", "desk").found
    assert found is not None
    assert found.poses[-1] == pytest.approx([6, 0, np.pi / 2])


def test_a_file_comes_before_a_name(named: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(named.parent)
    Path("desk").write_text("a photo")
    assert "the photo desk was not located" in _ask(named, "0,0", "desk").reason


@pytest.mark.parametrize("name", ["table", "flowers"])
def test_a_name_that_is_no_goal_s_is_an_error_that_lists_the_goals(named: Path, name: str) -> None:
    with pytest.raises(MapError, match=f"found '{name}'; it has 'desk';"):
        _ask(named, "0,0", name)


@pytest.mark.parametrize("name", ["desk", "1", "1,2,3"])
def test_where_a_map_has_no_goals_a_name_is_not_taken_for_a_photo(rooms: Path, name: str) -> None:
    with pytest.raises(MapError, match=f"expected X,Y, .* found '{name}'; it has none;"):
        _ask(rooms, "0,0", name)


def test_where_a_map_has_no_goals_a_file_that_is_missing_is_a_photo(rooms: Path) -> None:
    assert "the photo missing.jpg was not located" in _ask(rooms, "0,0", "missing.jpg").reason


def test_a_path_keeps_the_robot_off_what_it_is_to_keep_out_of(named: Path, rooms: Path) -> None:
    ends = "3.6,2.5", "5.5,2.5"
    free, bound = _ask(rooms, *ends).found, _ask(named, *ends).found
    assert free is not None
    assert bound is not None
    below_m = 2.0 - bound.poses[np.abs(bound.poses[:, 0] - 4.5).argmin(), 1]
    assert free.poses[:, 1].min() > 2.0
    # as from an obstacle: the radius, the map's uncertainty, a cell's half diagonal and rounding
    assert below_m > CONFIG.robot_radius_m - 0.05


def test_a_keep_out_that_bars_the_way_is_named(named: Path) -> None:
    add_place(MapFolder(named), "door", KEEP_OUT, np.array([[3.0, 0], [3.2, 0], [3.2, 1], [3, 1]]))
    answer = _ask(named, "0,0", "desk")
    assert answer.reason.endswith("; the keep-out 'door' is in the way")


def test_the_picture_has_the_keep_outs_and_the_places_on_the_way(named: Path) -> None:
    answer = plan(MapFolder(named), "0,0", "desk", CONFIG, _blind, via=["5,-1"])
    axes = plan_figure(answer).axes[0]
    flowers = answer.costs.zones.keep_out["flowers"]
    assert any(np.array_equal(p.get_xy()[:3], flowers) for p in axes.patches)
    assert "flowers" in {text.get_text() for text in axes.texts}
    labels = [text.get_text() for text in plan_figure(answer).legends[0].get_texts()]
    assert {"to keep out of", "via"} <= set(labels)


def test_a_one_way_is_not_driven_against_and_drawn_with_arrows(named: Path) -> None:
    gate = np.array([[2.9, -0.1], [3.3, -0.1], [3.3, 1.1], [2.9, 1.1]])
    add_place(MapFolder(named), "gate", ONE_WAY, gate, np.pi)
    refused, back = _ask(named, "0,0", "desk"), _ask(named, "desk", "0,0")
    assert refused.reason.endswith("; the one-way 'gate' is in the way")
    assert back.found is not None
    axes = plan_figure(back).axes[0]
    assert any(np.array_equal(p.get_xy()[:4], gate) for p in axes.patches)
    arrows = [text for text in axes.texts if getattr(text, "arrow_patch", None)]
    ways = [np.subtract(arrow.xy, arrow.get_position()) for arrow in arrows]
    assert any(np.allclose(way[1], 0) and way[0] < 0 for way in ways)
    labels = [text.get_text() for text in plan_figure(back).legends[0].get_texts()]
    assert "one way, as the arrows" in labels


def test_the_narrowest_place_is_told_and_drawn(rooms: Path) -> None:
    ask = ("--map", rooms, "--from", "0,0", "--to", "5,0", "--robot-radius", "0.6")
    values = json.loads(_run(*ask, "--json").stdout)
    place = values["narrowest"]
    assert place["width_m"] == pytest.approx(1.0)
    # 1.2 m, twice the map's 5 mm, and a cell's diagonal
    assert place["needed_m"] == pytest.approx(1.21 + 0.05 * np.sqrt(2))
    assert 3.0 < place["at"][0] < 3.2
    wide = dataclasses.replace(CONFIG, robot_radius_m=0.6)
    figure = plan_figure(plan(MapFolder.open(rooms), "0,0", "5,0", wide, _blind))
    drawn = [line.get_xydata() for line in figure.axes[0].lines]
    assert any(np.allclose(np.sort(line[:, 1]), [0.0, 1.0]) for line in drawn if len(line) == 2)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "narrowest place, 1.00 m" in labels


def test_a_footprint_is_taken_in_place_of_a_radius_and_drawn(rooms: Path) -> None:
    ask = ("--map", rooms, "--from", "0,0", "--to", "5,0")
    long = "0.6,0.3 -0.6,0.3 -0.6,-0.3 0.6,-0.3"
    assert _run(*ask, "--footprint", long).return_value == 0
    assert _run(*ask, "--set", f"plan.footprint={long}").return_value == 0
    assert _run(*ask, "--footprint", "0.6,0.6 -0.6,0.6 -0.6,-0.6 0.6,-0.6").return_value == 3
    # an option comes before a setting
    assert _run(*ask, "--set", f"plan.footprint={long}", "--robot-radius", "0.6").return_value == 3
    with pytest.raises(click.UsageError, match="expected --robot-radius or --footprint"):
        _run(*ask, "--footprint", long, "--robot-radius", "0.2")
    with pytest.raises(VnavError, match=r"expected plan\.footprint to be three corners"):
        _run(*ask, "--footprint", "0,0 1,1")
    config = dataclasses.replace(CONFIG, footprint=long)
    figure = plan_figure(plan(MapFolder.open(rooms), "0,0", "5,0", config, _blind))
    assert len([p for p in figure.axes[0].patches if len(p.get_xy()) == 5]) >= 5  # each metre


def test_what_a_path_is_planned_on_is_made_once(
    named: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = list[Costmap]()

    def counted(*arguments: Any) -> Costmap:
        made.append(costmap(*arguments))
        return made[-1]

    for module in ("vnav.stages.plan", "vnav.planning.costmap", "vnav.planning.remedy"):
        monkeypatch.setattr(f"{module}.costmap", counted)
    ask = ("--map", named, "--from", "0,0", "--to", "desk", "--visit", "1,1", "--visit", "5,1")
    assert _run(*ask, "--png", tmp_path / "path.png").return_value == 0
    assert len(made) == 1


def test_via_is_passed_in_turn_and_told(named: Path) -> None:
    ask = ("--map", named, "--from", "0,0", "--to", "desk", "--via", "6,-1.5", "--via", "5,1")
    values = json.loads(_run(*ask, "--json").stdout)
    assert [each["snapped"] for each in values["via"]] == [[6.0, -1.5], [5.0, 1.0]]
    passed = [np.hypot(*(np.array(values["path_m"])[:, :2] - at).T) for at in ([6, -1.5], [5, 1])]
    first, second = (int(away_m.argmin()) for away_m in passed)
    assert max(away_m.min() for away_m in passed) < 1e-6
    assert 0 < first < second < len(values["path_m"]) - 1
    assert [line.split()[0] for line in _run(*ask).output.splitlines()][-3:] == [
        *("via", "via", "goal"),
    ]


def test_visits_are_made_in_the_cheapest_order(named: Path) -> None:
    visits = [word for at in ("5,1", "1,1", "4,-1.5") for word in ("--visit", at)]
    ask = ("--map", named, "--from", "0,0", "--to", "desk", *visits)
    values = json.loads(_run(*ask, "--json").stdout)
    # the first room's, then down through the door; the desk is next to the last one
    assert [each["asked"] for each in values["via"]] == [[1.0, 1.0], [4.0, -1.5], [5.0, 1.0]]
    told = [line.split()[-1] for line in _run(*ask).stdout.splitlines() if line[:3] == "via"]
    assert told == ["1,1", "4,-1.5", "5,1"]
    orders = [
        plan(MapFolder(named), "0,0", "desk", CONFIG, _blind, via=order).found
        for order in permutations(["5,1", "1,1", "4,-1.5"])
    ]
    assert values["length_m"] == min(found.length_m for found in orders if found)


def test_visits_and_via_exclude_each_other(named: Path) -> None:
    with pytest.raises(click.UsageError, match="found both"):
        _run("--map", named, "--from", "0,0", "--to", "desk", "--via", "1,1", "--visit", "2,1")


def test_more_visits_than_can_be_ordered_are_refused(named: Path) -> None:
    places = ["1,1"] * 11
    with pytest.raises(VnavError, match="expected 10 places to visit at most, found 11"):
        plan(MapFolder(named), "0,0", "desk", CONFIG, _blind, via=places, any_order=True)


def test_a_leg_without_a_way_is_told(named: Path) -> None:
    answer = plan(MapFolder(named), "0,0", "desk", CONFIG, _blind, via=["9,9"])
    assert answer.reason.startswith("on leg 1 of 2, the goal (9.00, 9.00) lies outside the grid")


def test_planning_loads_no_library_it_does_not_need(rooms: Path) -> None:
    code = (
        "import sys; from vnav.cli.main import cli;"
        f" cli(['plan', '--map', {str(rooms)!r}, '--from', '0,0', '--to', '6,0'],"
        " standalone_mode=False);"
        " heavy = {'open3d', 'sklearn', 'gtsam', 'octomap', 'matplotlib', 'scipy.ndimage'};"
        " print(sorted(heavy & sys.modules.keys()))"
    )
    shown = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, check=True)
    assert shown.stdout.decode().splitlines()[-1] == "[]"
