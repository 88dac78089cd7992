"""Fits the odds by which finding a photo judges its poses, on synthetic scenes with true poses.

    python benchmarks/calibrate_confidence.py [--out DIR] [--front-end NAME] [--seed 0] [--record]
    python benchmarks/calibrate_confidence.py --check MAP CAPTURE [--record]

prints how often answers of each confidence are right: on the scenes, or on a capture with
photos/groundtruth.txt; and the constants for `Odds` (vnav/localisation/verification/evidence.py)
that fit the scenes best. About an hour. The scenes are an
apartment, a single room, two rooms that are the same, and a shop of identical shelves, some taken
by a worse camera and mapped at poses that are off; photos of one scene asked of another stand for
places that are on no map.
"""

import argparse
import dataclasses
from dataclasses import dataclass
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
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.photo import Photo
from vnav.localisation.verification.evidence import (
    Odds,
    _log_beta_binomial,
    _log_sum,
    evidence,
    odds_of,
    posterior,
)
from vnav.localisation.verification.image_cells import MIN_COUNT, cell_counts
from vnav.localisation.verification.prediction import predict
from vnav.localisation.verification.projection_matching import match_by_projection
from vnav.localisation.verification.verify import SEARCH_RADII
from vnav.localisation.view import View
from vnav.pipeline.build import build_map
from vnav.stages.locate import Locator
from vnav.synthetic.rendered_capture import KINECT, PHONE, CaptureSpec, write_capture
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
NEAR_M, NEAR_RAD = 0.25, np.deg2rad(10)
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
Cells = NDArray[np.intp]


@dataclass(frozen=True)
class Asked:
    """A photo's hypotheses, the strongest first: their cells (2, C), and which are right.

    ``by_chance``: cells at the pose of another photo, where nothing is right.
    """

    cells: list[Cells]
    right: list[bool]
    by_chance: Cells


def synthetic_map(
    root: Path, spec: CaptureSpec, off_m: float, front_end: str = "sift"
) -> MapFolder:
    """The map of a scene at true poses, or at poses that are off; capture in root. Made once."""
    capture, config = root / "capture", Config(features=FeaturesConfig(front_end=front_end))
    if not (capture / "camera.toml").is_file():
        write_capture(capture, spec)
    truth = read_tum(capture / "groundtruth.txt")
    noise = np.random.default_rng(spec.seed).standard_normal((len(truth), 6))
    noise = gaussian_filter1d(noise, CORRELATED, axis=0, mode="nearest")
    noise *= off_m * np.repeat([RAD_PER_M, 1], 3) / noise.std(0)
    given = Trajectory(truth.stamps_s, truth.T_world_camera @ se3.exp(noise))
    folder = MapFolder.create(root / f"map_{front_end}")
    build_map(folder, open_capture(capture, config.capture), config, given=given)
    return folder


def asked(
    folder: MapFolder, photos: list[Path], truth: dict[str, NDArray[np.float64]]
) -> list[Asked]:
    """Every photo asked of a map; one without a true pose is from elsewhere."""
    locator, found = Locator.open(folder, Config()), []
    for n, path in enumerate(photos):
        answer = locator.locate(path)
        hypotheses, true = answer.result.hypotheses, truth.get(path.name)
        right = [true is not None and near(h.view.T_world_camera, true) for h in hypotheses]
        other, chance = truth.get(photos[n - 1].name), np.zeros((2, 0), np.intp)
        if true is not None and other is not None and not near(true, other):
            chance = cells_at(other, answer.photo, locator.database)
        found.append(Asked([h.cells for h in hypotheses], right, chance))
    return found


def cells_at(
    T_world_camera: NDArray[np.float64], photo: Photo, database: LandmarkDatabase
) -> Cells:
    """Landmarks that the photo shows and that the map predicts in each cell, at some pose."""
    view = View(se3.inverse(T_world_camera), photo.intrinsics)
    prediction = predict(view, database)
    radius_px = SEARCH_RADII[-1] * Config().locate.ransac_threshold_px * photo.pixel_scale
    found = match_by_projection(prediction, photo, database, radius_px)
    return cell_counts(prediction, found, photo)


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


def fitted(known: list[Asked], elsewhere: list[Asked], start: Odds) -> Odds:
    """Shares of landmarks by maximum likelihood, shares of cells by the photos' log loss."""
    k, n = np.concatenate([photo.by_chance for photo in known], 1)
    k, n = k[n >= MIN_COUNT], n[n >= MIN_COUNT]
    found_if_not = _fitted_beta(start.found_if_not, lambda b: -_log_beta_binomial(k, n, b).mean())
    right = [c for p in known for c, r in zip(p.cells, p.right, strict=True) if r]

    def unlikely(concentration: tuple[float, ...]) -> float:
        tried = dataclasses.replace(
            start, found_if_not=found_if_not, concentration=concentration[0]
        )
        return -sum(float(_log_sum(evidence(cells, tried).right)) for cells in right)

    (concentration,) = _fitted_beta((start.concentration,), unlikely)
    odds = dataclasses.replace(start, found_if_not=found_if_not, concentration=concentration)
    photos = [*known, *elsewhere]

    def loss(logs: NDArray[np.float64]) -> float:
        right, rival = (tuple(np.exp(pair)) for pair in logs.reshape(2, 2))
        tried = dataclasses.replace(odds, cells_if_right=right, cells_of_rival=rival)
        return log_loss(photos, tried) + 1e-3 * float(((logs - first) ** 2).sum())

    first = np.log([*start.cells_if_right, *start.cells_of_rival])
    best = np.exp(minimize(loss, first, method="Nelder-Mead", options={"maxiter": 80}).x)
    return dataclasses.replace(odds, cells_if_right=tuple(best[:2]), cells_of_rival=tuple(best[2:]))


def _fitted_beta(start, cost):  # type: ignore[no-untyped-def]
    found = minimize(lambda logs: cost(tuple(np.exp(logs))), np.log(start), method="Nelder-Mead")
    return tuple(np.exp(found.x).tolist())


def log_loss(photos: list[Asked], odds: Odds) -> float:
    """Mean surprise (nats) at which hypothesis of each photo is right, or that none is."""
    total = 0.0
    for photo in photos:
        chances = posterior([evidence(c, odds) for c in photo.cells])
        right = (
            chances[np.array(photo.right, bool)].sum() if any(photo.right) else 1 - chances.sum()
        )
        total -= float(np.log(max(right, 1e-12)))
    return total / len(photos)


def reliability(on: str, photos: list[Asked], odds: Odds) -> list[Measurement]:
    """How many answers of each confidence there are, and how many are right."""
    best = []
    for photo in photos:
        chances = posterior([evidence(c, odds) for c in photo.cells])
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
    roots = [out / f"{scene}{k}" for k, (scene, *_) in numbered]
    maps = [
        synthetic_map(
            root,
            CaptureSpec(scene, frames, PHOTOS, KINECT, PHONE, seed=k, sensor=sensor),
            off_m,
            front_end,
        )
        for root, (k, (scene, frames, sensor, off_m)) in zip(roots, numbered, strict=True)
    ]
    captures = [root / "capture" for root in roots]
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
    for odds in (today, fitted(known, elsewhere, today)):
        found = table(reliability(on, photos, odds))
        print(odds, f"{log_loss(photos, odds):.3f} nats a photo", found, sep="\n")
    return reliability(on, photos, today)


if __name__ == "__main__":
    main()
