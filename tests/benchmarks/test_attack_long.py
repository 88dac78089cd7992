"""A disturbed writer of maps is run again, and other bytes are seen."""

import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture(scope="module")
def long(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("attack_long")


@pytest.fixture
def job(long: ModuleType, whole_map: Path, tmp_path: Path) -> Any:
    """A stage that is up to date: quick, and it gives what is there."""
    shutil.copytree(whole_map, tmp_path / "begins" / "map")
    gives = long.bytes_of(tmp_path / "begins")
    return long.Job("index", ("index", "--map", "map"), tmp_path / "begins" / "map", 1.0, gives)


def test_what_is_the_same_after_a_kill_is_right(long: ModuleType, job: Any, tmp_path: Path) -> None:
    folder = long.laid_out(tmp_path / "x", job.begins)
    killed = long.Disturbance(signal_s=0.3, signal=signal.SIGKILL)
    assert long.disturbed(job, folder, killed) == ""


def test_other_bytes_and_leftovers_are_seen(long: ModuleType, job: Any, tmp_path: Path) -> None:
    folder = long.laid_out(tmp_path / "x", job.begins)
    other = long.Job("index", job.command, job.begins, 1.0, job.gives | {"fuse/grid.pgm": "0"})
    assert long.again(other, folder).startswith("other bytes: ['fuse/grid.pgm']")
    (folder / "map" / ".left").touch()
    assert "leftovers: ['.left']" in long.again(other, folder)


def test_a_map_that_is_gone_after_a_kill_is_seen(
    long: ModuleType, job: Any, tmp_path: Path
) -> None:
    folder = long.laid_out(tmp_path / "x", job.begins)
    (folder / "map" / "map.json").unlink()
    killed = long.Disturbance(signal_s=0.0, signal=signal.SIGKILL)
    assert long.disturbed(job, folder, killed).startswith("no map is left")


def test_two_writers_of_whom_none_is_refused_or_both_are_seen(
    long: ModuleType, job: Any, tmp_path: Path
) -> None:
    folder = long.laid_out(tmp_path / "x", job.begins)
    done, told = long.Result(0, "", ""), "vnav: expected to be the only one who writes the map x\n"
    refused = long.Result(1, "", told)
    assert long.two_writers_wrong(job, done, refused, folder) == ""
    assert "exit 1 and 1" in long.two_writers_wrong(job, refused, refused, folder)
    other = long.Result(1, "", "vnav: something else\n")
    assert "the second says" in long.two_writers_wrong(job, done, other, folder)
    (folder / "map" / "index" / "index.npz").unlink()
    assert long.two_writers_wrong(job, done, refused, folder) == "other bytes"
