"""What tracking against the local map does for trajectories, and what it costs.

    python benchmarks/map_tracking.py CAPTURE... [--seeds N] [--record]

tracks and optimises each capture with ``odometry.against_map`` off and on, in turns, with N seeds,
and scores both against the capture's groundtruth.txt. Errors and time are medians over the seeds;
the spread is the largest ATE less the smallest, of the median. Time is odometry's on the processor,
held against that of the run without.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from accuracy import vnav
from photo_cases import command
from recording import Measurement, add_record_option, record, table

OFF, ON = "not against the map", "against the map"


def scored(capture: Path, folder: Path, seed: int, on: bool) -> dict[str, float]:
    """ATE, RPE and odometry's processor time of one run."""
    options = ("--map", folder, "--set", f"seed={seed}")
    options += ("--set", f"odometry.against_map={'true' if on else 'false'}")
    for stage in (("odometry", capture), ("vocabulary",), ("loops",), ("optimise",)):
        said = subprocess.run(command(*stage, *options), capture_output=True, text=True)
        if said.returncode:
            raise SystemExit(said.stderr)
    score = vnav("score", folder / "optimise" / "trajectory_0.tum", capture / "groundtruth.txt")
    report = json.loads((folder / "reports" / "odometry.json").read_text("utf-8"))
    return {
        "ATE": score["ate_m"]["rmse"],
        "RPE": score["rpe"]["1 frame"]["translation_m"]["rmse"],
        "time": report["cpu_seconds"],
    }


def compare(capture: Path, seeds: int) -> list[Measurement]:
    """Both ways on one capture, each with all seeds."""
    runs: dict[str, list[dict[str, float]]] = {OFF: [], ON: []}
    for seed in range(seeds):
        for what, of in runs.items():
            with tempfile.TemporaryDirectory() as scratch:
                of.append(scored(capture, Path(scratch) / "map", seed, what == ON))
            print(f"{capture.name}, seed {seed}, {what}: {of[-1]}", flush=True)
    return [m for what in runs for m in measured(capture.name, what, runs)]


def measured(on: str, what: str, runs: dict[str, list[dict[str, float]]]) -> list[Measurement]:
    """Medians of one way, over the seeds."""
    middle = {name: median(run[name] for run in runs[what]) for name in runs[what][0]}
    without = median(run["time"] for run in runs[OFF])
    ates = [run["ATE"] for run in runs[what]]
    found = [
        Measurement(on, what, "ATE RMSE", middle["ATE"], "m"),
        Measurement(on, what, "RPE over a frame", 1000 * middle["RPE"], "mm"),
        Measurement(on, what, "odometry's time, of that without", middle["time"] / without),
    ]
    if len(ates) > 1:
        spread = 100 * (max(ates) - min(ates)) / middle["ATE"]
        found.append(Measurement(on, what, "spread of ATE", spread, "%"))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("captures", type=Path, nargs="+", metavar="CAPTURE")
    parser.add_argument("--seeds", type=int, default=3)
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    for capture in asked.captures:
        found = compare(capture, asked.seeds)
        print(f"\n{table(found)}\n", flush=True)
        if asked.record:
            record(f"map_tracking_{capture.name}", "how robust", found, arguments)
    return 0


if __name__ == "__main__":
    sys.exit(main())
