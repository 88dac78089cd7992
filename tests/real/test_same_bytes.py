"""The same map, byte for byte: after a kill, and whatever the number of threads."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.real

STAGES = ("odometry", "vocabulary", "loops", "optimise", "fuse", "index")


def test_a_build_that_was_killed_goes_on_to_the_same_map(
    short_capture: Path,
    short_build: tuple[dict[str, str], float],
    vnav: Callable[..., Any],
    content_of: Callable[[Path], dict[str, str]],
    figures: Callable[[str, str, str], None],
    tmp_path: Path,
) -> None:
    expected, seconds = short_build
    seed = int(os.environ.get("VNAV_KILL_SEED", "0"))
    moment_s = random.Random(seed).uniform(0.1, 0.9) * seconds
    while (code := _killed(short_capture, tmp_path / "map", moment_s.__lt__)) == 0:
        shutil.rmtree(tmp_path / "map")  # it was done by then: the first had a busier machine
        moment_s /= 2
    assert code == -signal.SIGKILL
    vnav("build-map", short_capture, "--map", tmp_path / "map")
    assert content_of(tmp_path / "map") == expected
    what = f"first house frames, killed after {moment_s:.2f} s (seed {seed})"
    figures(what, "same bytes", "same bytes")


@pytest.mark.parametrize("threads", [1, 2, 8])
def test_the_number_of_threads_does_not_change_the_map(
    threads: int,
    short_capture: Path,
    short_build: tuple[dict[str, str], float],
    vnav: Callable[..., Any],
    content_of: Callable[[Path], dict[str, str]],
    figures: Callable[[str, str, str], None],
    tmp_path: Path,
) -> None:
    vnav("build-map", short_capture, "--map", tmp_path, OMP_NUM_THREADS=str(threads))
    assert content_of(tmp_path) == short_build[0]
    figures(f"first house frames, OMP_NUM_THREADS={threads}", "same bytes", "same bytes")


@pytest.mark.long
@pytest.mark.parametrize("threads", [1, 2, 8])
def test_the_number_of_threads_does_not_change_the_map_of_the_house(
    threads: int,
    house: Any,
    vnav: Callable[..., Any],
    content_of: Callable[[Path], dict[str, str]],
    figures: Callable[[str, str, str], None],
    tmp_path: Path,
) -> None:
    vnav("build-map", house.capture, "--map", tmp_path, OMP_NUM_THREADS=str(threads))
    assert content_of(tmp_path) == content_of(house.map)
    figures(f"house, OMP_NUM_THREADS={threads}", "same bytes", "same bytes")


@pytest.mark.long
@pytest.mark.parametrize("stage", STAGES)
def test_the_house_is_the_same_after_a_kill_in_each_stage(
    stage: str,
    house: Any,
    vnav: Callable[..., Any],
    content_of: Callable[[Path], dict[str, str]],
    figures: Callable[[str, str, str], None],
    tmp_path: Path,
) -> None:
    """Killed at a seeded share of the time that the stage took in the first build."""
    seed = int(os.environ.get("VNAV_KILL_SEED", "0"))
    report = (house.map / "reports" / f"{stage}.json").read_text()
    share = random.Random(f"{seed} {stage}").random()
    moment_s = share * float(json.loads(report)["seconds"])
    begun: list[float] = []

    def is_due(after_s: float) -> bool:
        at_work = stage == "odometry" or (tmp_path / STAGES[STAGES.index(stage) - 1]).is_dir()
        if at_work and not begun:
            begun.append(after_s)
        return bool(begun) and after_s - begun[0] > moment_s

    code = _killed(house.capture, tmp_path, is_due)
    assert code == -signal.SIGKILL
    vnav("build-map", house.capture, "--map", tmp_path)
    assert content_of(tmp_path) == content_of(house.map)
    what = f"house, killed in {stage} after {moment_s:.2f} s (seed {seed})"
    figures(what, "same bytes", "same bytes")


def _killed(capture: Path, folder: Path, is_due: Callable[[float], bool]) -> int:
    """Exit code of a build that is killed when its time has come."""
    command = [sys.executable, "-m", "vnav", "build-map", capture, "--map", folder]
    started = time.monotonic()
    process = subprocess.Popen(command, cwd=folder.parent, stderr=subprocess.DEVNULL)
    while process.poll() is None and not is_due(time.monotonic() - started):
        time.sleep(0.01)
    process.kill()
    return process.wait()
