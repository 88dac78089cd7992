"""build-map of one capture and of several, as a user calls it."""

import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from vnav.cli.main import cli
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.map_lock import only_writer

pytestmark = pytest.mark.slow

SAME = ("--set", "features.max_features=700")  # as whole_map was made


def run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli,
        ["build-map", *(str(a) for a in arguments)],
        standalone_mode=False,
        catch_exceptions=False,
    )


@pytest.fixture
def maps(tmp_path: Path, whole_map: Path) -> Path:
    """A folder of maps; that of the tiny capture is there, and up to date."""
    shutil.copytree(whole_map, tmp_path / "maps" / "miniature")
    return tmp_path / "maps"


@pytest.mark.parametrize("how", [(), ("--jobs", 2)])
def test_each_capture_gets_its_map_and_a_failed_one_is_named(
    tiny_capture: Path, maps: Path, tmp_path: Path, how: tuple[object, ...]
) -> None:
    (tmp_path / "empty").mkdir()
    result = run(tiny_capture, tmp_path / "empty", "--maps", maps, *SAME, *how)
    assert result.return_value == 1
    assert f"map in {maps / 'miniature'}" in result.stdout
    assert "odometry    60 of 60 frames tracked" in result.stdout
    last = [line for line in result.stderr.splitlines() if line.startswith("vnav: ")]
    assert len(last) == 1
    assert last[0].startswith("vnav: empty: expected a capture in")
    assert MapFolder.open(maps / "miniature").has("index")
    assert not (maps / "empty").exists()


def test_one_capture_gets_the_map_that_is_named(tiny_capture: Path, maps: Path) -> None:
    result = run(tiny_capture, "--map", maps / "miniature", *SAME)
    assert result.return_value == 0
    assert "(up to date)" in result.stdout


def test_a_map_that_somebody_writes_is_left_to_him(tiny_capture: Path, maps: Path) -> None:
    with only_writer(maps / "miniature"):
        result = run(tiny_capture, "--map", maps / "miniature", *SAME)
    assert result.return_value == 1
    assert "expected to be the only one who writes the map" in result.stderr


def test_several_captures_are_one_map_that_tells_of_each(
    tiny_capture: Path, other_capture: Path, tmp_path: Path
) -> None:
    coarse = ("fuse.voxel_m=0.05", "fuse.octree_m=0.1", "fuse.mesh_voxel_m=0.1")
    settings = [*SAME, *(part for s in coarse for part in ("--set", s))]
    place = tmp_path / "building"
    result = run(other_capture, tiny_capture, "--map", place, "--jobs", 2, *settings)
    assert result.return_value == 0
    assert re.search(r"other: 24 of 24 frames, \d+ loops to the others", result.stdout)
    assert re.search(r"miniature: 60 of 60 frames, \d+ loops to the others", result.stdout)
    assert f"map in {place}, pictures in" in result.stdout


def test_several_maps_of_one_name_are_a_usage_error(tmp_path: Path) -> None:
    for name in ("monday", "tuesday"):
        (tmp_path / name / "capture").mkdir(parents=True)
    captures = [str(tmp_path / name / "capture") for name in ("monday", "tuesday")]
    result = CliRunner().invoke(cli, ["build-map", *captures, "--maps", "maps"])
    assert result.exit_code == 2
    assert "found two capture" in result.output


def test_given_poses_of_several_captures_are_a_usage_error(tmp_path: Path) -> None:
    captures = [str(tmp_path / name) for name in ("monday", "tuesday")]
    poses = ("--trajectory", str(tmp_path / "poses.txt"))
    result = CliRunner().invoke(cli, ["build-map", *captures, "--maps", "maps", *poses])
    assert result.exit_code == 2
    assert "one CAPTURE with --trajectory" in result.output


def test_given_poses_of_another_clock_leave_no_map(tiny_capture: Path, tmp_path: Path) -> None:
    poses = tmp_path / "poses.txt"
    poses.write_text("1e6 0 0 0 0 0 0 1\n")
    result = run(tiny_capture, "--map", tmp_path / "map", "--trajectory", poses)
    assert result.return_value == 1
    assert "expected given poses within 0.02 s" in result.stderr
    assert not (tmp_path / "map" / "odometry").exists()
