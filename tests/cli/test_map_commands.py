"""info, report and export as a user calls them."""

import json
import shutil
import sys
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from vnav.cli.main import cli
from vnav.errors import MapError, StaleArtifact
from vnav.io.formats.ply import read_cloud, read_mesh
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.records import MappedCapture

pytestmark = pytest.mark.slow

CAMERA = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5}


def run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False
    )


def test_info_tells_what_a_map_holds(fused_map: Path) -> None:
    lines = run("info", fused_map).output.splitlines()
    assert any(line.split() == ["capture", "0:", "miniature,", "320", "x", "240"] for line in lines)
    assert any("59 of 60 tracked, 12 keyframes" in line for line in lines)
    assert any("frames 7 to 7 of capture 0: too dark" in line for line in lines)
    assert any(line.split()[:3] == ["stage", "index", "missing"] for line in lines)


def test_info_as_json_is_one_object(fused_map: Path) -> None:
    values = json.loads(run("info", fused_map, "--json").output)
    assert values["stages"]["fuse"]["state"] == "current"


def test_info_of_a_map_whose_capture_has_a_hostile_name_commands_no_terminal(
    tmp_path: Path,
) -> None:
    name = "a\x1b]0;owned\x07\x9b2J"
    capture = MappedCapture(id=0, name=name, fingerprint="", camera=CAMERA)
    MapFolder.create(tmp_path / "map").set_captures([capture])
    said = run("info", tmp_path / "map").output
    assert "a\\x1b]0;owned\\x07\\x9b2J" in said
    assert not {"\x1b", "\x07", "\x9b"} & set(said)


def test_info_of_an_empty_map_is_no_error(tmp_path: Path) -> None:
    MapFolder.create(tmp_path / "map")
    assert "missing" in run("info", tmp_path / "map").output


def test_info_tells_which_photo_was_located_last(tmp_path: Path) -> None:
    T_world_camera = [[1.0, 0, 0, 1.0], [0, 1.0, 0, -2.5], [0, 0, 1.0, 1.4], [0, 0, 0, 1.0]]
    current = {"photo": "a.jpg", "T_world_camera": T_world_camera, "intrinsics": CAMERA}
    MapFolder.create(tmp_path / "map").write_current(current)
    lines = run("info", tmp_path / "map").output.splitlines()
    assert "located     a.jpg: at 1.000 -2.500 1.400 m" in lines


