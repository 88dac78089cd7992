"""The preset that follows the text of the method to the letter, held against the default.

    python benchmarks/patent.py [--out DIR] [--record]

builds by either what is missing of the maps in DIR: house, redkitchen01, and the first half of
redkitchen01 at its true poses (from ../shared/captures). It scores the trajectories, locates
house's photos, every tenth frame of redkitchen01's second half, and 40 frames of the kitchen in the
house, which must be refused, and plans 20 paths between places where the camera stood. Then it asks
the default's map of house by each search and by other levels, and a map of approximate k-means. All
time is the processor's, of all cores, as a ratio to the default's in the same run. A map takes 3 to
8 minutes. Exit code 1 where a photo is wrong in the default's maps.
"""

import argparse
import itertools
import json
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from accuracy import STRANGERS, frames_of, poses_in, vnav
from front_ends import told
from numpy.typing import NDArray
from photo_cases import Case, built, house, kitchen_halves
from recording import Measurement, add_record_option, missed, record, table
from speed import SHARED

from vnav.api.map import Map, open_map
from vnav.config import Config, load
from vnav.config.registries import SEARCHES
from vnav.evaluation.metrics import WRONG, relocalisation_error
from vnav.io.store.map_folder import STAGES
from vnav.localisation.verdict.answer import PhotoAnswer

Array = NDArray[np.float64]

WAYS = {"default": None, "patent": "patent"}  # and their presets
NEAR = 0.05, 2.0  # metres, degrees
PATHS, SEED = 20, 2
LEVELS = {  # of 2D-3D and of 3D-2D, from where
    "levels 3 and 5 from the root": ("root", 3, 5),
    "levels 3 and 5 from the leaves": ("leaves", 3, 5),
}
FLAT = "vocabulary.method=approximate"


@dataclass(frozen=True)
class Asked:
    """How photos were answered: errors (N, 2) in metres and degrees of those located, and time."""

    asked: int
    off: Array
    cpu_s: float  # a photo

    def measurements(self, on: str, what: str, than: "Asked | None") -> Iterator[Measurement]:
        """Counts, medians, and time as a ratio to that of others."""
        m, deg = self.off.T
        near = int(((m <= NEAR[0]) & (deg <= NEAR[1])).sum())
        wrong = int(((m > WRONG[0]) | (deg > WRONG[1])).sum())
        limit = "at most 0" if what == "default" else None
        yield Measurement(on, what, "photos asked", self.asked)
        yield Measurement(on, what, "located", len(self.off))
        yield Measurement(on, what, "within 5 cm and 2 deg", near)
        yield Measurement(on, what, "wrong", wrong, wanted=limit)
        if len(self.off):
            yield Measurement(on, what, "median error", 100 * float(np.median(m)), "cm")
            yield Measurement(on, what, "median error", float(np.median(deg)), "deg")
        if than is not None:
            yield Measurement(on, what, "time of a photo, ratio", self.cpu_s / than.cpu_s)


def located(case: Case, config: Config) -> Asked:
    """The photos of a case, asked of its map."""
    mapped = open_map(case.folder.root)
    list(mapped.locate_all(case.photos[:1], camera=case.camera, config=config))  # loads
    started = time.process_time()
    answers = list(mapped.locate_all(case.photos, camera=case.camera, config=config))
    cpu_s = (time.process_time() - started) / len(case.photos)
    found = [a for a in answers if isinstance(a, PhotoAnswer) and a.located]
    poses = np.array([a.T_world_camera for a in found]).reshape(-1, 4, 4)
    truth = np.array([case.truth[a.path.name] for a in found]).reshape(-1, 4, 4)
    return Asked(len(answers), np.stack(relocalisation_error(poses, truth), -1), cpu_s)


def whole(capture: Path, folder: Path, preset: str | None) -> float:
    """Build the map of a capture where it is not there; the processor's seconds of its stages."""
    built(folder, capture, None, *(("--config", preset) if preset else ()))
    reports = (folder / "reports" / f"{stage}.json" for stage in STAGES)
    return sum(float(json.loads(path.read_text("utf-8"))["cpu_seconds"]) for path in reports)


def trajectory(capture: Path, what: str, folder: Path) -> Iterator[Measurement]:
    """Coverage and ATE of a map's trajectory."""
    file = folder / "optimise" / "trajectory_0.tum"
    score = vnav("score", file, capture / "groundtruth.txt")
    yield Measurement(capture.name, what, "frames", frames_of(capture))
    yield Measurement(capture.name, what, "with a pose", poses_in(file))
    yield Measurement(capture.name, what, "ATE RMSE", score["ate_m"]["rmse"], "m")


