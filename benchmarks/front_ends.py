"""What each front-end, and each tracker, makes of the same captures: side by side with SIFT.

    python benchmarks/front_ends.py OUT CAPTURE... [--seeds 0 1 2] [--only sift orb] [--record]

builds a map of every capture in OUT, by each way and with each seed, each once: `vnav odometry`,
whose processor time is measured, then `vnav build-map`, which goes on from there. It scores the
trajectory, asks the map for the capture's photos, where it has some, and for 40 frames of each
other capture, which must all be refused. Times are those of the processor, as a ratio to SIFT's of
the same capture and seed. Exit code 1 where something wanted is missed. A map takes 3 to 8 minutes.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from accuracy import NOT_LOCATED, errors, photos_found, poses_in, strangers, vnav
from photo_cases import command
from recording import Measurement, add_record_option, conclude

WAYS = {
    "sift": (),
    "orb": ("--config", "orb"),
    "brisk": ("--set", "features.front_end=brisk"),
    "fast": ("--set", "features.front_end=fast"),
}
WANTED_ATE_M = {
    ("orb", "house"): 0.010,
    ("orb", "redkitchen01"): 0.048,
    ("orb", "fr1_desk"): 0.0175,
}
WANTED_TIME = {"orb": 0.35}
WANTED_INDEX = {"orb": 0.85}
WANTED_PHOTOS = {("sift", "house"): 37, ("orb", "house"): 28}
CPU_FILE = "odometry_cpu_s.json"


@dataclass(frozen=True)
class Made:
    """A map that was made of a capture in one way, and the seconds that its odometry took."""

    capture: Path
    way: str
    seed: int
    folder: Path

    @property
    def on(self) -> str:
        return f"{self.capture.name}, seed {self.seed}"

    @property
    def cpu_s(self) -> float:
        return float(json.loads((self.folder / CPU_FILE).read_text("utf-8")))

    @property
    def index_bytes(self) -> float:
        """Of the index, for each landmark."""
        files = (self.folder / "index").rglob("*")
        return sum(file.stat().st_size for file in files) / self.landmarks

    @property
    def landmarks(self) -> int:
        return int(vnav("info", self.folder)["landmarks"])


def made(capture: Path, way: str, seed: int, out: Path) -> Made:
    """The map of a capture, made where it is not there."""
    folder = out / f"{capture.name}_{way}_{seed}"
    options = ("--map", folder, *WAYS[way], "--set", f"seed={seed}")
    if not (folder / CPU_FILE).is_file():
        seconds = cpu_seconds(command("odometry", capture, *options))
        (folder / CPU_FILE).write_text(json.dumps(seconds), "utf-8")
    done = subprocess.run(command("build-map", capture, *options), capture_output=True)
    done.check_returncode()
    return Made(capture, way, seed, folder)


def cpu_seconds(asked: Sequence[str]) -> float:
    """How long the processor works for a command, on all cores; CalledProcessError if it fails."""
    with subprocess.Popen(asked, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, asked)
    return usage.ru_utime + usage.ru_stime


def measure(of: Made, sift: Made | None, others: Sequence[Path]) -> Iterator[Measurement]:
    """What is asked of one map; times and sizes where there is SIFT's to hold them against."""
    on, way, name = of.on, of.way, of.capture.name
    trajectory = of.folder / "optimise" / "trajectory_0.tum"
    score = vnav("score", trajectory, of.capture / "groundtruth.txt")
    frames = poses_in(of.capture / "rgb.txt")
    every = f"at least {frames}" if way in ("sift", "orb") else None
    yield Measurement(on, way, "frames with a pose", poses_in(trajectory), wanted=every)
    limit = WANTED_ATE_M.get((way, name))
    wanted = f"at most {limit:g}" if limit else None
    yield Measurement(on, way, "ATE RMSE", score["ate_m"]["rmse"], "m", wanted)
    if sift is not None:
        yield ratio(on, way, "odometry's time", of.cpu_s / sift.cpu_s, WANTED_TIME)
        size = of.index_bytes / sift.index_bytes
        yield ratio(on, way, "index, per landmark", size, WANTED_INDEX)
    yield Measurement(on, way, "landmarks", of.landmarks)
    wrong = sum(k.value for other in others for k in refused(of, other))
    photos = of.capture / "photos"
    if (photos / "groundtruth.txt").is_file():
        answers = vnav("locate", photos, "--map", of.folder, expected=(0, NOT_LOCATED))
        off = errors(answers, photos, np.array(score["T_truth_world"]))
        count = {k.quantity: k.value for k in photos_found(name, len(answers), off)}
        least = WANTED_PHOTOS.get((way, name))
        quantity = "within 5 cm and 2 deg"
        wanted = f"at least {least}" if least else None
        yield Measurement(on, way, quantity, count[quantity], wanted=wanted)
        wrong += count["wrong"]
    yield Measurement(on, way, "wrong", wrong, wanted="at most 0")


def refused(of: Made, other: Path) -> list[Measurement]:
    """How many frames of another place are located, which is wrong."""
    return [k for k in strangers(of.folder, of.on, other) if k.quantity == "wrong"]


def ratio(on: str, way: str, what: str, value: float, wanted: dict[str, float]) -> Measurement:
    """A quantity as a share of SIFT's."""
    limit = f"at most {wanted[way]:g}" if way in wanted else None
    return Measurement(on, way, what, value, wanted=limit, peer="SIFT" if way != "sift" else None)


def line(found: Measurement) -> str:
    """What was measured, as the runs go on."""
    return f"{found.on}, {found.what}: {found.quantity} {found.value:.4g}"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("captures", type=Path, nargs="+", metavar="CAPTURE")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--only", nargs="+", choices=WAYS, default=list(WAYS), metavar="WAY")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    found: list[Measurement] = []
    for seed in asked.seeds:
        for capture in asked.captures:
            others = [other for other in asked.captures if other != capture]
            sift = None
            for way in asked.only:
                of = made(capture, way, seed, asked.out)
                sift = of if way == "sift" else sift
                measured = list(measure(of, sift, others))
                print(*map(line, measured), sep="\n", flush=True)
                found += measured
    return conclude("front_ends", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
