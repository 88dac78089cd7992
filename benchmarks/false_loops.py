"""Do wrong loop closures survive the optimisation?

    python benchmarks/false_loops.py MAP CAPTURE [--seeds 5] [--limit 0.02] [--record]

copies a finished map up to its loops, adds as many false ones as a tenth of the accepted, optimises
again and scores. A false loop joins two keyframes drawn at random by the relative pose and the
information of an accepted loop drawn at random: it looks like all others and is wrong by metres.
Then, in place of these, a set of 40 that agree with each other: between two stretches of keyframes,
by one wrong transformation and the noise that their information says, as a room's twin gives them.
Exit code 1 where one of them is kept, or the ATE exceeds the limit.
"""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from recording import Measurement, add_record_option, missed, record, table

from vnav.config import Config, updated
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.mapping import LoopVerdict
from vnav.evaluation.score import score
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import read_truth
from vnav.io.store.artifacts import (
    load_loop_edges,
    load_loops,
    load_odometry,
    load_optimised,
    save_loops,
)
from vnav.io.store.map_folder import MapFolder
from vnav.stages import optimise

NONE, SCATTERED, AGREEING = "no false loops", "false loops", "false loops that agree"
SHARE = 0.1
MAX_DIFFERENCE_S = 0.02  # between a pose and its true one
SOURCE = "injected"
SET_SIZE, STRETCH = 40, 20  # false loops that agree; keyframes at either end of them


def false_loops(
    edges: tuple[Edge, ...], rows: NDArray[np.intp], count: int, rng: np.random.Generator
) -> list[Edge]:
    """Loops between random keyframes (K,) of the frame table that no accepted one joins."""
    joined = {(e.i, e.j) for e in edges}
    found: list[Edge] = []
    while len(found) < count:
        i, j = sorted(rng.choice(rows, 2, replace=False).tolist())
        like = edges[rng.integers(len(edges))]
        if (i, j) not in joined:
            found.append(Edge(i, j, like.T_i_j, like.information))
    return found


def false_set(
    edges: tuple[Edge, ...],
    rows: NDArray[np.intp],
    T_world_camera: NDArray[np.float64],
    rng: np.random.Generator,
) -> list[Edge]:
    """Loops that agree with each other on a wrong place, between two stretches of keyframes (K,).

    ``T_world_camera`` (N, 4, 4): the right poses.
    """
    first, last = (stretch(part, rng) for part in np.split(rows, [len(rows) // 2]))
    T_wrong = se3.make(se3.exp_so3([0, 0, rng.uniform(-np.pi, np.pi)]), rng.uniform(-3, 3, 3))
    found = []
    for i, j in zip(rng.choice(first, SET_SIZE), rng.choice(last, SET_SIZE), strict=True):
        information = edges[rng.integers(len(edges))].information
        noise = se3.exp(rng.multivariate_normal(np.zeros(6), np.linalg.inv(information)))
        T_i_j = se3.inverse(T_world_camera[i]) @ T_wrong @ T_world_camera[j] @ noise
        found.append(Edge(int(i), int(j), T_i_j, information))
    return found


def stretch(rows: NDArray[np.intp], rng: np.random.Generator) -> NDArray[np.intp]:
    """Some neighbouring keyframes."""
    start = rng.integers(max(1, len(rows) - STRETCH))
    return rows[start : start + STRETCH]


def inject(folder: MapFolder, false: Sequence[Edge]) -> None:
    """Replace the loops of a map by the same and false ones."""
    odometry, (edges, matches) = load_odometry(folder), load_loop_edges(folder)
    number = {row: k for k, row in enumerate(odometry.keyframe_rows.tolist())}
    verdicts = [
        LoopVerdict(number[e.i], number[e.j], SOURCE, 1.0, True, "", 100, 80) for e in false
    ]
    settings, inputs = folder.settings("loops"), folder.inputs_of("odometry", "vocabulary")
    verdicts = [*load_loops(folder, "loops"), *verdicts]
    with folder.writing("loops", settings, inputs) as draft:
        save_loops(draft, verdicts, [*edges, *false], matches)


def optimised(folder: MapFolder, capture: Path) -> tuple[float, int]:
    """ATE RMSE in metres after optimising anew, and how many of the false loops are kept."""
    made_with = folder.settings("loops")
    config = updated(Config(), {"seed": made_with["seed"]}, "the map")
    optimise.run(folder, config)
    kept = sum(v.accepted for v in load_loops(folder, "optimise") if v.source == SOURCE)
    found = read_tum(folder.stage("optimise") / "trajectory_0.tum")
    scored = score(found, read_truth(capture, config.capture), MAX_DIFFERENCE_S)
    return scored.ate.translation_m.rmse, kept


def drawn(asked: argparse.Namespace, kind: str, seed: int) -> list[Edge]:
    """The false loops of a kind."""
    folder, rng = MapFolder(asked.map), np.random.default_rng(seed)
    edges, rows = load_loop_edges(folder)[0], load_odometry(folder).keyframe_rows
    if kind == NONE:
        return []
    if kind == SCATTERED:
        return false_loops(edges, rows, round(SHARE * len(edges)), rng)
    return false_set(edges, rows, load_optimised(folder).T_world_camera, rng)


def measure(asked: argparse.Namespace, kind: str, seed: int) -> list[Measurement]:
    """A copy of the map with false loops, optimised and scored."""
    false = drawn(asked, kind, seed)
    with tempfile.TemporaryDirectory() as scratch:
        folder = MapFolder(Path(scratch) / "map")
        ignore = shutil.ignore_patterns("optimise", "fuse", "index", "reports", "state")
        shutil.copytree(asked.map, folder.root, ignore=ignore)
        accepted = len(load_loop_edges(folder)[0])
        inject(folder, false)
        ate_m, kept = optimised(folder, asked.capture)
    name = asked.capture.name
    what = f"{kind}, seed {seed}" if false else kind
    return [
        Measurement(name, what, "accepted loops", accepted),
        Measurement(name, what, "false loops", len(false)),
        Measurement(name, what, "false loops kept", kept, "", "at most 0"),
        Measurement(name, what, "ATE RMSE", ate_m, "m", f"at most {asked.limit:g}"),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("capture", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--limit", type=float, default=0.02, help="ATE in metres")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    runs = [(kind, seed) for kind in (SCATTERED, AGREEING) for seed in range(asked.seeds)]
    found = [m for kind, seed in [(NONE, 0), *runs] for m in measure(asked, kind, seed)]
    worst_m = max(m.value for m in found if m.quantity == "ATE RMSE")
    print(f"{table(found)}\n\nworst ATE {worst_m:.4f} m (limit {asked.limit:g} m)")
    if asked.record:
        record(f"false_loops_{asked.capture.name}", "how robust", found, arguments)
    return int(bool(missed(found)))


if __name__ == "__main__":
    sys.exit(main())
