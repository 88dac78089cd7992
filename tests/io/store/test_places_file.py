"""Places that have a name: kept in the map, moved with the frame that they are tied to."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.places import GOAL, KEEP_OUT, ONE_WAY, LostPlace, NamedPlace
from vnav.errors import MapError
from vnav.io.store.artifacts import load_optimised, save_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.places_file import (
    NAME,
    add_place,
    load_places,
    load_zones,
    remove_place,
)
from vnav.io.store.replacement import replacing

DESK = np.array([[1.5, -0.25]])
STAIRS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])


@pytest.fixture
def place_map(posed_map: Path, tmp_path: Path) -> MapFolder:
    return MapFolder(shutil.copytree(posed_map, tmp_path / "map"))


def _moved(folder: MapFolder, T: np.ndarray, lost: tuple[int, ...] = ()) -> None:
    """The map is optimised anew: its world is another, and some frames have no pose."""
    before = load_optimised(folder)
    poses = T @ before.T_world_camera
    poses[list(lost)] = np.nan
    record = folder.recorded("optimise")
    assert record is not None
    with folder.writing("optimise", record["settings"], record["inputs"]) as draft:
        save_optimised(draft, dataclasses.replace(before, T_world_camera=poses))


def _placed(folder: MapFolder, name: str) -> NamedPlace:
    place = load_places(folder)[name]
    assert isinstance(place, NamedPlace)
    return place


def test_what_is_named_is_found_again_exactly_and_in_order(place_map: MapFolder) -> None:
    add_place(place_map, "stairs", KEEP_OUT, STAIRS)
    add_place(place_map, "desk", GOAL, DESK, 0.1)
    assert list(load_places(place_map)) == ["stairs", "desk"]
    np.testing.assert_array_equal(_placed(place_map, "desk").points_m, DESK)
    assert _placed(place_map, "desk").yaw_rad == 0.1
    np.testing.assert_array_equal(load_zones(place_map).keep_out["stairs"], STAIRS)


def test_a_place_is_tied_to_the_nearest_keyframe(place_map: MapFolder) -> None:
    poses = load_optimised(place_map).T_world_camera
    add_place(place_map, "near", GOAL, poses[35, None, :2, 3] + 0.001)
    anchor = _placed(place_map, "near").anchor
    assert anchor.frame == 35  # every fifth frame is a keyframe
    np.testing.assert_array_equal(anchor.T_world_camera, poses[35])


def test_a_place_moves_with_its_frame(place_map: MapFolder) -> None:
    add_place(place_map, "desk", GOAL, DESK, 0.1)
    add_place(place_map, "stairs", KEEP_OUT, STAIRS)
    add_place(place_map, "aisle", ONE_WAY, STAIRS, 3.0)
    T = se3.make(se3.exp_so3([0, 0, 0.5]), [2.0, -1.0, 0.0])
    _moved(place_map, T)
    turned = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    for name, points_m in (("desk", DESK), ("stairs", STAIRS), ("aisle", STAIRS)):
        wanted = points_m @ turned.T + [2.0, -1.0]
        np.testing.assert_allclose(_placed(place_map, name).points_m, wanted, atol=1e-9)
    assert _placed(place_map, "desk").yaw_rad == pytest.approx(0.6)
    aisle = load_zones(place_map).one_way["aisle"]
    np.testing.assert_allclose(aisle.ahead, [np.cos(3.5), np.sin(3.5)], atol=1e-9)
    assert list(load_zones(place_map).keep_out) == ["stairs"]


@pytest.mark.parametrize("kind", [KEEP_OUT, ONE_WAY])
def test_a_place_whose_frame_is_lost_says_so_and_is_not_guessed(
    place_map: MapFolder, kind: str
) -> None:
    add_place(place_map, "stairs", kind, STAIRS, 0.5 if kind == ONE_WAY else None)
    frame = _placed(place_map, "stairs").anchor.frame
    _moved(place_map, np.eye(4), lost=(frame,))
    place = load_places(place_map)["stairs"]
    assert isinstance(place, LostPlace)
    assert f"frame {frame}" in place.reason
    with pytest.raises(MapError, match=f"the {kind} 'stairs'.* remove stairs' and name it anew"):
        load_zones(place_map)


def test_a_place_of_a_capture_that_is_not_in_the_map_is_lost(place_map: MapFolder) -> None:
    add_place(place_map, "desk", GOAL, DESK)
    captures = [{**each, "fingerprint": "another"} for each in place_map.captures]
    place_map.set_captures(captures)  # type: ignore[arg-type]
    place = load_places(place_map)["desk"]
    assert isinstance(place, LostPlace)
    assert "of a capture that is not in it" in place.reason


def test_a_name_is_taken_once_and_free_again_when_removed(place_map: MapFolder) -> None:
    add_place(place_map, "desk", GOAL, DESK)
    with pytest.raises(MapError, match="expected a new name, found 'desk', a goal"):
        add_place(place_map, "desk", KEEP_OUT, STAIRS)
    remove_place(place_map, "desk")
    assert load_places(place_map) == {}
    with pytest.raises(MapError, match="found 'desk'; it has none"):
        remove_place(place_map, "desk")


@pytest.mark.parametrize(
    "name", ["", " ", "current", "1,2", "-1.5, 2e1", "a\nb", "a\x1b[0m", "x" * 101]
)
def test_a_name_that_cannot_be_is_refused(place_map: MapFolder, name: str) -> None:
    with pytest.raises(MapError, match="expected a name of 1 to 100 printable characters"):
        add_place(place_map, name, GOAL, DESK)


@pytest.mark.parametrize("name", ['a "b"', "back\\slash", "caf\u00e9 \U0001f600", "a.b", "a = 1"])
def test_any_printable_name_is_kept(place_map: MapFolder, name: str) -> None:
    add_place(place_map, name, GOAL, DESK)
    assert list(load_places(place_map)) == [name]


@pytest.mark.parametrize("kind", [KEEP_OUT, ONE_WAY])
def test_two_corners_are_no_polygon(place_map: MapFolder, kind: str) -> None:
    with pytest.raises(MapError, match="expected a polygon of 3 corners"):
        add_place(place_map, "line", kind, STAIRS[:2], 0.5)


def test_a_one_way_without_the_way_that_it_leads_is_refused(place_map: MapFolder) -> None:
    add_place(place_map, "aisle", ONE_WAY, STAIRS, 0.5)
    path = place_map.root / NAME
    path.write_text(path.read_text("utf-8").replace("yaw_rad = 0.5\n", ""), "utf-8")
    with pytest.raises(MapError, match="found: no yaw_rad of the one-way 'aisle'"):
        load_places(place_map)


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("kind = ", 'kind = "wish" # '),
        ("points_m = ", "points_m = [[1.0]] # "),
        ("points_m = ", "points_m = [] # "),
        ("points_m = ", "points_m = [[nan, 0.0]] # "),
        ("T_world_frame = ", "T_world_frame = [[1.0]] # "),
        ("frame = ", "frame = 'x' # "),
        ("frame = ", "other = 1\nframe = "),
        ("[", "[["),
    ],
)
def test_a_file_that_is_spoilt_is_one_line(place_map: MapFolder, wrong: str, right: str) -> None:
    add_place(place_map, "desk", GOAL, DESK)
    path = place_map.root / NAME
    path.write_text(path.read_text("utf-8").replace(wrong, right, 1), "utf-8")
    with pytest.raises(MapError, match=r"expected places as vnav writes them in .*places\.toml"):
        load_places(place_map)


def test_places_go_with_a_map_that_takes_the_place_of_another(place_map: MapFolder) -> None:
    add_place(place_map, "desk", GOAL, DESK)
    text = (place_map.root / NAME).read_text("utf-8")
    with replacing(place_map):
        pass
    assert (place_map.root / NAME).read_text("utf-8") == text


def test_places_survive_a_map_that_is_built_anew(place_map: MapFolder) -> None:
    add_place(place_map, "desk", GOAL, DESK)
    MapFolder.create(place_map.root, fresh=True)
    assert (place_map.root / NAME).is_file()
