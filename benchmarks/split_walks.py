"""One walk as two recordings that are joined into one map, past what repeats itself and not.

    python benchmarks/split_walks.py OUT [--scenes library shop] [--seeds 0] [--record]

renders walks of 10 frames a second at 320 x 240 to OUT/captures, takes two recordings out of each,
and maps both together to OUT/maps, each once. Either the second begins where the first ends, or a
tenth of the walk is in both. A map's verdict is held against its ATE, as a share of its path. Exit
code 1 where a wrong map is called good.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np
from hard_versions import Source, write
from interrupted import SCENES, WIDTH
from people import rendered
from recording import Measurement, add_record_option, conclude, table
from repeating import spec_of
from verdicts import WRONG, is_doubtful, of_verdict
from wings import built, scored

from vnav.io.store.map_folder import MapFolder

SPLITS = {
    "the second begins where the first ends": ((0.0, 0.5), (0.5, 1.0)),
    "a tenth is in both": ((0.0, 0.55), (0.45, 1.0)),
}


def parts(source: Source, split: Sequence[tuple[float, float]], folder: Path) -> list[Path]:
    """The recordings, from one share of the walk to another, written where they are not there."""
    count, found = len(source.frames), []
    for number, (start, end) in enumerate(split):
        part = folder.with_name(f"{folder.name}_{number}")
        if not part.is_dir():
            write(source, part, np.arange(round(start * count), round(end * count)))
        found.append(part)
    return found


def of_parts(on: str, captures: Sequence[Path], folder: Path) -> Iterator[Measurement]:
    """Two recordings: the map of both against the truth, and what it says of itself."""
    if not folder.is_dir():
        built(folder, *captures)
    found = scored(folder, captures)
    off_m, path_m = found.ate.translation_m.rmse, sum(found.paths_m)
    frames = sum(len(Source.open(capture).frames) for capture in captures)
    yield Measurement(on, "vnav", "frames", frames)
    yield Measurement(on, "vnav", "frames with a pose", found.pairs)
    yield Measurement(on, "vnav", "ATE RMSE", off_m, "m")
    yield from of_verdict(on, "vnav", off_m, WRONG * path_m, is_doubtful(MapFolder.open(folder)))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    captures, maps = asked.out / "captures", asked.out / "maps"
    for folder in (captures, maps):
        folder.mkdir(parents=True, exist_ok=True)
    found: list[Measurement] = []
    for scene, seed in product(asked.scenes, asked.seeds):
        whole = captures / f"{scene}_seed{seed}"
        source = Source.open(rendered(whole, spec_of(scene, seed, WIDTH)))
        for number, (how, split) in enumerate(SPLITS.items()):
            name = f"{whole.name}_split{number}"
            taken = parts(source, split, captures / name)
            found += of_parts(f"{scene}, seed {seed}, {how}", taken, maps / name)
            print(f"{table(found)}\n", flush=True)
    return conclude("split_walks", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
