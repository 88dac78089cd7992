"""Fits the odds by which finding a photo judges its poses, on synthetic scenes with true poses.

    python benchmarks/calibrate_confidence.py [--out DIR] [--front-end NAME] [--seed 0] [--record]
    python benchmarks/calibrate_confidence.py --check MAP CAPTURE [--record]

prints how often answers of each confidence are right: on the scenes, or on a capture with
photos/groundtruth.txt; and the constants for `Odds` (vnav/localisation/verification/evidence.py)
that fit the scenes best. Half an hour. The scenes are an apartment, a single room, two rooms that
are the same, and a shop of identical shelves, some taken by a worse camera and mapped at poses that
are off; photos of one scene asked of another stand for places that are on no map.
"""

import argparse
import dataclasses
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from recording import Measurement, add_record_option, record, table
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize

from vnav.config import Config, FeaturesConfig
from vnav.config.registries import FRONT_ENDS
from vnav.core import se3
from vnav.core.trajectory import Trajectory
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.artifacts import load_descriptor_space
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.verdict.decision import support
from vnav.localisation.verification.evidence import Odds, evidence, odds_of, posterior
from vnav.pipeline.build import build_map
from vnav.stages.locate import Locator
from vnav.synthetic.rendered_capture import KINECT, PHONE, CaptureSpec, cached_capture
from vnav.synthetic.sensor import Sensor

GOOD, BAD = Sensor(), Sensor(color_sigma=8.0, jpeg_quality=50, gain_drift=0.15)
SCENES = (  # name, frames, sensor, and how far off the poses are
    ("apartment", 200, GOOD, 0.0),
    ("one_room", 100, BAD, 0.02),
    ("twin_rooms", 240, GOOD, 0.0),
    ("shop", 140, GOOD, 0.0),
    ("apartment", 200, BAD, 0.03),
    ("shop", 140, BAD, 0.01),
)
RAD_PER_M, CORRELATED = 0.25, 15  # rotations off for metres off; frames that are off alike
PHOTOS = 60
BETAS = "found_if_not", "cells_if_right", "cells_of_rival"
NEAR_START = 0.01  # nats for a constant that is e times as large
NEAR_M, NEAR_RAD = 0.25, np.deg2rad(10)
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
Cells = NDArray[np.intp]


@dataclass(frozen=True)
class Asked:
    """A photo's hypotheses: their cells (2, C), and which are right.

    ``support`` (H,): how likely they are by the matches that agree.
    """

    cells: list[Cells]
    support: NDArray[np.float64]
    right: list[bool]

    def chances(self, odds: Odds) -> NDArray[np.float64]:
        """Of each hypothesis (H,), by those odds."""
        return posterior([evidence(c, odds) for c in self.cells], self.support)


def synthetic_map(capture: Path, seed: int, off_m: float, front_end: str) -> MapFolder:
    """The map of a scene, beside its capture, at true poses or at poses that are off. Made once."""
    config = Config(features=FeaturesConfig(front_end=front_end))
    truth = read_tum(capture / "groundtruth.txt")
    noise = np.random.default_rng(seed).standard_normal((len(truth), 6))
    noise = gaussian_filter1d(noise, CORRELATED, axis=0, mode="nearest")
    noise *= off_m * np.repeat([RAD_PER_M, 1], 3) / noise.std(0)
    given = Trajectory(truth.stamps_s, truth.T_world_camera @ se3.exp(noise))
    folder = MapFolder.create(capture.with_name(f"{capture.name}_{front_end}"))
    build_map(folder, open_capture(capture, config.capture), config, given=given)
    return folder


def asked(
    folder: MapFolder, photos: list[Path], truth: dict[str, NDArray[np.float64]]
) -> list[Asked]:
    """Every photo asked of a map; one without a true pose is from elsewhere."""
    locator, found = Locator.open(folder, Config()), []
    for path in photos:
        hypotheses, true = locator.locate(path).result.hypotheses, truth.get(path.name)
        right = [true is not None and near(h.view.T_world_camera, true) for h in hypotheses]
        found.append(Asked([h.cells for h in hypotheses], support(hypotheses), right))
    return found


def near(T_a: NDArray[np.float64], T_b: NDArray[np.float64]) -> bool:
    T = se3.inverse(T_a) @ T_b
    return bool(np.linalg.norm(T[:3, 3]) < NEAR_M and se3.rotation_angle(T) < NEAR_RAD)


def true_poses(folder: MapFolder, capture: Path) -> dict[str, NDArray[np.float64]]:
    """T_world_camera of the capture's photos in the world of the map, by name."""
    mapped = read_tum(folder.stage("optimise") / "trajectory_0.tum")
    truth = read_tum(capture / "groundtruth.txt")
    rows = np.abs(truth.stamps_s[:, None] - mapped.stamps_s).argmin(0)
    T = se3.align(mapped.T_world_camera[:, :3, 3], truth.T_world_camera[rows, :3, 3])
    lines = (capture / "photos" / "groundtruth.txt").read_text("utf-8").splitlines()
    table = [line.split() for line in lines if not line.startswith("#")]
    return {
        name: T
        @ se3.make(
            se3.rotation_from_quat(np.array(numbers[3:], float)), np.array(numbers[:3], float)
        )
        for name, *numbers in table
    }


