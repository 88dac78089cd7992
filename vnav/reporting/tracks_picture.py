"""A picture of what trackers find: both frames side by side for each, and lines between."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.frame import Frame
from vnav.evaluation.tracker_matches import TrackerMatches, TrackerPair
from vnav.reporting.inset import GREEN, RED
from vnav.reporting.picture_file import write_picture
from vnav.reporting.picture_legend import LINE, LegendEntry, with_legend

BLUE, WHITE = (255, 150, 60), (255, 255, 255)  # BGR
TITLE_PX = 28


def draw(pair: TrackerPair, path: Path) -> None:
    """Write a picture: green right, red wrong, blue where no truth is known.

    VnavError where it cannot be written.
    """
    rows = np.concatenate([_row(m, pair.a, pair.b) for m in pair.matches])
    is_judged = any(matches.right is not None for matches in pair.matches)
    judged = [LegendEntry(LINE, GREEN, "right"), LegendEntry(LINE, RED, "wrong")]
    unjudged = [LegendEntry(LINE, BLUE, "found; what is right is not known")]
    write_picture(path, with_legend(rows, judged if is_judged else unjudged), "--png")


def _row(matches: TrackerMatches, a: Frame, b: Frame) -> NDArray[np.uint8]:
    """One tracker's matches (H, 2 W, 3), under its name."""
    pair = np.concatenate([a.color, b.color], 1)
    canvas = np.array(cv2.cvtColor(pair, cv2.COLOR_RGB2BGR) // 2)
    beside, right = np.array([a.color.shape[1], 0]), matches.right
    for n in np.flatnonzero(matches.found):
        color = BLUE if right is None else GREEN if right[n] else RED
        start, end = matches.px[n], matches.found_px[n] + beside
        ends = [tuple(int(x) for x in np.rint(p)) for p in (start, end)]
        cv2.line(canvas, ends[0], ends[1], color, 1, cv2.LINE_AA)
    title = np.zeros((TITLE_PX, canvas.shape[1], 3), np.uint8)
    cv2.putText(title, _title(matches), (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.6, WHITE, 1)
    return np.concatenate([title, canvas])


def _title(matches: TrackerMatches) -> str:
    told = f"{matches.name}: {matches.found.sum()} of {len(matches.px)} found"
    right = matches.right
    return told if right is None else f"{told}, {right.sum()} right"
