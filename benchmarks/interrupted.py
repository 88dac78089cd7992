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
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TypeVar

import numpy as np
from hard_versions import Source, write
from people import rendered
from recording import Measurement, add_record_option, conclude, table
from repeating import SCENE_NAMES, spec_of
from verdicts import WRONG, of_verdict, scored_and_doubtful, with_poses

from vnav.config import Config
from vnav.evaluation.score import Score
from vnav.synthetic import CaptureSpec

SCENES = *SCENE_NAMES, "one_room", "apartment"
WIDTH = 320
CaseT = TypeVar("CaseT")
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


def of_gap(on: str, source: Source, gap: Gap, folder: Path, map_of: Path) -> Iterator[Measurement]:
    """A recording without some frames: its map, and what that says of itself."""
    capture, config = gap.taken(source, folder), Config()
    found, doubtful = scored_and_doubtful(capture, with_poses(capture, map_of, config), config)
    yield from of_map(on, [capture], found, doubtful)


def of_map(
    on: str, captures: Sequence[Path], found: Score, doubtful: bool
) -> Iterator[Measurement]:
    """A map of captures: its score against the truth, and what it says of itself."""
    off_m, path_m = found.ate.translation_m.rmse, sum(found.paths_m)
    frames = sum(len(Source.open(capture).frames) for capture in captures)
    yield Measurement(on, "vnav", "frames", frames)
    yield Measurement(on, "vnav", "frames with a pose", found.pairs)
    yield Measurement(on, "vnav", "ATE RMSE", off_m, "m")
    yield from of_verdict(on, "vnav", off_m, WRONG * path_m, doubtful)


def parser_of(description: str) -> argparse.ArgumentParser:
    """What is asked of benchmarks of walks that are rendered by this script."""
    parser = argparse.ArgumentParser(description=description.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--people", type=int, default=0, help="who walk about there")
    add_record_option(parser)
    return parser


def measured(
    asked: argparse.Namespace,
    cases: Sequence[CaseT],
    kind: str,
    measure: Callable[[str, Source, CaseT, Path, Path], Iterable[Measurement]],
) -> list[Measurement]:
    """What is measured of each case of each walk, by its name, capture and map; shown as it grows.

    The files of a case have the number and ``kind`` of it in their names.
    """
    captures, maps = asked.out / "captures", asked.out / "maps"
    for folder in (captures, maps):
        folder.mkdir(parents=True, exist_ok=True)
    found: list[Measurement] = []
    for scene, seed in product(asked.scenes, asked.seeds):
        among = f", {asked.people} people" if asked.people else ""
        whole = captures / f"{scene}{among.replace(', ', '_').replace(' ', '_')}_seed{seed}"
        source = Source.open(rendered(whole, walk(scene, seed, asked.people)))
        for n, case in enumerate(cases):
            name = f"{whole.name}_{kind}{n}"
            on = f"{scene}{among}, seed {seed}, {case}"
            found += measure(on, source, case, captures / name, maps / name)
            print(f"{table(found)}\n", flush=True)
    return found


def record_of(name: str, asked: argparse.Namespace) -> str:
    """The name of the record: walks among people have one of their own."""
    return f"{name}_among_people" if asked.people else name


def main(arguments: Sequence[str] | None = None) -> int:
    asked = parser_of(__doc__).parse_args(arguments)
    found = measured(asked, GAPS, "gap", of_gap)
    return conclude(record_of("interrupted", asked), found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