def photos_of(capture: Path) -> list[Path]:
    return sorted((capture / "photos").glob("*.jpg"))


def fitted(photos: list[Asked], start: Odds) -> Odds:
    """The constants that front-ends differ in, by the photos' log loss, not far from a start."""
    first = np.log([start.concentration, *chain.from_iterable(getattr(start, b) for b in BETAS)])

    def odds(logs: NDArray[np.float64]) -> Odds:
        concentration, *ends = np.exp(logs).tolist()
        betas = zip(BETAS, zip(ends[::2], ends[1::2], strict=True), strict=True)
        return dataclasses.replace(start, concentration=concentration, **dict(betas))

    def loss(logs: NDArray[np.float64]) -> float:
        return log_loss(photos, odds(logs)) + NEAR_START * float(((logs - first) ** 2).sum())

    steps = {"maxiter": 6, "maxfev": 400}
    return odds(minimize(loss, first, method="Powell", options=steps).x)


def log_loss(photos: list[Asked], odds: Odds) -> float:
    """Mean surprise (nats) at which hypothesis of each photo is right, or that none is."""
    total = 0.0
    for photo in photos:
        chances = photo.chances(odds)
        right = (
            chances[np.array(photo.right, bool)].sum() if any(photo.right) else 1 - chances.sum()
        )
        total -= float(np.log(max(right, 1e-12)))
    return total / len(photos)


def reliability(on: str, photos: list[Asked], odds: Odds) -> list[Measurement]:
    """How many answers of each confidence there are, and how many are right."""
    best = []
    for photo in photos:
        chances = photo.chances(odds)
        if len(chances):
            k = int(chances.argmax())
            best.append((chances[k], photo.right[k]))
    chance, right = np.array(best).T
    found = []
    for low, high in zip(BINS, BINS[1:], strict=False):
        within, what = (
            (chance > low) & (chance <= high),
            f"answers of confidence {low:g} to {high:g}",
        )
        if within.any():
            mean, share = 100 * chance[within].mean(), 100 * right[within].mean()
            found += [
                Measurement(on, what, "answered", int(within.sum())),
                Measurement(on, what, "mean confidence", float(mean), "%"),
                Measurement(on, what, "within 25 cm and 10 deg", float(share), "%"),
            ]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("bench/confidence"))
    parser.add_argument("--check", nargs=2, type=Path, metavar=("MAP", "CAPTURE"))
    parser.add_argument("--seed", type=int, default=0, help="of the first scene")
    parser.add_argument("--front-end", choices=FRONT_ENDS, default="sift")
    add_record_option(parser)
    options = parser.parse_args()
    if options.check:
        folder, capture = MapFolder.open(options.check[0]), options.check[1]
        photos = asked(folder, photos_of(capture), true_poses(folder, capture))
        found = reliability(capture.name, photos, odds_of(load_descriptor_space(folder)))
        print(table(found))
    else:
        found = calibrated(options.out, options.front_end, options.seed)
    if options.record:
        on = options.check[1].name if options.check else f"rendered_{options.front_end}"
        record(f"photos_{on}_confidence", "how often right", found)


def calibrated(out: Path, front_end: str, seed: int) -> list[Measurement]:
    """Print the constants of today and those that fit best; how reliable those of today are."""
    numbered = list(enumerate(SCENES, seed))
    captures = [
        cached_capture(CaptureSpec(scene, n, PHOTOS, KINECT, PHONE, seed=k, sensor=sensor), out)
        for k, (scene, n, sensor, _) in numbered
    ]
    maps = [
        synthetic_map(capture, k, off_m, front_end)
        for capture, (k, (*_, off_m)) in zip(captures, numbered, strict=True)
    ]
    known = [
        a
        for folder, capture in zip(maps, captures, strict=True)
        for a in asked(folder, photos_of(capture), true_poses(folder, capture))
    ]
    elsewhere = [
        a
        for k, folder in enumerate(maps)
        for a in asked(folder, photos_of(captures[k - 1]), {})
        if a.cells
    ]
    photos = [*known, *elsewhere]
    on, today = f"rendered scenes, {front_end}", odds_of(load_descriptor_space(maps[0]))
    for odds in (today, fitted(photos, today)):
        found = table(reliability(on, photos, odds))
        print(odds, f"{log_loss(photos, odds):.3f} nats a photo", found, sep="\n")
    return reliability(on, photos, today)


if __name__ == "__main__":
    main()
