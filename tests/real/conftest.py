"""Maps of the real captures, built once a session, and a table of the figures measured on them."""

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.core import se3
from vnav.io.formats.trajectories import read_tum

ROOT = Path(__file__).parents[2]
CAPTURES = ROOT.parent / "shared" / "captures"
SHORT = 100  # frames of the capture that is built again and again
FIGURES: list[tuple[str, str, str]] = []

Vnav = Callable[..., subprocess.CompletedProcess[str]]


@dataclass(frozen=True)
class Built:
    """A finished map, what building it printed, and how its world stands to the truth's."""

    capture: Path
    map: Path
    printed: str
    T_truth_world: NDArray[np.float64]


@pytest.fixture(scope="session")
def captures() -> Path:
    """The folder of the captures; skips where it is absent."""
    if not CAPTURES.is_dir():
        pytest.skip("needs the captures in ../shared/captures, beside the checkout")
    return CAPTURES


@pytest.fixture(scope="session")
def vnav(tmp_path_factory: pytest.TempPathFactory) -> Vnav:
    """Runs ``vnav`` as a user does; fails where the exit code is none of those expected."""
    cwd = tmp_path_factory.mktemp("cwd")

    def run(
        *arguments: object, expected: tuple[int, ...] = (0,), **environment: str
    ) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "vnav", *map(str, arguments)]
        done = subprocess.run(
            command, cwd=cwd, env=os.environ | environment, text=True, capture_output=True
        )
        assert done.returncode in expected, f"{' '.join(command)}\n{done.stdout}{done.stderr}"
        return done

    return run


@pytest.fixture(scope="session")
def figures() -> Callable[[str, str, str], None]:
    """Notes what was measured, beside what is demanded, for the table at the end."""
    return lambda what, measured, demanded: FIGURES.append((what, measured, demanded))


@pytest.fixture(scope="session")
def house(captures: Path, vnav: Vnav, tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The map of the house."""
    return _built(captures / "house", _shared(tmp_path_factory) / "house", vnav)


@pytest.fixture(scope="session")
def redkitchen(captures: Path, vnav: Vnav, tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The map of the kitchen."""
    return _built(captures / "redkitchen01", _shared(tmp_path_factory) / "kitchen", vnav)


@pytest.fixture(scope="session")
def desk(captures: Path, vnav: Vnav, tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The map of the desk."""
    return _built(captures / "fr1_desk", _shared(tmp_path_factory) / "desk", vnav)


@pytest.fixture(scope="session")
def part_of(
    captures: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str, int, int | None], Path]:
    """Some frames of a capture, from the first to before the last, as one of their own; linked."""

    def part(name: str, first: int, last: int | None) -> Path:
        folder = tmp_path_factory.mktemp("captures") / f"{name}_{first}"
        folder.mkdir()
        for images in ("rgb", "depth"):
            head, *lines = (captures / name / f"{images}.txt").read_text().splitlines()
            (folder / f"{images}.txt").write_text("\n".join([head, *lines[first:last]]) + "\n")
            (folder / images).symlink_to(captures / name / images)
        shutil.copy(captures / name / "camera.toml", folder)
        return folder

    return part


@pytest.fixture(scope="session")
def short_capture(part_of: Callable[[str, int, int | None], Path]) -> Path:
    """The house's first frames as a capture of their own."""
    return part_of("house", 0, SHORT)


@pytest.fixture(scope="session")
def short_build(
    short_capture: Path, vnav: Vnav, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, str], float]:
    """The bytes of the short capture's map, and the seconds its build took."""
    folder, started = tmp_path_factory.mktemp("maps") / "short", time.monotonic()
    vnav("build-map", short_capture, "--map", folder)
    return content(folder), time.monotonic() - started


@pytest.fixture(scope="session")
def content_of() -> Callable[[Path], dict[str, str]]:
    """What must be the same in maps that are the same."""
    return content


def content(folder: Path) -> dict[str, str]:
    """A hash of every file of a map outside reports/ and state/."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    names = {path.relative_to(folder).as_posix(): path for path in files}
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in names.items()
        if name.split("/")[0] not in {"reports", "state"}
    }


def _shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all workers of a run have."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def _built(capture: Path, folder: Path, vnav: Vnav) -> Built:
    """The map in the folder; one worker makes it, and others wait."""
    told = folder.with_suffix(".txt")
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not told.exists():
            told.write_text(_build(capture, folder, vnav))
    return Built(capture, folder, told.read_text(), _alignment(folder, capture / "groundtruth.txt"))


def _build(capture: Path, folder: Path, vnav: Vnav) -> str:
    """What the build prints; its time and memory are noted."""
    started = time.monotonic()
    printed = vnav("build-map", capture, "--map", folder).stdout
    seconds = time.monotonic() - started
    report = json.loads((folder / "reports" / "map.json").read_text())
    memory = f"{report['values']['peak_memory_mb']} MB"
    FIGURES.append((f"{capture.name}: build-map", f"{seconds:.0f} s, {memory}", ""))
    return printed


def _alignment(folder: Path, truth: Path) -> NDArray[np.float64]:
    """T_truth_world (4, 4) that brings the map's camera positions nearest to the truth's."""
    found, true = read_tum(folder / "optimise" / "trajectory_0.tum"), read_tum(truth)
    nearest = np.abs(true.stamps_s[:, None] - found.stamps_s).argmin(0)
    return se3.align(true.T_world_camera[nearest, :3, 3], found.T_world_camera[:, :3, 3])


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A worker's figures go to the one that prints the table."""
    if (output := getattr(session.config, "workeroutput", None)) is not None:
        output["figures"] = FIGURES


def pytest_testnodedown(node: Any) -> None:
    """A worker has ended."""
    FIGURES.extend(map(tuple, getattr(node, "workeroutput", {}).get("figures", [])))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """The figures as a table for docs/results.md."""
    if not FIGURES:
        return
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, text=True, capture_output=True
    ).stdout.strip()
    load = " ".join(f"{value:.1f}" for value in os.getloadavg())
    terminalreporter.section("figures")
    terminalreporter.line(f"commit {commit}, {os.cpu_count()} cores, load {load}\n")
    for row in [("what", "measured", "demanded"), ("---", "---", "---"), *FIGURES]:
        terminalreporter.line("| " + " | ".join(row) + " |")
