"""Maps of rendered places that repeat themselves, beside the same walks among unlike things.

    python benchmarks/repeating.py OUT [--scenes library shop] [--seeds 0 1] [--width 320]
        [--peer NAME=DIR]

renders captures to OUT/captures and maps them to OUT/maps by vnav's own odometry, each once: all
frames, at 10 Hz, and every third. It counts frames with a pose, scores the trajectory, holds
odometry's edges and the kept loops against the truth, and locates the photos. A DIR of a peer has
its trajectories of the same captures, as CAPTURE.tum. Exit code 1 where something wanted is missed.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from accuracy import NOT_LOCATED, built, errors, vnav
from hard_versions import Source, clean, every_third
from numpy.typing import NDArray
from people import of_trajectory, peer, rendered
from recording import Measurement, add_record_option, conclude, table

from vnav.core import se3
from vnav.core.frame import Edge
from vnav.evaluation.metrics import WRONG
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.artifacts import (
    load_loop_edges,
    load_loops,
    load_mended_edges,
    load_odometry,
)
from vnav.io.store.map_folder import MapFolder
from vnav.synthetic import SCENES, CaptureSpec
from vnav.synthetic.path import frames_at
from vnav.synthetic.rendered_capture import KINECT, PHONE

SCENE_NAMES = ("library", "supermarket", "shop", "twin_rooms")
STEP_M, UNEVEN = 0.07, 0.43  # 4 to 10 cm a frame
PHOTOS = 20
RATES = {"10 Hz": clean, "every third frame": every_third}
TIMES_ATE, MOST_ATE_M = 1.5, {"10 Hz": 0.010, "every third frame": 0.020}
OFF = (0.03, 1.0)  # metres, degrees: an edge farther from the truth is wrong


def spec_of(scene: str, seed: int, width: int) -> CaptureSpec:
    """A walk of 10 frames a second; with unlike things all but the textures is the same."""
    camera, frames = KINECT.scaled(width, 3 * width // 4), frames_at(STEP_M, SCENES[scene](0).tour)
    return CaptureSpec(scene, frames, PHOTOS, camera, PHONE, seed=seed, uneven=UNEVEN)


def version(folder: Path, source: Path, rate: str) -> Path:
    """The capture with the frames of that rate, written where it is not there."""
    if not folder.is_dir():
        RATES[rate](Source.open(source), folder)
    return folder


def wrong_edges(edges: Iterable[Edge], T_world_frame: NDArray[np.float64]) -> int:
    """How many are off the motion between the true poses (F, 4, 4) of their frames."""
    count = 0
    for edge in edges:
        T_true = se3.inverse(T_world_frame[edge.i]) @ T_world_frame[edge.j]
        off = se3.inverse(T_true) @ edge.T_i_j
        off_deg = np.rad2deg(se3.rotation_angle(off))
        count += bool(np.linalg.norm(off[:3, 3]) > OFF[0] or off_deg > OFF[1])
    return count


def kept_loops(folder: MapFolder, rows: NDArray[np.intp]) -> list[Edge]:
    """The loops that the optimisation did not turn down; ``rows`` (K,) of the keyframes."""
    kept = {(int(rows[v.i]), int(rows[v.j])) for v in load_loops(folder, "optimise") if v.accepted}
    return [edge for edge in load_loop_edges(folder)[0] if (edge.i, edge.j) in kept]


def of_edges(on: str, what: str, capture: Path, map_of: Path) -> list[Measurement]:
    """Edges of odometry, as tracked and as the optimisation kept them, and kept loops."""
    folder = MapFolder.open(map_of)
    odometry = load_odometry(folder)
    loops = kept_loops(folder, np.array([k.row for k in odometry.keyframes]))
    truth = read_tum(capture / "groundtruth.txt")
    stamps_s = odometry.frames.stamp_s
    rows = [int(np.abs(truth.stamps_s - stamp_s).argmin()) for stamp_s in stamps_s]
    T_world_frame = truth.T_world_camera[rows]
    wrong = wrong_edges(odometry.edges, T_world_frame)
    wrong_kept = wrong_edges(load_mended_edges(folder), T_world_frame)
    wrong_loops = wrong_edges(loops, T_world_frame)
    return [
        Measurement(on, what, "odometry's edges", len(odometry.edges)),
        Measurement(on, what, "wrong edges", wrong),
        Measurement(on, what, "wrong edges kept", wrong_kept, wanted="at most 0"),
        Measurement(on, what, "kept loops", len(loops)),
        Measurement(on, what, "wrong loops", wrong_loops, wanted="at most 0"),
    ]


def of_photos(
    on: str, what: str, photos: Path, map_of: Path, T_truth_world: NDArray[np.float64]
) -> list[Measurement]:
    """How many of a folder's photos are located, and how many wrongly."""
    answers = vnav("locate", photos, "--map", map_of, expected=(0, NOT_LOCATED))
    off = errors(answers, photos, T_truth_world)
    wrong = int((off > WRONG).any(1).sum())
    return [
        Measurement(on, what, "photos", len(answers)),
        Measurement(on, what, "photos located", len(off)),
        Measurement(on, what, "photos wrong", wrong, wanted="at most 0"),
    ]


