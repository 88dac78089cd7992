"""What front-ends, trackers and the preset fast make of the same captures, side by side with SIFT.

    python benchmarks/front_ends.py OUT CAPTURE... [--seeds 0 1 2] [--only sift orb] [--record]

builds a map of every capture in OUT, by each way and with each seed, each once. It scores the
trajectory, asks the map for the capture's photos, where it has some, and for 40 frames of each
other capture, which must all be refused. Then `vnav odometry` runs once more by each way, one after
the other: the processor's time, on all cores, is told as a ratio to that of SIFT of whole frames.
Exit code 1 where something wanted is missed. A map takes 2 to 5 minutes.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from accuracy import NOT_LOCATED, errors, photos_found, poses_in, strangers, vnav
from photo_cases import command
from recording import Measurement, add_record_option, conclude

WAYS = {
    "sift": (),
    "sift-whole": ("--set", "features.sift.half_size=false"),
    "orb": ("--config", "orb"),
    "klt": ("--config", "klt"),
    "brisk": ("--set", "features.front_end=brisk"),
    "fast": ("--set", "features.front_end=fast"),
    "preset-fast": ("--config", "fast"),
}
WHOLE = "sift-whole"  # what odometry's time is told of: so it was when its share was wanted
WANTED_ATE_M = {
    ("orb", "house"): 0.010,
    ("orb", "redkitchen01"): 0.048,
    ("orb", "fr1_desk"): 0.0175,
    ("klt", "house"): 0.006,
    ("preset-fast", "house"): 0.0052,
    ("preset-fast", "redkitchen01"): 0.0585,
    ("preset-fast", "fr1_desk"): 0.0181,
}
WANTED_TIME = {"orb": 0.35, "klt": 0.4}
WANTED_INDEX = {"orb": 0.85}
WANTED_PHOTOS = {("sift", "house"): 37, ("orb", "house"): 28, ("preset-fast", "house"): 36}


@dataclass(frozen=True)
class Made:
    """A map that was made of a capture in one way."""

    capture: Path
    way: str
    seed: int
    folder: Path

    @property
    def on(self) -> str:
        return f"{self.capture.name}, seed {self.seed}"

    @property
    def landmarks(self) -> int:
        return int(vnav("info", self.folder)["landmarks"])

    @property
    def index_bytes(self) -> float:
        """Of the index, for each landmark."""
        files = (self.folder / "index").rglob("*")
        return sum(file.stat().st_size for file in files) / self.landmarks


def made(capture: Path, way: str, seed: int, out: Path) -> Made:
    """The map of a capture, made where it is not there."""
    folder = out / f"{capture.name}_{way}_{seed}"
    building = asked_for("build-map", capture, way, seed, folder)
    subprocess.run(building, check=True, stdout=subprocess.DEVNULL)
    return Made(capture, way, seed, folder)


def asked_for(what: str, capture: Path, way: str, seed: int, folder: Path) -> list[str]:
    """The command that makes a map, or begins one."""
    options = ("--quiet", "--map", folder, *WAYS[way], "--set", f"seed={seed}")
    return command(what, capture, *options)


def times(capture: Path, ways: Sequence[str], seed: int) -> Iterator[Measurement]:
    """How long the processor works for odometry, as a share of what SIFT of whole frames takes."""
    seconds = {}
    for way in dict.fromkeys((WHOLE, *ways)):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "map"
            seconds[way] = cpu_seconds(asked_for("odometry", capture, way, seed, folder))
    for way in ways:
        share, on = seconds[way] / seconds[WHOLE], f"{capture.name}, seed {seed}"
        yield ratio(on, way, "odometry's time", share, WANTED_TIME, WHOLE)


def cpu_seconds(asked: Sequence[str]) -> float:
    """How long the processor works for a command, on all cores; CalledProcessError if it fails."""
    with subprocess.Popen(asked, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, asked)
    return usage.ru_utime + usage.ru_stime


def measure(of: Made, sift: Made | None, others: Sequence[Path]) -> Iterator[Measurement]:
    """What is asked of one map; its size where there is SIFT's to hold it against."""
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


def ratio(
    on: str, way: str, what: str, value: float, wanted: dict[str, float], peer: str = "sift"
) -> Measurement:
    """A quantity as a share of what it is with SIFT."""
    limit = f"at most {wanted[way]:g}" if way in wanted else None
    return Measurement(on, way, what, value, wanted=limit, peer=peer if way != peer else None)


def maps_of(
    capture: Path, ways: Sequence[str], seed: int, out: Path, others: Sequence[Path]
) -> Iterator[Measurement]:
    """What is measured on a capture, by each way."""
    sift = None
    for way in ways:
        of = made(capture, way, seed, out)
        sift = of if way == "sift" else sift
        yield from measure(of, sift, others)


def told(found: Iterable[Measurement]) -> list[Measurement]:
    """Everything that is measured, which is printed as the runs go on."""
    everything = []
    for m in found:
        print(f"{m.on}, {m.what}: {m.quantity} {m.value:.4g}", flush=True)
        everything.append(m)
    return everything


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("captures", type=Path, nargs="+", metavar="CAPTURE")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--only", nargs="+", choices=WAYS, default=list(WAYS), metavar="WAY")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    ways = [way for way in WAYS if way in asked.only]
    found: list[Measurement] = []
    for seed in asked.seeds:
        for capture in asked.captures:
            others = [other for other in asked.captures if other != capture]
            found += told(maps_of(capture, ways, seed, asked.out, others))
    for capture in asked.captures:
        found += told(times(capture, ways, asked.seeds[0]))
    return conclude("front_ends", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
