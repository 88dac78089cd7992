"""Recordings that are interrupted for seconds, past what repeats itself and past unlike things.

    python benchmarks/interrupted.py OUT [--scenes library shop] [--seeds 0] [--people 3] [--record]

renders walks of 10 frames a second at 320 x 240 to OUT/captures, takes frames out of them, and maps
what is left up to its poses, to OUT/maps, each once. Some walks end before they come to a place
that was seen before the gap. People may walk about there, who come and leave in the gap, too. A
map's verdict is held against its ATE, as a share of its path. Exit code 1 where a wrong map is
called good.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from hard_versions import Source, write
from people import rendered
from recording import Measurement, add_record_option, conclude, table
from repeating import SCENE_NAMES, spec_of
from verdicts import WRONG, of_verdict, scored_and_doubtful, with_poses

from vnav.config import Config
from vnav.synthetic import CaptureSpec

SCENES = *SCENE_NAMES, "one_room", "apartment"
WIDTH = 320
SHARE = 0.07  # of the pixels that one walker covers


@dataclass(frozen=True)
class Gap:
    """From what share of a walk on frames are lost, for how long, and at what share it ends."""

    start: float
    lost_s: float
    end: float = 1.0

    def __str__(self) -> str:
        end = "" if self.end == 1 else f", ends at {self.end:.0%}"
        return f"{self.lost_s:.0f} s lost from {self.start:.0%} on{end}"

    def taken(self, source: Source, folder: Path) -> Path:
        """The capture without these frames, written where it is not there."""
        if not folder.is_dir():
            since_s = source.stamps_s - source.stamps_s[0]
            start_s = self.start * since_s[-1]
            lost = (since_s >= start_s) & (since_s < start_s + self.lost_s)
            write(source, folder, np.flatnonzero(~lost & (since_s <= self.end * since_s[-1])))
        return folder


GAPS = (
    *(Gap(start, lost_s) for start in (0.3, 0.6) for lost_s in (1.0, 3.0)),
    *(Gap(0.3, lost_s, 0.6) for lost_s in (1.0, 3.0)),
)


def walk(scene: str, seed: int, people: int) -> CaptureSpec:
    """A whole walk, among so many people."""
    return replace(spec_of(scene, seed, WIDTH), walkers=people, walker_share=SHARE * people)


def of_gap(on: str, capture: Path, map_of: Path) -> Iterator[Measurement]:
    """One recording: its map against the truth, and what the map says of itself."""
    config = Config()
    found, doubtful = scored_and_doubtful(capture, with_poses(capture, map_of, config), config)
    frames = len(Source.open(capture).frames)
    off_m, path_m = found.ate.translation_m.rmse, found.paths_m[0]
    yield Measurement(on, "vnav", "frames", frames)
    yield Measurement(on, "vnav", "frames with a pose", found.pairs)
    yield Measurement(on, "vnav", "ATE RMSE", off_m, "m")
    yield from of_verdict(on, "vnav", off_m, WRONG * path_m, doubtful)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--people", type=int, default=0, help="who walk about there")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    captures, maps = asked.out / "captures", asked.out / "maps"
    for folder in (captures, maps):
        folder.mkdir(parents=True, exist_ok=True)
    found: list[Measurement] = []
    for scene, seed in product(asked.scenes, asked.seeds):
        among = f", {asked.people} people" if asked.people else ""
        whole = captures / f"{scene}{among.replace(', ', '_').replace(' ', '_')}_seed{seed}"
        source = Source.open(rendered(whole, walk(scene, seed, asked.people)))
        for n, gap in enumerate(GAPS):
            name = f"{whole.name}_gap{n}"
            capture = gap.taken(source, captures / name)
            found += of_gap(f"{scene}{among}, seed {seed}, {gap}", capture, maps / name)
            print(f"{table(found)}\n", flush=True)
    record = "interrupted_among_people" if asked.people else "interrupted"
    return conclude(record, found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
