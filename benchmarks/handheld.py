"""A hand-held camera with a rolling shutter and late depth: are both found, and what does it gain?

    python benchmarks/handheld.py OUT [--seeds 5] [--still CAPTURE ...] [--peer NAME=DIR] [--record]

renders HANDHELD of vnav.synthetic to OUT/captures and maps it to OUT/maps, each once. The same
odometry and loops are then optimised without the sensor's delays. The same walk is made a quarter
faster, alone and past two people who cover 20 % of the pixels. A capture that is still has
none, and none is wanted there: `apartment` is rendered, others may be named. A DIR of a peer has
its trajectories of the same captures, as CAPTURE.tum. Exit code 1 where something wanted is missed.
"""

import argparse
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from accuracy import built, frames_of, poses_in, vnav
from people import held_against, peer, rendered
from photo_cases import command
from recording import Measurement, add_record_option, conclude
from verdicts import is_doubtful

from vnav.io.store.map_folder import MapFolder
from vnav.synthetic import DEMO, HANDHELD, CaptureSpec

TIMES_ATE = 0.7  # of what it is without the sensor's model
SHARE = 0.1  # of the true delay
FASTER = replace(HANDHELD, frames=240)  # of the same way
PAST_PEOPLE = replace(FASTER, walkers=2, walker_share=0.2)
UNITS = {"depth_delay_s": ("depth delay", 1e3, "ms"), "line_delay_s": ("line delay", 1e6, "us")}


def optimised_without(map_of: Path, folder: Path) -> Path:
    """A copy of the map, optimised without delays; its trajectory."""
    if not folder.is_dir():
        ignored = shutil.ignore_patterns("optimise", "fuse", "index", "reports", "state")
        shutil.copytree(map_of, folder, ignore=ignored)
    run = command("optimise", "--map", folder, "--set", "optimise.estimate_delays=false")
    subprocess.run(run, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return folder / "optimise" / "trajectory_0.tum"


def ate(on: str, what: str, capture: Path, file: Path) -> list[Measurement]:
    """Frames with a pose, and the ATE of a trajectory."""
    off_m = vnav("score", file, capture / "groundtruth.txt")["ate_m"]["rmse"]
    return [
        Measurement(on, what, "frames", frames_of(capture)),
        Measurement(on, what, "frames with a pose", poses_in(file)),
        Measurement(on, what, "ATE RMSE", off_m, "m"),
    ]


def wanted_of(found: Sequence[Measurement], without_m: float) -> list[Measurement]:
    """What is wanted of a map, given its ATE without the sensor's model."""
    frames = next(m.value for m in found if m.quantity == "frames")
    limits = {
        "frames with a pose": f"at least {frames:g}",
        "ATE RMSE": f"at most {TIMES_ATE * without_m:.4g}",
    }
    return [replace(m, wanted=limits.get(m.quantity)) for m in found]


def delays(on: str, what: str, values: dict[str, Any], true: dict[str, float]) -> list[Measurement]:
    """What a map's report says of both delays, and how far off that is."""
    found = []
    for name, (quantity, scale, unit) in UNITS.items():
        most = scale * SHARE * true[name]
        off = scale * abs(values[name] - true[name])
        found += [
            Measurement(on, what, quantity, scale * values[name], unit),
            Measurement(on, what, f"its sigma, {unit}", scale * (values[f"{name}_sigma"] or 0)),
            Measurement(on, what, f"its error, {unit}", off, "", f"at most {most:g}"),
        ]
    return found


def map_report(map_of: Path) -> dict[str, Any]:
    """The values of the optimise stage's report; of the sensor, for there is one capture."""
    values: dict[str, Any] = MapFolder(map_of).report("optimise")["values"]
    return values | values["sensors"][0]


def true_delays(spec: CaptureSpec) -> dict[str, float]:
    """By the names of the report."""
    return {name: getattr(spec.sensor, name) for name in UNITS}


def handheld(out: Path, seed: int, peers: Sequence[tuple[str, Path]]) -> Iterator[Measurement]:
    """One seed, with and without the sensor's model, and what peers made of it."""
    spec, on = replace(HANDHELD, seed=seed), f"handheld, seed {seed}"
    name = f"handheld_seed{seed}"
    capture, map_of = rendered(out / "captures" / name, spec), out / "maps" / name
    built(capture, map_of)
    file = optimised_without(map_of, out / "maps" / f"{name}_without")
    without = ate(on, "vnav without the sensor's delays", capture, file)
    found = ate(on, "vnav", capture, map_of / "optimise" / "trajectory_0.tum")
    values = map_report(map_of)
    yield from wanted_of(found, without[-1].value)
    yield Measurement(on, "vnav", "parts", len(values["parts"]), "", "at most 1")
    yield from delays(on, "vnav", values, true_delays(spec))
    yield from without
    for peer_name, folder in peers:
        if (folder / f"{name}.tum").is_file():
            yield from ate(on, peer_name, capture, folder / f"{name}.tum")


def faster(out: Path, seed: int) -> Iterator[Measurement]:
    """The same walk a quarter faster, alone and past people."""
    alone: list[Measurement] = []
    for what, spec in (("faster", FASTER), ("faster past people", PAST_PEOPLE)):
        name = f"{what.replace(' ', '_')}_seed{seed}"
        capture = rendered(out / "captures" / name, replace(spec, seed=seed))
        map_of = out / "maps" / name
        built(capture, map_of)
        on, file = f"handheld, {what}, seed {seed}", map_of / "optimise" / "trajectory_0.tum"
        found = ate(on, "vnav", capture, file)
        yield from held_against(alone, found)
        doubtful = is_doubtful(MapFolder(map_of))
        yield Measurement(on, "vnav", "called doubtful", int(doubtful))
        alone = found


def still(out: Path, capture: Path) -> list[Measurement]:
    """A capture whose sensor has no delays."""
    map_of = out / "maps" / capture.name
    built(capture, map_of)
    found = ate(capture.name, "vnav", capture, map_of / "optimise" / "trajectory_0.tum")
    return [*found, *delays(capture.name, "vnav", map_report(map_of), dict.fromkeys(UNITS, 0.0))]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--still", nargs="+", type=Path, default=[], help="captures without delays")
    parser.add_argument("--peer", type=peer, action="append", default=[], metavar="NAME=DIR")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    for name in ("captures", "maps"):
        (asked.out / name).mkdir(parents=True, exist_ok=True)
    found = [m for seed in range(asked.seeds) for m in handheld(asked.out, seed, asked.peer)]
    found += [m for seed in range(asked.seeds) for m in faster(asked.out, seed)]
    apartment = rendered(asked.out / "captures" / "apartment", DEMO)
    found += [m for capture in (apartment, *asked.still) for m in still(asked.out, capture)]
    return conclude("handheld", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
