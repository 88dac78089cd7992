"""Maps of rooms by a sensor whose depth ends before the walls, beside those by a Kinect.

    python benchmarks/short_range.py OUT [--seeds 0 1] [--peer NAME=DIR] [--record]

renders captures to OUT/captures and maps them to OUT/maps, each once. Both sensors are the same but
for their range. A DIR of a peer has its trajectories of the same captures, as CAPTURE.tum. Exit
code 1 where something wanted is missed.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from accuracy import built
from people import of_trajectory, peer, rendered
from recording import Measurement, add_record_option, conclude
from verdicts import is_doubtful, of_verdict

from vnav.io.store.map_folder import MapFolder
from vnav.synthetic import DEMO, HANDHELD, CaptureSpec, Sensor

WALKS = {  # and how far the sensor sees, in metres
    "one_room": (replace(DEMO, scene="one_room", frames=150), 2.5),
    "one_room, people": (replace(DEMO, scene="one_room", frames=150, walkers=3), 2.5),
    "apartment": (replace(DEMO, frames=150), 2.0),
    "library": (replace(DEMO, scene="library", frames=150), 2.0),
    "handheld": (replace(HANDHELD, frames=150), 2.5),
}
MOST_M = 0.01  # of a map's error
KINECT_M = Sensor().max_depth_m


def ranged(spec: CaptureSpec, seed: int, range_m: float) -> CaptureSpec:
    """The walk of a seed, seen so far."""
    return replace(spec, seed=seed, sensor=replace(spec.sensor, max_depth_m=range_m))


def with_depth(capture: Path) -> float:
    """Share of a capture's pixels that have depth; the median over every tenth frame."""
    files = sorted((capture / "depth").iterdir())[::10]
    return float(np.median([(cv2.imread(str(f), cv2.IMREAD_UNCHANGED) > 0).mean() for f in files]))


def held_to(found: Sequence[Measurement]) -> list[Measurement]:
    """What was found, with the error that is allowed."""
    limit = f"at most {MOST_M:g}"
    return [replace(m, wanted=limit) if m.quantity == "ATE RMSE" else m for m in found]


def walked(
    out: Path, name: str, seed: int, range_m: float, peers: Sequence[tuple[str, Path]]
) -> Iterator[Measurement]:
    """One walk by one sensor: its map, and what peers made of it."""
    on = f"{name}, seed {seed}, {range_m:g} m"
    folder = on.replace(", ", "_").replace(" ", "_")
    capture = rendered(out / "captures" / folder, ranged(WALKS[name][0], seed, range_m))
    map_of = out / "maps" / folder
    built(capture, map_of)
    yield Measurement(on, "vnav", "pixels with depth", with_depth(capture))
    file = map_of / "optimise" / "trajectory_0.tum"
    found = held_to(of_trajectory(on, "vnav", capture, file)[0])
    yield from found
    doubtful = is_doubtful(MapFolder(map_of))
    yield from of_verdict(on, "vnav", found[-1].value, MOST_M, doubtful)
    for peer_name, trajectories in peers:
        if (trajectories / f"{folder}.tum").is_file():
            yield from of_trajectory(on, peer_name, capture, trajectories / f"{folder}.tum")[0]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--peer", type=peer, action="append", default=[], metavar="NAME=DIR")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    for name in ("captures", "maps"):
        (asked.out / name).mkdir(parents=True, exist_ok=True)
    found = [
        measurement
        for name, (_, range_m) in WALKS.items()
        for seed in asked.seeds
        for sees_m in (KINECT_M, range_m)
        for measurement in walked(asked.out, name, seed, sees_m, asked.peer)
    ]
    return conclude("short_range", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
