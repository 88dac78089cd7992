"""What a map holds, also where it is not finished."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vnav.io.store import artifacts
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.overview import UNJOINED, overview


@pytest.fixture
def folder(posed_map: Path, tmp_path: Path) -> MapFolder:
    """A copy that may be changed."""
    shutil.copytree(posed_map, tmp_path / "map")
    return MapFolder(tmp_path / "map")


def states_of(folder: MapFolder) -> dict[str, str]:
    return {name: stage["state"] for name, stage in overview(folder)["stages"].items()}


def test_frames_keyframes_and_loops_are_counted(fused_map: Path) -> None:
    values = overview(MapFolder(fused_map))
    assert (values["frames"], values["tracked"], values["posed"]) == (60, 59, 59)
    assert values["keyframes"] == 12
    assert values["loops"] == {
        "tried": 2,
        "accepted": 1,
        "rejected": 1,
        "reasons": {"too few inliers": 1},
        "neighbours_tried": 0,
        "neighbours_accepted": 0,
    }


def test_a_lost_frame_is_named_with_its_reason(fused_map: Path) -> None:
    lost = overview(MapFolder(fused_map))["lost"]
    assert lost == [{"capture": 0, "first": 7, "last": 7, "reason": "too dark"}]


def test_frames_that_no_loop_joins_are_named(folder: MapFolder) -> None:
    result = artifacts.load_optimised(folder)
    poses = result.T_world_camera.copy()
    poses[50:] = np.nan
    with folder.writing("optimise", {}, folder.inputs_of("odometry", "loops")) as draft:
        artifacts.save_optimised(draft, replace(result, T_world_camera=poses))
        artifacts.save_verdicts(draft, ())
    values = overview(folder)
    assert values["lost"][1:] == [{"capture": 0, "first": 50, "last": 59, "reason": UNJOINED}]
    assert (values["tracked"], values["posed"]) == (59, 49)


def test_a_world_file_with_fewer_values_is_told_by_their_defaults(folder: MapFolder) -> None:
    result = artifacts.load_optimised(folder)
    with folder.writing("optimise", {}, folder.inputs_of("odometry", "loops")) as draft:
        artifacts.save_optimised(draft, result)
        artifacts.save_verdicts(draft, ())
        (draft / "world.json").write_text(
            '{"source": "floor", "floor_points": 9, "floor_rms_m": 0.01}'
        )
    assert overview(folder)["world"]["up_in_images"] == "top"


def test_the_grid_is_measured(fused_map: Path) -> None:
    grid = overview(MapFolder(fused_map))["grid"]
    width, height = grid["size_m"]
    assert sum(grid["area_m2"].values()) == pytest.approx(width * height, abs=0.02)  # 3 x 0.005
    assert 10 < grid["area_m2"]["free"] < 20


def test_stages_are_current_or_missing(fused_map: Path) -> None:
    states = states_of(MapFolder(fused_map))
    assert tuple(states) == STAGES
    assert states["fuse"] == states["optimise"] == "current"
    assert states["index"] == states["vocabulary"] == "missing"


def test_what_was_made_from_an_older_stage_is_stale_and_left_out(folder: MapFolder) -> None:
    with folder.writing("odometry", {"changed": 1}, {}) as draft:
        shutil.copytree(folder.root / "odometry", draft, dirs_exist_ok=True)
    assert states_of(folder)["optimise"] == "stale"
    assert "landmarks" not in overview(folder)


@pytest.mark.parametrize("content", [None, b"something else"])
def test_a_stage_whose_file_is_gone_or_changed_is_damaged_and_left_out(
    folder: MapFolder, content: bytes | None
) -> None:
    landmarks = folder.root / "optimise" / "map.npz"
    landmarks.unlink() if content is None else landmarks.write_bytes(content)
    assert states_of(folder)["optimise"] == "damaged"
    assert "landmarks" not in overview(folder)


def test_an_empty_map_has_no_numbers(tmp_path: Path) -> None:
    values = overview(MapFolder.create(tmp_path / "map"))
    assert set(values) == {"map", "size_mb", "stages", "captures", "current", "quality"}
    assert values["captures"] == []


def test_the_last_located_pose_is_told(folder: MapFolder) -> None:
    folder.write_current({"photo": "a.jpg"})
    assert overview(folder)["current"] == {"photo": "a.jpg"}
