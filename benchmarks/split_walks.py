"""One walk as two recordings that are joined into one map, past what repeats itself and not.

    python benchmarks/split_walks.py OUT [--scenes library shop] [--seeds 0] [--people 3] [--record]

renders walks of 10 frames a second at 320 x 240 to OUT/captures, takes two recordings out of each,
and maps both together to OUT/maps, each once. Either the second begins where the first ends, or a
tenth of the walk is in both. A map's verdict is held against its ATE, as a share of its path. Exit
code 1 where a wrong map is called good.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hard_versions import Source, write
from interrupted import measured, of_map, parser_of, record_of
from recording import Measurement, conclude
from verdicts import is_doubtful
from wings import built, scored

from vnav.io.store.map_folder import MapFolder


@dataclass(frozen=True)
class Split:
    """How two recordings are taken out of a walk: its shares that each begins and ends at."""

    how: str
    shares: tuple[tuple[float, float], tuple[float, float]]

    def __str__(self) -> str:
        return self.how

    def taken(self, source: Source, folder: Path) -> list[Path]:
        """The recordings, beside ``folder``, written where they are not there."""
        count, found = len(source.frames), []
        for number, (start, end) in enumerate(self.shares):
            part = folder.with_name(f"{folder.name}_{number}")
            if not part.is_dir():
                write(source, part, np.arange(round(start * count), round(end * count)))
            found.append(part)
        return found


SPLITS = (
    Split("the second begins where the first ends", ((0.0, 0.5), (0.5, 1.0))),
    Split("a tenth is in both", ((0.0, 0.55), (0.45, 1.0))),
)


def of_split(
    on: str, source: Source, split: Split, folder: Path, map_of: Path
) -> Iterator[Measurement]:
    """Two recordings: the map of both, and what that says of itself."""
    captures = split.taken(source, folder)
    if not map_of.is_dir():
        built(map_of, *captures)
    yield from of_map(on, captures, scored(map_of, captures), is_doubtful(MapFolder.open(map_of)))


def main(arguments: Sequence[str] | None = None) -> int:
    asked = parser_of(__doc__).parse_args(arguments)
    found = measured(asked, SPLITS, "split", of_split)
    return conclude(record_of("split_walks", asked), found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
