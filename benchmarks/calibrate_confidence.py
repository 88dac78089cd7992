"""Fits the odds by which finding a photo judges its poses, on synthetic scenes with true poses.

    python benchmarks/calibrate_confidence.py [--out DIR]
    python benchmarks/calibrate_confidence.py --check MAP CAPTURE

prints the constants for `vnav.localisation.evidence.Odds`, and how often answers of each
confidence are right: on the scenes, or on a capture with photos/groundtruth.txt. The scenes are an
apartment, a single room, two rooms that are the same, and a shop of identical shelves; photos of
one scene asked of another stand for places that are on no map.
"""

import argparse
import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from posed_map import synthetic_map
from scipy.optimize import minimize

from vnav.config import Config
from vnav.core import se3
from vnav.io.map_folder import MapFolder
from vnav.io.trajectories import read_tum
from vnav.localisation.evidence import LEAST, Odds, _log_beta_binomial, evidence, posterior
from vnav.stages.locate import Locator

SCENES = (("apartment", 200), ("one_room", 100), ("twin_rooms", 240), ("shop", 140))
PHOTOS, SEED = 60, 1
NEAR_M, NEAR_RAD = 0.25, np.deg2rad(10)
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
Cells = NDArray[np.intp]


@dataclass(frozen=True)
class Asked:
    """A photo's hypotheses, the strongest first: their cells (2, C), and which are right."""

    cells: list[Cells]
    right: list[bool]


def asked(
    folder: MapFolder, photos: list[Path], truth: dict[str, NDArray[np.float64]]
) -> list[Asked]:
    """Every photo asked of a map; one without a true pose is from elsewhere."""
    locator, found = Locator(folder, Config()), []
    for photo in photos:
        hypotheses = locator.locate(photo).result.hypotheses
        right = [
            photo.name in truth and near(h.view.T_world_camera, truth[photo.name])
            for h in hypotheses
        ]
        found.append(Asked([h.cells for h in hypotheses], right))
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


def cells_of(photos: list[Asked], right: bool) -> Cells:
    """Cells (2, M) that say anything, of all right or of all wrong hypotheses."""
    cells = [c for p in photos for c, r in zip(p.cells, p.right, strict=True) if r == right]
    joined = np.concatenate(cells, 1)
    return joined[:, joined[1] >= LEAST]


def fitted(known: list[Asked], elsewhere: list[Asked], start: Odds) -> Odds:
    """Shares of landmarks by maximum likelihood, shares of cells by the photos' log loss."""
    k, n = cells_of(elsewhere, False)
    found_if_not = _fitted_beta(start.found_if_not, lambda b: -_log_beta_binomial(k, n, b).mean())
    k, n = cells_of(known, True)

    def mixed(beta: tuple[float, float]) -> float:
        alike, other = (_log_beta_binomial(k, n, b) for b in (beta, found_if_not))
        return float(-np.logaddexp(alike + np.log(0.98), other + np.log(0.02)).mean())

    odds = dataclasses.replace(
        start, found_if_not=found_if_not, found_if_alike=_fitted_beta(start.found_if_alike, mixed)
    )
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


def reliability(photos: list[Asked], odds: Odds) -> str:
    """A table: how many answers of each confidence there are, and how many are right."""
    best = []
    for photo in photos:
        chances = posterior([evidence(c, odds) for c in photo.cells])
        if len(chances):
            k = int(chances.argmax())
            best.append((chances[k], photo.right[k]))
    chance, right = np.array(best).T
    lines = ["| confidence | photos | mean confidence | right |", "|---|---|---|---|"]
    for low, high in zip(BINS, BINS[1:], strict=False):
        within = (chance > low) & (chance <= high)
        if within.any():
            lines.append(
                f"| {low:g} to {high:g} | {within.sum()} | {chance[within].mean():.3f}"
                f" | {right[within].mean():.3f} |"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("bench/confidence"))
    parser.add_argument("--check", nargs=2, type=Path, metavar=("MAP", "CAPTURE"))
    options = parser.parse_args()
    if options.check:
        folder, capture = MapFolder.open(options.check[0]), options.check[1]
        photos = asked(folder, photos_of(capture), true_poses(folder, capture))
        print(reliability(photos, Odds()))
        return
    roots = [options.out / scene for scene, _ in SCENES]
    maps = [
        synthetic_map(root, scene, SEED, frames, PHOTOS)
        for root, (scene, frames) in zip(roots, SCENES, strict=True)
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
    odds = fitted(known, elsewhere, Odds())
    print(odds, f"log loss {log_loss([*known, *elsewhere], odds):.3f} nats", sep="\n")
    print(reliability([*known, *elsewhere], odds))


if __name__ == "__main__":
    main()
