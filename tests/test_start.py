"""No command imports a heavy library before it needs it."""

import gc
import json
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from vnav.cli.main import cli

HEAVY = {
    *("open3d", "sklearn", "gtsam", "octomap", "matplotlib", "numba", "cv2"),
    *("scipy.linalg", "scipy.ndimage", "scipy.sparse"),
}

PROBE = """
import json, sys
from vnav.cli.main import main
sys.argv = ["vnav", *sys.argv[1:]]
try:
    code = main()
except SystemExit as end:
    code = end.code
json.dump({"code": code or 0, "modules": list(sys.modules)}, sys.stderr)
"""


def loaded(*arguments: object, cwd: Path) -> set[str]:
    """The heavy libraries that a command which succeeds has loaded at its end."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", PROBE, *map(str, arguments)],
        cwd=cwd,
        text=True,
        capture_output=True,
    )
    said = json.loads(done.stderr[done.stderr.rindex('{"code"') :])
    assert said["code"] == 0, done.stdout + done.stderr
    return HEAVY & set(said["modules"])


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["locate", "--help"]])
def test_help_loads_no_heavy_library(arguments: list[str], tmp_path: Path) -> None:
    assert loaded(*arguments, cwd=tmp_path) == set()


def test_locate_loads_numba_and_opencv_alone(whole_map: Path, tiny_capture: Path) -> None:
    """Of scipy nothing but its name, which numba looks for."""
    photo = tiny_capture / "photos" / "000.jpg"
    assert loaded("locate", photo, "--map", whole_map, cwd=whole_map) == {"numba", "cv2"}


def test_plan_loads_neither_open3d_nor_sklearn(whole_map: Path, tiny_capture: Path) -> None:
    photos = tiny_capture / "photos"
    start, goal = photos / "000.jpg", photos / "001.jpg"
    heavy = loaded("plan", "--from", start, "--to", goal, "--map", whole_map, cwd=whole_map)
    assert not heavy & {"open3d", "sklearn", "octomap"}


def test_a_map_that_is_up_to_date_loads_no_open3d(
    whole_map: Path, tiny_capture: Path, tmp_path: Path
) -> None:
    """Which is loaded ahead where a map is made."""
    made = shutil.copytree(whole_map, tmp_path / "map")
    settings = "--set", "features.max_features=700"
    heavy = loaded("build-map", tiny_capture, "--map", made, *settings, cwd=tmp_path)
    assert "open3d" not in heavy


def test_importing_vnav_loads_nothing_but_the_standard_library() -> None:
    code = "import sys; before = set(sys.modules); import vnav; print(*(set(sys.modules) - before))"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], text=True, capture_output=True, check=True
    )
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert loaded - sys.stdlib_module_names == {"vnav"}


def test_locating_a_photo_seeks_no_garbage(whole_map: Path, tiny_capture: Path) -> None:
    """Nor does the end of the process: what is frozen is not looked at."""
    code = (
        "import gc, sys; from vnav.__main__ import run\n"
        "seen = []; gc.callbacks.append(lambda *_: seen.append(1))\n"
        "code = run(); print(code, len(seen), gc.get_freeze_count() > 10_000)"
    )
    photo = tiny_capture / "photos" / "000.jpg"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, "locate", photo, "--map", whole_map],
        cwd=whole_map,
        text=True,
        stdout=subprocess.PIPE,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == "0 0 True"


@pytest.mark.parametrize(("command", "seeks"), [("score", True), ("plan", False)])
def test_commands_that_work_for_long_seek_garbage(command: str, seeks: bool) -> None:
    try:
        gc.disable()
        cli.get_command(click.Context(cli), command)
        assert gc.isenabled() == seeks
    finally:
        gc.enable()
        gc.unfreeze()
