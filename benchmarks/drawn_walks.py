"""Recordings whose scene, way, camera, sensor and company are all drawn at once, by seed.

    python benchmarks/drawn_walks.py OUT [--first 0] [--walks 20] [--config fast] [--record]

Other benchmarks vary one thing, and what falls between them no one sees. This one renders captures
to OUT/captures and maps them by `vnav build-map` to OUT/maps, or to one named as the preset is,
each once. It scores the trajectory and asks the map for photos. Exit code 1 where a wrong map is
called good, or a photo's place is wrong.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from accuracy import NOT_LOCATED, built, errors, frames_of, photos_found, poses_in, vnav
from among_people import MOST_M
from people import of_grid, rendered
from recording import Measurement, add_record_option, conclude
from verdicts import MAX_DIFFERENCE_S, WRONG, is_doubtful, of_verdict

from vnav.core import se3
from vnav.core.association import associate
from vnav.errors import CaptureError
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.map_folder import MapFolder
from vnav.synthetic import SCENES, CaptureSpec, Sensor
from vnav.synthetic.path import frames_at
from vnav.synthetic.rendered_capture import KINECT, PHONE, with_walkers
from vnav.synthetic.staying import MOTIONS
from vnav.synthetic.things import THINGS

PLACES = (
    *("one_room", "apartment", "room_before", "two_storeys", "building_2"),
    *("twin_rooms", "shop", "library", "supermarket"),
)
WIDTHS = 320, 424, 640
MOST_FRAMES = 600
STAYING_FRAMES = 300
PHOTOS = 8
TRAJECTORY = "optimise/trajectory_0.tum"  # of a map

Rng = np.random.Generator


def drawn(seed: int) -> CaptureSpec:
    """What one seed asks for."""
    rng = np.random.default_rng([seed, 90])
    return with_company(with_way(bare(rng, seed), rng), rng)


def spec_of(seed: int) -> CaptureSpec:
    """What is recorded by one seed."""
    return with_room(drawn(seed))


def with_room(spec: CaptureSpec) -> CaptureSpec:
    """The same with fewer people, where so many cannot be in view."""
    while spec.walkers:
        try:
            with_walkers(SCENES[spec.scene](spec.seed), spec)
        except CaptureError:
            spec = replace(spec, walkers=spec.walkers - 1, walker_share=spec.walker_share / 2)
        else:
            break
    return spec


def bare(rng: Rng, seed: int) -> CaptureSpec:
    """A place, a camera and its sensor; no frames yet."""
    width = int(rng.choice(WIDTHS))
    camera = KINECT.scaled(width, 3 * width // 4)
    wider = rng.uniform(0.75, 1.15)
    camera = replace(camera, fx=camera.fx * wider, fy=camera.fy * wider)
    return CaptureSpec(
        str(rng.choice(PLACES)), 0, PHOTOS, camera, PHONE, seed=seed, sensor=sensor_of(rng)
    )


def sensor_of(rng: Rng) -> Sensor:
    """Noise, range, light and delays; half of the sensors expose all at once."""
    delays = dict.fromkeys(("exposure_s", "line_delay_s", "depth_delay_s"), 0.0)
    if rng.random() < 0.5:
        seconds = rng.uniform([0.002, 0, -0.01], [0.012, 6e-5, 0.03]).tolist()
        delays = dict(zip(delays, seconds, strict=True))
    return Sensor(
        max_depth_m=rng.uniform(3.5, 8),
        depth_sigma_per_m2=0.0015 * 2 ** rng.uniform(-1, 1),
        edge_loss=rng.uniform(0.3, 1),
        color_sigma=rng.uniform(1, 5),
        gain_drift=float(rng.choice([0.06, 0.25])),
        jpeg_quality=int(rng.integers(60, 96)),
        **delays,
    )


def with_way(spec: CaptureSpec, rng: Rng) -> CaptureSpec:
    """Round the place by foot or on a robot, with or without pans; or about where a tour begins."""
    rate_hz, speed_m_s = float(rng.choice([10, 15, 30])), rng.uniform(0.4, 1.0)
    spec = replace(
        spec,
        rate_hz=rate_hz,
        height_m=rng.uniform(0.4, 1.7),
        pitch_deg=rng.uniform(-30, 0),
        pan_deg=float(rng.choice([0, rng.uniform(10, 35)])),
        pan_s=rng.uniform(1.5, 4),
        uneven=float(rng.choice([0, rng.uniform(0.2, 0.5)])),
    )
    if rng.random() < 0.15:
        frames = round(STAYING_FRAMES * rate_hz / 30)
        return replace(spec, motion=str(rng.choice(list(MOTIONS))), frames=frames)
    frames = frames_at(speed_m_s / rate_hz, SCENES[spec.scene](spec.seed).tour)
    slower = min(MOST_FRAMES / frames, 1)
    return replace(spec, frames=round(slower * frames), rate_hz=slower * rate_hz)


def with_company(spec: CaptureSpec, rng: Rng) -> CaptureSpec:
    """People in half of the recordings, a thing that moves in a seventh."""
    if rng.random() < 0.5:
        walkers = int(rng.integers(1, 5))
        spec = replace(spec, walkers=walkers, walker_share=walkers * rng.uniform(0.04, 0.09))
    return replace(spec, thing=str(rng.choice(list(THINGS))) if rng.random() < 0.15 else "")


def told(spec: CaptureSpec) -> str:
    """A recording in few words."""
    delays = spec.sensor.depth_delay_s, spec.sensor.line_delay_s
    parts = [
        f"{spec.scene}, {spec.camera.width} px, {spec.rate_hz:.0f} Hz",
        spec.motion,
        f"pans {spec.pan_deg:.0f} deg" if spec.pan_deg and not spec.motion else "",
        f"{spec.walkers} people {spec.walker_share:.0%}" if spec.walkers else "",
        spec.thing,
        f"depth {1e3 * delays[0]:.0f} ms late" if any(delays) else "",
    ]
    return ", ".join(filter(None, parts))


def T_truth_world(capture: Path, file: Path) -> np.ndarray:
    """Of a camera that stays (4, 4), whose positions tell no turn: by its pose amid all others."""
    found, truth = read_tum(file), read_tum(capture / "groundtruth.txt")
    estimated, true = associate(found.stamps_s, truth.stamps_s, MAX_DIFFERENCE_S).T
    T = truth.T_world_camera[true] @ se3.inverse(found.T_world_camera[estimated])
    off_rad = [np.median(se3.rotation_angle(se3.inverse(one) @ T)) for one in T]
    return np.asarray(T[np.argmin(off_rad)])


def folders(out: Path, seed: int, config: str) -> tuple[Path, Path]:
    """Of a recording and of its map; what they lie in is made."""
    found = out / "captures" / f"{seed}", out / (config or "maps") / f"{seed}"
    for folder in found:
        folder.parent.mkdir(parents=True, exist_ok=True)
    return found


def built_of(capture: Path, map_of: Path, config: str) -> dict[str, Any]:
    """The score of a recording's map by a preset; the map is made where it is not there."""
    built(capture, map_of, *(["--config", config] if config else []))
    return vnav("score", map_of / TRAJECTORY, capture / "groundtruth.txt")


