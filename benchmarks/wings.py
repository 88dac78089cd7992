"""Recordings of a building, one of each room, joined into one map; a map of each beside it.

    python benchmarks/wings.py OUT [--frames 1000] [--rooms 10] [--cluster] [--record]

renders the recordings in OUT, by three different cameras in turn, where they are not there; builds
a map of each alone, then one map of all with `vnav build-map A B C ...`, each in a process of its
own, one after the other; and asks the joined map for two photos of each recording. ``--cluster``
builds the joined map again on a Dask cluster of two local workers of one core. Exit code 1 where
something wanted is missed. Ten recordings of 1000 frames take an hour and a half.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from accuracy import NOT_LOCATED, errors, photos_found, vnav
from photo_cases import command
from recording import Measurement, add_record_option, conclude

from vnav.core.camera import Intrinsics
from vnav.core.trajectory import Trajectory
from vnav.evaluation.score import Score, score
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.map_folder import STAGES
from vnav.synthetic import CaptureSpec, write_capture
from vnav.synthetic.rendered_capture import PHONE

FOCAL_PX = 525.0, 570.0, 610.0  # of the cameras
RATE_HZ = 30.0
PHOTOS = 2  # of each recording
APART_S = 1e5  # from the clock of one recording to that of the next
MOST_OFF_S = 0.001  # from a frame to its true pose
WANTED_GROWTH, WANTED_MB, WANTED_ATE_M, WANTED_ON_CLUSTER = 1.15, 3000, 0.02, 1.1


@dataclass(frozen=True)
class Cost:
    """Of a command: wall time, and the most memory that one of its processes took."""

    wall_s: float
    peak_mb: float


def recordings(out: Path, rooms: int, frames: int) -> list[Path]:
    """One capture of each room, rendered where it is not there."""
    found = []
    for k in range(rooms):
        folder, focal_px = out / "captures" / f"room_{k}", FOCAL_PX[k % len(FOCAL_PX)]
        camera = Intrinsics(640, 480, focal_px, focal_px, 319.5, 239.5)
        scene = f"building_10_wing_{k}"
        spec = CaptureSpec(scene, frames, PHOTOS, camera, PHONE, rate_hz=RATE_HZ, seed=0)
        if not folder.is_dir():
            write_capture(folder, spec)
        found.append(folder)
    return found


def built(folder: Path, *arguments: object) -> Cost:
    """What it costs to build a map from nothing; CalledProcessError where that fails."""
    asked = command("build-map", *arguments, "--map", folder, "--fresh")
    started = time.perf_counter()
    with subprocess.Popen(asked, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, asked)
    cost = Cost(time.perf_counter() - started, usage.ru_maxrss / 1024)
    print(f"{folder.name}: {cost.wall_s:.0f} s, {cost.peak_mb:.0f} MB", flush=True)
    return cost


def scored(folder: Path, captures: Sequence[Path]) -> Score:
    """All trajectories of a map against the truth, in one world."""
    found, true = list[Trajectory](), list[Trajectory]()
    for k, capture in enumerate(captures):
        file = folder / "optimise" / f"trajectory_{k}.tum"
        if file.is_file():
            found.append(read_tum(file))
            true.append(read_tum(capture / "groundtruth.txt"))
    return score(_behind_each_other(found), _behind_each_other(true), MOST_OFF_S)


def _behind_each_other(parts: Sequence[Trajectory]) -> Trajectory:
    """Trajectories, each by a clock of its own, as one."""
    stamps_s = [part.stamps_s + k * APART_S for k, part in enumerate(parts)]
    poses = [part.T_world_camera for part in parts]
    return Trajectory(np.concatenate(stamps_s), np.concatenate(poses))


def alone(out: Path, captures: Sequence[Path]) -> Iterator[tuple[Cost, Measurement]]:
    """The map of each capture by itself: what it costs, and how exact it is."""
    for capture in captures:
        folder = out / "maps" / capture.name
        cost = built(folder, capture)
        ate_m = scored(folder, [capture]).ate.translation_m.rmse
        yield cost, Measurement(capture.name, "a map of its own", "ATE RMSE", ate_m, "m")


def joined(folder: Path, captures: Sequence[Path], frames: int) -> list[Measurement]:
    """How exact the map of all is, and which photos it finds."""
    on, what, found = folder.name, "one map of all", scored(folder, captures)
    ate_m, wanted = found.ate.translation_m.rmse, f"at most {WANTED_ATE_M:g}"
    asked, off = 0, list[np.ndarray]()
    for photos in (capture / "photos" for capture in captures):
        answers = vnav("locate", photos, "--map", folder, expected=(0, NOT_LOCATED))
        off.append(errors(answers, photos, found.ate.T_truth_world))
        asked += len(answers)
    right, *others = photos_found(on, asked, np.concatenate(off))[2:]
    return [
        Measurement(on, what, "frames with a pose", found.poses, wanted=f"at least {frames}"),
        Measurement(on, what, "ATE RMSE", ate_m, "m", wanted),
        replace(right, wanted=f"at least {asked}"),
        *others,
    ]


def on_cluster(folder: Path, like: Path, captures: Sequence[Path]) -> tuple[Cost, int]:
    """What the map of all costs on two local workers; how many files differ from the other's."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        cost = built(folder, *captures, "--scheduler", cluster.scheduler_address)
    return cost, len(differing(like, folder))


def differing(one: Path, other: Path) -> list[Path]:
    """Files of the stages, relative to the maps, that are not the same in both."""
    files = {f.relative_to(m) for m in (one, other) for s in STAGES for f in _files(m / s)}
    return [f for f in sorted(files) if _bytes(one / f) != _bytes(other / f)]


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def _bytes(file: Path) -> bytes | None:
    return file.read_bytes() if file.is_file() else None


def measure(out: Path, rooms: int, frames: int, cluster: bool) -> Iterator[Measurement]:
    """All figures."""
    captures, folder = recordings(out, rooms, frames), out / "maps" / f"{rooms} recordings"
    costs, found = zip(*alone(out, captures), strict=True)
    yield from found
    cost, sum_s = built(folder, *captures), sum(each.wall_s for each in costs)
    on, what = folder.name, "one map of all"
    yield Measurement(on, "the maps of one", "wall time", sum_s, "s")
    yield Measurement(on, what, "wall time", cost.wall_s, "s")
    limit = f"at most {WANTED_GROWTH:g}"
    growth = cost.wall_s / sum_s
    yield Measurement(on, what, "wall time, ratio", growth, "", limit, "the maps of one")
    largest_mb = max(each.peak_mb for each in costs)
    yield Measurement(on, "the maps of one", "peak memory", largest_mb, "MB")
    yield Measurement(on, what, "peak memory", cost.peak_mb, "MB", f"at most {WANTED_MB}")
    yield from joined(folder, captures, rooms * frames)
    if cluster:
        there, differ = on_cluster(out / "maps" / "on a cluster", folder, captures)
        on, what, limit = folder.name, "on two workers", f"at most {WANTED_ON_CLUSTER:g}"
        ratio = there.wall_s / cost.wall_s
        yield Measurement(on, what, "wall time, ratio", ratio, "", limit, "one map of all")
        yield Measurement(on, what, "files that differ", differ, wanted="at most 0")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--frames", type=int, default=1000, help="of each recording")
    parser.add_argument("--rooms", type=int, default=10, help="of ten, that are recorded")
    parser.add_argument("--cluster", action="store_true", help="once more, on a Dask cluster")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    found = list(measure(asked.out, asked.rooms, asked.frames, asked.cluster))
    return conclude("wings", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
