"""extend as a user calls it: a third capture, a refusal, a kill in the middle."""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from vnav.cli.main import cli
from vnav.errors import CaptureError, MapError
from vnav.io.store.map_folder import MapFolder

pytestmark = pytest.mark.slow

HERE, THERE = slice(14, None, 2), slice(1, 9)  # lines of the lists of frames, below their heads


def run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli, list(map(str, arguments)), standalone_mode=False, catch_exceptions=False
    )


def content(root: Path) -> dict[str, bytes]:
    files = (path for path in root.rglob("*") if path.is_file())
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def third(other_capture: Path, elsewhere: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every second frame of the second half of the other capture, then frames of another place."""
    folder = tmp_path_factory.mktemp("captures") / "third"
    folder.mkdir()
    for name in ("rgb", "depth"):
        lines = []
        for source, rows, later_s in ((other_capture, HERE, 0), (elsewhere, THERE, 99)):
            (folder / source.name).mkdir(exist_ok=True)
            (folder / source.name / name).symlink_to(source / name)
            for line in (source / f"{name}.txt").read_text().splitlines()[rows]:
                stamp, file = line.split()
                lines.append(f"{float(stamp) + later_s:.6f} {source.name}/{file}")
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    shutil.copy(other_capture / "camera.toml", folder)
    return folder


def test_a_third_capture_is_kept_as_far_as_it_joins_and_the_rest_is_named(
    extended_map: Path, third: Path, tmp_path: Path
) -> None:
    root = Path(shutil.copytree(extended_map, tmp_path / "map"))
    result = run("extend", root, third)
    assert result.return_value is None
    assert "odometry    98 of 98 frames tracked" in result.stdout
    assert "6 of 14 frames joined to the map by" in result.stdout
    assert "frames 6 to 13 of capture 2 are a part of their own" in result.stdout
    assert f"map in {root}" in result.stdout
    names = {path.name for path in (root / "optimise").glob("*.tum")}
    assert names == {f"trajectory_{k}.tum" for k in range(3)}
    assert (root / "optimise" / "part_2" / "trajectory_2.tum").is_file()
    assert [c["name"] for c in MapFolder.open(root).captures][2] == "third"
    told = run("info", root).stdout
    assert "capture     2: third, 360 x 270" in told
    assert "frames 6 to 13 of capture 2: no loop joins it to the rest of the map" in told
    assert "world       that of the map before it was extended" in told
    assert "(up to date)" in run("optimise", "--map", root).stdout


def test_the_map_is_named_where_there_is_none(other_capture: Path, tmp_path: Path) -> None:
    with pytest.raises(MapError, match="expected a map at .*nowhere.*vnav build-map"):
        run("extend", tmp_path / "nowhere", other_capture)


def test_a_capture_that_is_there_is_refused(extended_map: Path, other_capture: Path) -> None:
    before = content(extended_map)
    with pytest.raises(CaptureError, match="found other, which is its capture 1; give another"):
        run("extend", extended_map, other_capture)
    assert content(extended_map) == before


def test_an_extended_map_is_not_built_again_of_one_of_its_captures(
    extended_map: Path, tiny_capture: Path, other_capture: Path
) -> None:
    for capture in (tiny_capture, other_capture):
        result = run("build-map", capture, "--map", extended_map)
        assert result.return_value == 1
        assert "expected miniature, other, of which the map" in result.stderr
        assert f"add a capture with 'vnav extend {extended_map} CAPTURE'" in result.stderr


def test_a_kill_in_the_middle_leaves_the_map_as_it_was(
    whole_map: Path, other_capture: Path, tmp_path: Path
) -> None:
    root = Path(shutil.copytree(whole_map, tmp_path / "map"))
    draft = tmp_path / ".map.draft"
    command = [sys.executable, "-m", "vnav", "extend", str(root), str(other_capture)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, cwd=tmp_path)
    while process.poll() is None and not (draft / "odometry").is_dir():
        time.sleep(0.01)
    process.kill()
    assert process.wait() < 0
    assert draft.is_dir()  # to go on with
    (root / ".lock").unlink()  # says who wrote last, and holds nobody up
    assert content(root) == content(whole_map)


def test_help_shows_examples() -> None:
    told = CliRunner().invoke(cli, ["extend", "--help"]).output
    assert "vnav extend house kitchen" in told
    assert "Exit code 1" in told
