"""How well each tracker finds points again: precision, recall and CPU time a frame.

    python benchmarks/trackers.py [CAPTURE] [--every N] [--record]

Of pairs of frames spread over a capture with truth, neighbours and five frames apart, as `vnav
tracks` compares them: a match is right within 3 px of the reprojection. Shares are of all pairs
together, times are medians. Without a capture: house of ../shared/captures.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from recording import Measurement, add_record_option, conclude

from vnav.api.judging import compare_trackers
from vnav.config import CaptureConfig
from vnav.evaluation.tracker_matches import TrackerMatches, TrackerPair
from vnav.io.sources.open_capture import open_capture

HOUSE = Path(__file__).parents[2] / "shared" / "captures" / "house"
APART = (1, 5)  # frames
FIRST = 2  # frame, before which no two frames show how the camera moves


def pairs(capture: Path, apart: int, every: int) -> list[TrackerPair]:
    """Pairs of frames so far apart, one of every so many frames."""
    count = len(open_capture(capture, CaptureConfig()))
    rows = range(FIRST, count - apart, every)
    return [compare_trackers(capture, row, row + apart) for row in rows]


def of_tracker(on: str, name: str, matches: Sequence[TrackerMatches]) -> list[Measurement]:
    """What one tracker did on all pairs."""
    right = sum(int(m.right.sum()) for m in matches if m.right is not None)
    found = sum(int(m.found.sum()) for m in matches)
    seen = sum(int(np.isfinite(m.true_px[:, 0]).sum()) for m in matches if m.true_px is not None)
    prepare_ms, ms = np.median([(m.prepare_ms, m.ms) for m in matches], 0).tolist()
    return [
        Measurement(on, name, "precision", right / max(found, 1)),
        Measurement(on, name, "recall", right / max(seen, 1)),
        Measurement(on, name, "CPU time for the first frame", prepare_ms, "ms"),
        Measurement(on, name, "CPU time a frame", ms, "ms"),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("capture", nargs="?", type=Path, default=HOUSE, metavar="CAPTURE")
    parser.add_argument("--every", type=int, default=25, metavar="N", help="one pair of N frames")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    found = []
    for apart in APART:
        compared = pairs(asked.capture, apart, asked.every)
        on = f"{asked.capture.name}, {apart} frame{'s' * (apart > 1)} apart, {len(compared)} pairs"
        for n, tracker in enumerate(compared[0].matches):
            found += of_tracker(on, tracker.name, [pair.matches[n] for pair in compared])
    return conclude(f"trackers_{asked.capture.name}", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
