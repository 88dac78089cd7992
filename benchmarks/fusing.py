"""How long fuse takes, held against raw insertion of the same keyframes into octomap-python.

    python benchmarks/fusing.py [CAPTURE|MAP...] [--record]

Of each capture a map is made first; without any, of those of ../shared/captures, else of a rendered
apartment. Then, several times in turn: `vnav fuse` in a process of its own, by its own report, and
octomap-python's insertPointCloud of all depth in range of the same keyframes, with one ray a voxel
(`discretize`) and with one a pixel. Reading images counts for fuse and not for insertion. Times are
medians over the runs; so are ratios, each of one run. Exit code 1 where something wanted is missed.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import octomap
from numpy.typing import NDArray
from recording import Measurement, add_record_option, missed, record, table
from speed import build, captures

from vnav.config import Config
from vnav.core import se3
from vnav.io.store.map_folder import MapFolder
from vnav.stages.fuse import PosedFrames

RUNS = 3
PEERS = {  # whether points are made one a voxel first, and what is wanted of the ratio
    "insertion, a ray a voxel": (True, "at most 0.8"),
    "insertion, a ray a pixel": (False, None),
}
Times = NDArray[np.float64]  # (2,): wall and CPU, seconds
Tree = octomap.OcTree


def map_of(path: Path, scratch: Path) -> Path:
    """A copy of a map, or a fresh map of a capture."""
    made = scratch / path.name
    if (path / "map.json").is_file():
        shutil.copytree(path, made)
    else:
        build(path, made)
    return made


def inserted(folder: MapFolder, config: Config, *, discretize: bool) -> tuple[Times, Tree]:
    """What insertion of all depth in range of a map's keyframes takes, and the tree of it."""
    tree, took = Tree(config.fuse.octree_m), np.zeros(2)
    for view in PosedFrames(folder):
        depth_m, camera = view.frame.depth_m, view.frame.intrinsics
        v, u = np.nonzero((depth_m > 0) & (depth_m <= config.fuse.max_range_m))
        points = camera.unproject(np.stack([u, v], -1), depth_m[v, u])
        points_world = se3.transform(view.T_world_camera, points)
        started = time.perf_counter(), time.process_time()
        tree.insertPointCloud(points_world, view.T_world_camera[:3, 3], discretize=discretize)
        took += np.subtract((time.perf_counter(), time.process_time()), started)
    return took, tree


def fused(folder: MapFolder) -> Times:
    """What the stage takes in a process of its own, by its report."""
    shutil.rmtree(folder.root / "fuse", ignore_errors=True)
    command = [sys.executable, "-P", "-m", "vnav", "fuse", "--map", folder.root]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    report = json.loads((folder.root / "reports" / "fuse.json").read_text("utf-8"))
    return np.array([report["seconds"], report["cpu_seconds"]])


def measure(folder: MapFolder, runs: int = RUNS) -> list[Measurement]:
    """Times of fuse and of its peers in turn, and their ratios."""
    times: dict[str, list[Times]] = {"fuse": [], **{name: [] for name in PEERS}}
    for _ in range(runs):
        times["fuse"].append(fused(folder))
        for name, (discretize, _) in PEERS.items():
            times[name].append(inserted(folder, Config(), discretize=discretize)[0])
    on, found = f"{folder.root.name}, {len(PosedFrames(folder))} keyframes", []
    for name, (_, wanted) in PEERS.items():
        for what in ("fuse", name):
            wall_s, cpu_s = np.median(times[what], 0).tolist()
            wall, cpu = np.median(np.divide(times[what], times[name]), 0).tolist()
            limit = wanted if what == "fuse" else None
            found += [
                Measurement(on, what, "wall time", wall_s, "s", None, name),
                Measurement(on, what, "wall time, ratio", wall, "", limit, name),
                Measurement(on, what, "CPU time", cpu_s, "s", None, name),
                Measurement(on, what, "CPU time, ratio", cpu, "", None, name),
            ]
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("places", nargs="*", metavar="CAPTURE|MAP")
    add_record_option(parser)
    asked, found = parser.parse_args(arguments), []
    for path in captures(asked.places):
        with tempfile.TemporaryDirectory() as scratch:
            found += measure(MapFolder(map_of(path, Path(scratch))))
    load = " ".join(f"{value:.1f}" for value in os.getloadavg())
    print(f"{os.cpu_count()} cores, load {load}\n\n{table(found)}")
    if asked.record:
        record("fuse_speed", "how fast", found, arguments)
    return int(bool(missed(found)))


if __name__ == "__main__":
    sys.exit(main())
