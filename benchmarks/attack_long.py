"""Are maps the same whatever befalls those who write them?

    python benchmarks/attack_long.py [CAPTURE] [--moments 100] [--seed 0] [--record]

maps the first 60 frames of a capture (the house's, or a rendered room's), extends the map by 30
others, and maps both as one. Then it does so again, and kills each command at random moments; lets
files become no longer than so many bytes; fills a small disk (as root); starts two writers at once.
After each the same command runs undisturbed. Exit code 1 where the map has other bytes then, or
where something else than one line was told.
"""

import argparse
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from attacks import shell
from attacks.attempt import Attempt, Disturbance, Result, unclean
from attacks.ground import digests
from recording import ROOT, Measurement, add_record_option, conclude

from vnav.io.store.map_folder import STAGES
from vnav.synthetic import MINIATURE, cached_capture

HOUSE = ROOT.parent / "shared" / "captures" / "house"
FIRST, NEXT = 60, 30  # frames
SECONDS = 3600.0
SIZES = 2.5, 6.5  # decimal exponents of the bytes that files may have
DISKS_KB = 64, 512, 2048, 4096, 8192
CALM = Disturbance()
Digests = dict[str, str]


@dataclass(frozen=True)
class Job:
    """A command that writes a map: what it begins with, how long it takes, what it gives."""

    name: str
    command: tuple[str, ...]
    begins: Path | None
    seconds: float
    gives: Digests


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("capture", nargs="?", type=Path, help="a TUM folder")
    parser.add_argument("--moments", type=int, default=100, help="of kills, over all commands")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="attack-") as temporary:
        root = Path(temporary)
        capture = asked.capture or (HOUSE if HOUSE.is_dir() else cached_capture(MINIATURE, root))
        sliced(capture, root / "first", 0, FIRST)
        sliced(capture, root / "next", FIRST * 2 // 3, FIRST * 2 // 3 + NEXT)
        rng = np.random.default_rng(asked.seed)
        found = Trials(root, asked.jobs).all_of(jobs_on(root), rng, asked.moments)
        on = f"{capture.name}, first {FIRST} frames"
        measured = [
            Measurement(
                on, what, quantity, number, "", "at most 0" if quantity == "faults" else None
            )
            for what, faults in found.items()
            for quantity, number in (("cases", len(faults)), ("faults", sum(map(bool, faults))))
        ]
        return conclude("attack_long", measured, asked, arguments)


def sliced(capture: Path, folder: Path, begin: int, end: int) -> None:
    """Some frames of a TUM capture, which stay where they are."""
    folder.mkdir()
    for kind in ("rgb", "depth"):
        (folder / kind).symlink_to(capture.resolve() / kind)
        lines = (capture / f"{kind}.txt").read_text("utf-8").splitlines()
        rows = [line for line in lines if not line.startswith("#")][begin:end]
        (folder / f"{kind}.txt").write_text("\n".join([*rows, ""]), "utf-8")
    shutil.copy(capture / "camera.toml", folder)


def jobs_on(root: Path) -> list[Job]:
    """Building a map, extending it, and building one of both captures, undisturbed."""
    first, following = str(root / "first"), str(root / "next")
    building = ("build-map", first, "--map", "map")
    together = ("build-map", first, following, "--map", "map")
    return [
        measured_job("build-map", building, None, root),
        measured_job("extend", ("extend", "map", following), root / "build-map" / "map", root),
        measured_job("build-map of two captures", together, None, root),
    ]


def measured_job(name: str, command: tuple[str, ...], begins: Path | None, root: Path) -> Job:
    folder = laid_out(root / name, begins)
    begun = time.monotonic()
    result = shell.run(command, folder, SECONDS)
    if result.code != 0:
        raise SystemExit(f"{name} fails undisturbed: {result.err}")
    return Job(name, command, begins, time.monotonic() - begun, bytes_of(folder))


def laid_out(folder: Path, begins: Path | None) -> Path:
    """A folder to work in, with the map that a command begins with."""
    folder.mkdir()
    if begins is not None:
        shutil.copytree(begins, folder / "map")
    return folder


def bytes_of(folder: Path) -> Digests:
    """Hashes of all that must be the same."""
    return digests(folder / "map", (*STAGES,))


class Trials:
    """Disturbs jobs and runs them again; what was wrong with each, "" for nothing."""

    def __init__(self, root: Path, jobs: int) -> None:
        self._root, self._jobs = root, jobs

    def all_of(
        self, jobs: Sequence[Job], rng: np.random.Generator, moments: int
    ) -> dict[str, list[str]]:
        """Faults of each kind of trial."""
        found = {}
        for job in jobs:
            kills = [
                Disturbance(signal_s=float(s), signal=signal.SIGKILL)
                for s in rng.uniform(0, job.seconds, moments // len(jobs))
            ]
            sizes = (int(10**e) for e in rng.uniform(*SIZES, moments // 10))
            limits = [Disturbance(limits={resource.RLIMIT_FSIZE: size}) for size in sizes]
            found[f"SIGKILL in {job.name}"] = self._each(job, kills)
            found[f"files of limited size in {job.name}"] = self._each(job, limits)
        building = jobs[0]
        filled = (self._on_small_disk(building, kilobytes) for kilobytes in DISKS_KB)
        found["a full disk in build-map"] = [wrong for wrong in filled if wrong is not None]
        waits = rng.uniform(0.5, building.seconds * 0.8, max(1, moments // 20))
        found["two writers at once"] = [self._two_writers(building, float(s)) for s in waits]
        return found

    def _each(self, job: Job, suffered: Sequence[Disturbance]) -> list[str]:
        with ThreadPoolExecutor(self._jobs) as pool:
            return list(pool.map(lambda one: self._told(job, one), suffered))

    def _told(self, job: Job, suffered: Disturbance) -> str:
        folder = Path(tempfile.mkdtemp(prefix=f"{job.name}-", dir=self._root))
        folder.rmdir()
        wrong = disturbed(job, laid_out(folder, job.begins), suffered)
        shutil.rmtree(folder)
        print(f"{job.name}, {suffered}: {wrong or 'right'}", file=sys.stderr, flush=True)
        return wrong

    def _on_small_disk(self, job: Job, kilobytes: int) -> str | None:
        """None where there is no small disk."""
        with small_disk(self._root / "disk", kilobytes) as grow:
            if grow is None:
                return None
            result = shell.run(job.command, self._root / "disk", SECONDS)
            wrong = unclean(Attempt("", job.command), result)
            grow()
            return wrong or again(job, self._root / "disk")

    def _two_writers(self, job: Job, seconds: float) -> str:
        """One works, the other is told who does."""
        folder = laid_out(Path(tempfile.mkdtemp(dir=self._root)) / "x", job.begins)
        with ThreadPoolExecutor(1) as pool:
            first = pool.submit(shell.run, job.command, folder, SECONDS)
            time.sleep(seconds)
            second = shell.run(job.command, folder, SECONDS)
            return two_writers_wrong(job, first.result(), second, folder)


def disturbed(job: Job, folder: Path, suffered: Disturbance) -> str:
    """What is wrong with a job that was disturbed, and then run again."""
    result = shell.run(job.command, folder, SECONDS, suffered)
    if suffered.signal_s is None:
        wrong = unclean(Attempt("", job.command, disturbance=suffered), result)
        if wrong:
            return wrong
    if job.begins is not None:
        asked = shell.run(("info", "map", "--json"), folder, SECONDS)
        if asked.code != 0:
            return f"no map is left: {asked.err.strip()}"
    return again(job, folder)


def again(job: Job, folder: Path) -> str:
    """What is wrong after the same command, where it had not done its work before."""
    if bytes_of(folder) == job.gives:
        return ""
    result = shell.run(job.command, folder, SECONDS)
    if result.code != 0:
        return f"fails when run again: {result.err.strip()[-300:]}"
    others = {k for k, v in bytes_of(folder).items() ^ job.gives.items()}
    leftovers = {p.name for p in (folder, folder / "map") for p in p.glob(".*")}
    if others or leftovers:
        return f"other bytes: {sorted(others)[:3]}; leftovers: {sorted(leftovers)[:3]}"
    return ""


def two_writers_wrong(job: Job, first: Result, second: Result, folder: Path) -> str:
    if sorted([first.code, second.code]) not in ([0, 1], [0, 0]):
        return f"exit {first.code} and {second.code}: {first.err[-200:]} {second.err[-200:]}"
    if bytes_of(folder) != job.gives:
        return "other bytes"
    if second.code == 1 and "only one who writes the map" not in second.err:
        return f"the second says {second.err[-200:]}"
    return ""


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[Callable[[], None] | None]:
    """A disk of its own, and what makes it large; None where it cannot be had."""
    folder.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)]
    if os.getuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode:
        print("no small disk can be had here: left out", file=sys.stderr)
        yield None
        return
    try:
        grow = ["mount", "-o", "remount,size=4g", str(folder)]
        yield lambda: subprocess.run(grow, check=True) and None
    finally:
        subprocess.run(["umount", str(folder)], check=True)


if __name__ == "__main__":
    sys.exit(main())