def of_poses(
    on: str, what: str, spec: CaptureSpec, capture: Path, map_of: Path, score: dict[str, Any]
) -> Iterator[Measurement]:
    """A map's poses against the truth, and what the map says of itself."""
    off_m, wrong_m = score["ate_m"]["rmse"], WRONG * score["path_truth_m"]
    if spec.motion:
        wrong_m = max(wrong_m, MOST_M)
    yield Measurement(on, what, "frames", frames_of(capture))
    yield Measurement(on, what, "frames with a pose", poses_in(map_of / TRAJECTORY))
    yield Measurement(on, what, "ATE RMSE", off_m, "m")
    yield from of_verdict(on, what, off_m, wrong_m, is_doubtful(MapFolder(map_of)))


def measured(seed: int, out: Path, config: str) -> Iterator[Measurement]:
    """One recording: its map against the truth, and what the map says of itself."""
    spec = spec_of(seed)
    on, what = f"{seed}: {told(spec)}", f"vnav {config}".strip()
    folder, map_of = folders(out, seed, config)
    capture = rendered(folder, spec)
    score = built_of(capture, map_of, config)
    yield from of_poses(on, what, spec, capture, map_of, score)
    moving = MapFolder(map_of).report("odometry")["values"]["moving"]["mean"]
    yield Measurement(on, what, "masked", 100 * moving, "%")
    stays, truth = bool(spec.motion), score["T_truth_world"]
    aligned = T_truth_world(capture, map_of / TRAJECTORY) if stays else np.array(truth)
    yield of_grid(on, what, capture, map_of, aligned)
    answers = vnav("locate", capture / "photos", "--map", map_of, expected=(0, NOT_LOCATED))
    off = errors(answers, capture / "photos", aligned)
    yield from photos_found(on, len(answers), off)


def run(
    name: str,
    about: str,
    measure: Callable[[int, Path, str], Iterator[Measurement]],
    arguments: Sequence[str] | None,
    walks: int,
) -> int:
    """Measure recordings, one after the other, by their seeds; the exit code."""
    parser = argparse.ArgumentParser(description=about.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--first", type=int, default=0, help="seed")
    parser.add_argument("--walks", type=int, default=walks)
    parser.add_argument("--config", default="", help="a preset; the default without")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    seeds = range(asked.first, asked.first + asked.walks)
    found = [m for seed in seeds for m in measure(seed, asked.out, asked.config)]
    return conclude("_".join(filter(None, (name, asked.config))), found, asked, arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    return run("drawn_walks", __doc__, measured, arguments, 20)


if __name__ == "__main__":
    sys.exit(main())