@pytest.mark.parametrize("command", ["info", "report", "export"])
def test_the_map_is_an_argument_an_option_or_the_usual_one(
    command: str, fused_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = shutil.copytree(fused_map, tmp_path / "map")
    options = ("--cloud", "ply") if command == "export" else ()
    monkeypatch.chdir(tmp_path)
    said = [run(command, *place, *options).output for place in ([root], ["--map", root], [])]
    monkeypatch.setenv("VNAV_MAP", str(root))
    monkeypatch.chdir("/")
    out = ("--out", tmp_path) if command == "export" else ()
    said.append(run(command, *options, *out).output)
    assert [len(lines.splitlines()) for lines in said] == 4 * [len(said[0].splitlines())]
    with pytest.raises(click.UsageError, match="as MAP or with --map, found both"):
        run(command, root, "--map", root, *options)


def test_several_formats_of_one_part_are_all_exported(fused_map: Path, tmp_path: Path) -> None:
    run("export", fused_map, "--octomap", "bt", "--octomap", "ot", "--out", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"occupancy.bt", "occupancy.ot"}


@pytest.mark.parametrize("command", ["info", "report", "export", "view"])
def test_a_folder_without_a_map_is_an_error(command: str, tmp_path: Path) -> None:
    options = ("--cloud", "ply") if command == "export" else ()
    with pytest.raises(MapError, match="found no map.json"):
        run(command, tmp_path, *options)


def test_report_prints_where_the_page_is(fused_map: Path, tmp_path: Path) -> None:
    shutil.copytree(fused_map, tmp_path / "map")
    path = Path(run("report", tmp_path / "map").output.strip())
    assert path == tmp_path / "map" / "reports" / "report.html"
    assert path.stat().st_size > 10_000


def test_export_writes_several_parts_at_once_and_says_what(fused_map: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    options = "--trajectory tum --cloud ply --octomap bt --grid pgm --mesh ply --graph g2o"
    result = run("export", fused_map, *options.split(), "--out", out)
    names = {
        *("trajectory_0.tum", "cloud.ply", "occupancy.bt", "grid.pgm", "grid.yaml"),
        *("walked.pgm", "walked.yaml", "mesh.ply", "graph.g2o"),
    }
    assert {p.name for p in out.iterdir()} == names
    assert all(str(out / name) in result.output for name in names)
    assert len(read_cloud(out / "cloud.ply")) > 1000
    assert cv2.imread(str(out / "grid.pgm"), cv2.IMREAD_GRAYSCALE) is not None


def test_all_is_every_part_in_every_format(fused_map: Path, tmp_path: Path) -> None:
    result = run("export", fused_map, "--all", "--out", tmp_path)
    names = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    for suffix in ("tum", "kitti", "ply", "las", "bt", "ot", "pgm", "obj", "glb", "g2o"):
        assert any(name.endswith(f".{suffix}") for name in names), suffix
    assert {"sparse/0/cameras.txt", "transforms.json", "images/000000.jpg"} <= names
    assert f"colmap      {tmp_path / 'images'} (" in result.output


def test_all_leaves_out_what_needs_a_package_that_is_missing(
    fused_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("laspy", "rerun"):
        monkeypatch.setitem(sys.modules, package, None)
    result = run("export", fused_map, "--all", "--out", tmp_path)
    left_out = [line for line in result.stderr.splitlines() if "left out" in line]
    assert [("[export]" in line, "[rerun]" in line) for line in left_out] == [
        (True, False),
        (False, True),
    ]
    assert not {"cloud.las", "map.rrd"} & {path.name for path in tmp_path.iterdir()}
    assert {"cloud.ply", "transforms.json"} <= {path.name for path in tmp_path.iterdir()}


def test_a_kitti_trajectory_has_the_same_poses_and_times_beside_it(
    fused_map: Path, tmp_path: Path
) -> None:
    run("export", fused_map, "--trajectory", "kitti", "--out", tmp_path)
    truth = read_tum(fused_map / "optimise" / "trajectory_0.tum")
    poses = np.loadtxt(tmp_path / "trajectory_0.kitti").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses, truth.T_world_camera[:, :3], atol=1e-9)  # 12 digits
    times = np.loadtxt(tmp_path / "trajectory_0.times")
    np.testing.assert_allclose(times, truth.stamps_s, rtol=0, atol=1e-9)


def test_an_obj_has_every_vertex_and_triangle(fused_map: Path, tmp_path: Path) -> None:
    run("export", fused_map, "--mesh", "obj", "--out", tmp_path)
    mesh = read_mesh(fused_map / "fuse" / "mesh.ply")
    lines = (tmp_path / "mesh.obj").read_text("ascii").splitlines()
    kinds = [line.split()[0] for line in lines]
    assert kinds.count("v") == kinds.count("vn") == len(mesh.vertices_world)
    assert kinds.count("f") == len(mesh.triangles)


def test_a_missing_stage_names_the_command_and_writes_nothing(
    posed_map: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with pytest.raises(StaleArtifact, match="vnav fuse"):
        run("export", posed_map, "--trajectory", "tum", "--cloud", "ply", "--out", out)
    assert not out.exists()


def test_export_into_the_map_is_refused(fused_map: Path) -> None:
    with pytest.raises(MapError, match="outside the map"):
        run("export", fused_map, "--cloud", "ply", "--out", fused_map / "fuse")


def test_export_where_nothing_can_be_written_is_an_error(fused_map: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "utf-8")
    with pytest.raises(MapError, match="--out"):
        run("export", fused_map, "--cloud", "ply", "--out", tmp_path / "file")


def test_export_of_nothing_is_a_usage_error(fused_map: Path) -> None:
    result = CliRunner().invoke(cli, ["export", str(fused_map)])
    assert result.exit_code == 2
    assert "--trajectory" in result.output
