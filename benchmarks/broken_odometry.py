"""Does a map survive odometry that is wrong in places?

    python benchmarks/broken_odometry.py MAP CAPTURE [--seeds 5] [--edges 1 3 10] [--record]

copies a finished map up to its odometry, shifts a few of the edges by 5 to 30 cm in any direction,
leaves their information as it is, and makes loops and poses anew. A shifted edge is kept where the
optimisation still used it. Exit code 1 where one is, where the map falls apart, or where the ATE of
a part exceeds 1.2 times that of the map as it was.
"""

import argparse
import dataclasses
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from recording import Measurement, add_record_option, conclude

from vnav.config import Config
from vnav.core.frame import Edge
from vnav.core.graph import chain
from vnav.core.mapping import Odometry
from vnav.evaluation.score import score
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import read_truth
from vnav.io.store.artifacts import load_mended_edges, load_odometry, save_odometry
from vnav.io.store.map_folder import MapFolder
from vnav.pipeline.extend import made_with
from vnav.stages import loops, optimise, vocabulary

SHIFT_M = 0.05, 0.30
MAX_DIFFERENCE_S = 0.02  # between a pose and its true one
MAX_RATIO = 1.2  # of ATE, to that of the map as it was
LATER = ("vocabulary", "loops", "optimise", "fuse", "index", "reports", "state")


def broken(odometry: Odometry, count: int, rng: np.random.Generator) -> tuple[Odometry, list[Edge]]:
    """Odometry with some of its edges shifted, its poses by these edges; and those edges."""
    edges = list(odometry.edges)
    drawn = sorted(rng.choice(len(edges), count, replace=False).tolist())
    for n in drawn:
        edges[n] = shifted(edges[n], rng)
    poses, segment = chain(len(odometry.frames), edges, odometry.keyframe_rows.tolist())
    changed = dataclasses.replace(
        odometry, T_segment_camera=poses, segment=segment, edges=tuple(edges)
    )
    return changed, [edges[n] for n in drawn]


def shifted(edge: Edge, rng: np.random.Generator) -> Edge:
    """An edge that is off by a random distance in a random direction, and as sure as before."""
    direction = rng.standard_normal(3)
    T_i_j = edge.T_i_j.copy()
    T_i_j[:3, 3] += rng.uniform(*SHIFT_M) * direction / np.linalg.norm(direction)
    return dataclasses.replace(edge, T_i_j=T_i_j)


def remade(folder: MapFolder, odometry: Odometry, config: Config) -> list[Edge]:
    """Loops and poses from this odometry in place of the map's; the edges that they stand on."""
    made = folder.recorded("odometry")
    with folder.writing("odometry", made["settings"], made["inputs"]) as draft:
        save_odometry(draft, odometry)
        shutil.copytree(folder.root / "odometry" / "keyframes", draft / "keyframes")
    for stage in (vocabulary, loops, optimise):
        stage.run(folder, config)
    return list(load_mended_edges(folder))


def ate_of_parts(folder: MapFolder, capture: Path, config: Config) -> list[float]:
    """ATE RMSE in metres of the map, then of each other part, each aligned by itself."""
    truth = read_truth(capture, config.capture)
    paths = sorted((folder.root / "optimise").glob("part_*/trajectory_0.tum"))
    paths = [folder.root / "optimise" / "trajectory_0.tum", *paths]
    scored = [score(read_tum(path), truth, MAX_DIFFERENCE_S) for path in paths]
    return [found.ate.translation_m.rmse for found in scored]


def measure(asked: argparse.Namespace, count: int, seed: int) -> list[Measurement]:
    """A copy of the map with broken edges, made anew and scored beside the map as it was."""
    config = made_with(MapFolder(asked.map))
    (before_m,) = ate_of_parts(MapFolder(asked.map), asked.capture, config)
    with tempfile.TemporaryDirectory() as scratch:
        folder = MapFolder(Path(scratch) / "map")
        shutil.copytree(asked.map, folder.root, ignore=shutil.ignore_patterns(*LATER))
        odometry, wrong = broken(load_odometry(folder), count, np.random.default_rng(seed))
        edges = remade(folder, odometry, config)
        ate_m = ate_of_parts(folder, asked.capture, config)
        posed = len(read_tum(folder.root / "optimise" / "trajectory_0.tum").stamps_s)
    kept = sum(same(e, other) for e in wrong for other in edges)
    on, what = asked.capture.name, f"{count} of odometry's edges broken, seed {seed}"
    return [
        Measurement(on, what, "broken edges kept", kept, "", "at most 0"),
        Measurement(on, what, "parts", len(ate_m), "", "at most 1"),
        Measurement(on, what, "frames without a pose", len(odometry.frames) - posed),
        Measurement(on, what, "ATE RMSE", max(ate_m), "m"),
        Measurement(on, what, "ATE to unbroken", max(ate_m) / before_m, "", f"at most {MAX_RATIO}"),
    ]


def same(a: Edge, b: Edge) -> bool:
    """Whether two edges join the same frames by the same motion."""
    return (a.i, a.j) == (b.i, b.j) and np.array_equal(a.T_i_j, b.T_i_j)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("capture", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--edges", type=int, nargs="+", default=[1, 3, 10])
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    runs = [(count, seed) for count in asked.edges for seed in range(asked.seeds)]
    found = [m for count, seed in runs for m in measure(asked, count, seed)]
    return conclude(f"broken_odometry_{asked.capture.name}", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