def of_map(on: str, what: str, capture: Path, photos: Path, map_of: Path) -> list[Measurement]:
    """All that is measured of a map, without what is wanted of its ATE."""
    file = map_of / "optimise" / "trajectory_0.tum"
    found, T_truth_world = of_trajectory(on, what, capture, file)
    return [
        *found,
        *of_edges(on, what, capture, map_of),
        *of_photos(on, what, photos, map_of, T_truth_world),
    ]


def ate_m(found: Sequence[Measurement]) -> float:
    """The one ATE among what was found."""
    (value,) = (m.value for m in found if m.quantity == "ATE RMSE")
    return value


def walks(asked: argparse.Namespace, scene: str, seed: int, rate: str) -> Iterator[Measurement]:
    """One walk among unlike things, then among things that repeat."""
    on, limit_m = f"{scene}, {asked.width} px, seed {seed}, {rate}", MOST_ATE_M[rate]
    for things, made in (("unlike things", f"{scene}_unlike"), ("what repeats", scene)):
        source = rendered(
            asked.out / "captures" / f"{made}_seed{seed}", spec_of(made, seed, asked.width)
        )
        name = f"{source.name}_{rate.replace(' ', '_')}"
        capture, map_of = version(asked.out / "captures" / name, source, rate), asked.out / "maps"
        built(capture, map_of / name)
        yield Measurement(on, f"vnav, {things}", "width", asked.width, "px")
        found = of_map(on, f"vnav, {things}", capture, source / "photos", map_of / name)
        if things == "unlike things":
            limit_m = min(limit_m, TIMES_ATE * ate_m(found))
        wanted = f"at most {limit_m:.5f}" if things == "what repeats" else None
        yield from (replace(m, wanted=wanted) if m.quantity == "ATE RMSE" else m for m in found)
        for system, folder in asked.peer:
            if (folder / f"{name}.tum").is_file():
                theirs, _ = of_trajectory(
                    on, f"{system}, {things}", capture, folder / f"{name}.tum"
                )
                yield from (replace(m, wanted=None) for m in theirs)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--scenes", nargs="+", choices=SCENE_NAMES, default=SCENE_NAMES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2, 3, 4])
    parser.add_argument("--rates", nargs="+", choices=list(RATES), default=list(RATES))
    parser.add_argument("--width", type=int, default=640, help="of the images, in pixels")
    parser.add_argument("--peer", type=peer, action="append", default=[], metavar="NAME=DIR")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    for name in ("captures", "maps"):
        (asked.out / name).mkdir(parents=True, exist_ok=True)
    found: list[Measurement] = []
    for scene in asked.scenes:
        for seed in asked.seeds:
            for rate in asked.rates:
                found += walks(asked, scene, seed, rate)
                print(f"{table(found)}\n", flush=True)
    return conclude(f"repeating_{asked.width}", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