def paths(mapped: Map, config: Config) -> dict[int, float]:
    """Lengths, by number, of those paths that are found between frames that a seed draws."""
    places = mapped.trajectory().T_world_camera[:, :2, 3]
    rng, lengths = np.random.default_rng(SEED), {}
    for k in range(PATHS):
        rows = (rng.random(2) * len(places)).astype(int)
        start, goal = (tuple(places[row].tolist()) for row in rows)
        plan = mapped.plan(start, goal, config=config).found
        if plan is not None:
            lengths[k] = plan.length_m
    return lengths


def planned(capture: str, maps: dict[str, Path]) -> Iterator[Measurement]:
    """Paths that are found in each map, and the mean length of those found in all."""
    found = {what: paths(open_map(maps[what]), load(WAYS[what])) for what in WAYS}
    common = set.intersection(*(set(lengths) for lengths in found.values()))
    for what, lengths in found.items():
        yield Measurement(capture, what, f"paths found of {PATHS}", len(lengths))
        if common:
            mean_m = float(np.mean([lengths[k] for k in common]))
            yield Measurement(capture, what, "mean length of those found by both, m", mean_m)


def strangers(case: Case, what: str, config: Config) -> Measurement:
    """Frames of the kitchen that are located in the house."""
    kitchen = SHARED / "redkitchen01"
    frames = sorted((kitchen / "rgb").iterdir())
    rows = np.linspace(0, len(frames) - 1, STRANGERS).astype(int)
    camera, asked = kitchen / "camera.toml", [frames[k] for k in rows]
    answers = open_map(case.folder.root).locate_all(asked, camera=camera, config=config)
    count = sum(answer.located for answer in answers)
    limit = "at most 0" if what == "default" else None
    return Measurement(case.name, what, f"located of {STRANGERS} of elsewhere", count, wanted=limit)


def chains(out: Path) -> Iterator[Measurement]:
    """The whole chain by the default and by the preset."""
    for name in ("house", "redkitchen01"):
        capture = SHARED / name
        maps = {what: out / what / name for what in WAYS}
        cpu_s = {what: whole(capture, maps[what], preset) for what, preset in WAYS.items()}
        for what, folder in maps.items():
            yield from trajectory(capture, what, folder)
            ratio = cpu_s[what] / cpu_s["default"]
            yield Measurement(name, what, "time of the map, ratio", ratio)
        yield from planned(name, maps)
    for make in (house, kitchen_halves):
        than: Asked | None = None
        for what, preset in WAYS.items():
            case, config = make(out / what, *(("--config", preset) if preset else ())), load(preset)
            found = located(case, config)
            than = than or found
            yield from found.measurements(case.name, what, than)
            if make is house:
                yield strangers(case, what, config)


def searches(out: Path) -> Iterator[Measurement]:
    """House's photos by each search, by other levels, and in a map of flat words."""
    case = house(out / "default")
    base = located(case, Config())
    ways = {f"search {name}": [f"locate.search={name}"] for name in SEARCHES}
    for what, (origin, level_2d_3d, level_3d_2d) in LEVELS.items():
        levels = f"level_2d_3d={level_2d_3d}", f"level_3d_2d={level_3d_2d}"
        ways[what] = [f"locate.{item}" for item in (f"levels_from={origin}", *levels)]
    for what, settings in ways.items():
        yield from _of_default(case, what, settings, base)
    flat = out / "approximate"
    if not flat.is_dir():
        shutil.copytree(out / "default" / "house", flat / "house")
    words = house(flat, "--set", FLAT)
    yield from _of_default(words, "approximate k-means", [], base)
    for what in LEVELS:
        yield from _of_default(words, f"approximate k-means, {what}", ways[what], base)


def _of_default(
    case: Case, what: str, settings: Sequence[str], than: Asked
) -> Iterator[Measurement]:
    found = located(case, load(settings=settings))
    yield from found.measurements("house, mapped by the default", what, than)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("bench/patent"), help="of the maps")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    found = told(itertools.chain(chains(asked.out), searches(asked.out)))
    print(table(found))
    if asked.record:
        record("patent", "how often right", found, arguments)
    return int(bool(missed(found)))


if __name__ == "__main__":
    sys.exit(main())
