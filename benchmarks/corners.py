"""What the edge rule and the non-maxima of improved FAST leave of its corners [000 section 1].

    python benchmarks/corners.py CAPTURE... [--every 10] [--record]

Of every tenth frame and the one after it: corners, the processor's time to find them, and to find
and describe them, and how many are found again within 2 px of where true pose and depth put
them in the next frame. Many corners are found again by chance: that share is told by places 8 px
beside the right ones. 000 reports 4704 corners before and 1526 after, in 33 and in 16 ms.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from masks import poses_of
from numpy.typing import NDArray
from recording import Measurement, add_record_option, conclude
from scipy.spatial import cKDTree

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.descriptor_space import UNDESCRIBED
from vnav.core.frame import Frame
from vnav.features.fast import BRIEF_BYTES, PATCH_PX
from vnav.features.keypoints import RESPONSE, SIZE, described
from vnav.features.segment_test import corners, strengths
from vnav.io.sources.open_capture import open_capture

THRESHOLD, ARC, EDGE_LIMIT, NO_LIMIT = 20, 9, 10, 16
AGAIN_PX, BESIDE_PX = 2.0, 8.0
SAME_SURFACE = 0.02  # of the depth
Places = NDArray[np.float64]
Found = tuple[Places, NDArray[np.float32]]  # x and y (N, 2), strength (N,)


def all_of(gray: NDArray[np.uint8], edge_limit: int) -> Found:
    """Every pixel that is a corner: no non-maxima are left out."""
    strength = strengths(gray, THRESHOLD, ARC, edge_limit)
    rows, columns = np.nonzero(strength)
    return np.stack([columns, rows], 1).astype(float), strength[rows, columns]


def strongest_of(gray: NDArray[np.uint8], edge_limit: int) -> Found:
    """Those that are the strongest of 3 x 3 pixels."""
    px, strength = corners(gray, THRESHOLD, ARC, edge_limit)
    return px.astype(float), strength


WAYS: dict[str, Callable[[NDArray[np.uint8]], Found]] = {
    "before": lambda gray: all_of(gray, NO_LIMIT),
    "edge rule alone": lambda gray: all_of(gray, EDGE_LIMIT),
    "non-maxima alone": lambda gray: strongest_of(gray, NO_LIMIT),
    "after": lambda gray: strongest_of(gray, EDGE_LIMIT),
}


def describe(gray: NDArray[np.uint8], found: Found) -> None:
    """BRIEF of each corner, as the front-end takes it."""
    table = np.zeros((len(found[0]), 6))
    table[:, :2], table[:, RESPONSE], table[:, SIZE] = found[0], found[1], PATCH_PX
    described(
        cv2.xfeatures2d.BriefDescriptorExtractor.create(BRIEF_BYTES), gray, table, UNDESCRIBED
    )


def carried(px: Places, a: Frame, b: Frame, T_a_b: NDArray[np.float64]) -> Places:
    """Where b shows what a shows at pixels (N, 2), of those (M, 2) that it shows."""
    z = _depth(a, px)
    points = a.intrinsics.unproject(px[z > 0], z[z > 0])
    points_b = se3.transform(se3.inverse(T_a_b), points)
    seen = b.intrinsics.project(points_b)
    inside = _inside(seen, b.intrinsics)
    seen, depth = seen[inside], points_b[inside, 2]
    return seen[np.abs(_depth(b, seen) - depth) < SAME_SURFACE * depth]


def _depth(frame: Frame, px: Places) -> NDArray[np.float64]:
    x, y = np.rint(px).astype(int).T
    return frame.depth_m[y, x].astype(float)


def _inside(px: Places, camera: Intrinsics) -> NDArray[np.bool_]:
    limit = np.array(camera.size) - 4
    return np.asarray((np.isfinite(px) & (px > 3) & (px < limit)).all(1))


def again(expected: Places, found: Places) -> tuple[float, float]:
    """Shares of expected places that hold a corner: the right ones, and those beside them."""
    if not len(expected) or not len(found):
        return 0.0, 0.0
    tree = cKDTree(found)
    turns = np.random.default_rng(0).uniform(0, 2 * np.pi, len(expected))
    beside = expected + BESIDE_PX * np.stack([np.cos(turns), np.sin(turns)], 1)
    right, chance = ((tree.query(p)[0] <= AGAIN_PX).mean() for p in (expected, beside))
    return float(right), float(chance)


def measure(folder: Path, every: int) -> list[Measurement]:
    """Means over pairs of neighbouring frames with true poses."""
    capture = open_capture(folder, Config().capture)
    poses = poses_of(capture, folder, None)
    rows = [k for k in range(0, len(capture) - 1, every) if k in poses and k + 1 in poses]
    values: dict[str, list[tuple[float, ...]]] = {way: [] for way in WAYS}
    for k in rows:
        a, b = capture.read(k), capture.read(k + 1)
        gray_a, gray_b = (cv2.cvtColor(f.color, cv2.COLOR_RGB2GRAY) for f in (a, b))
        for way, find in WAYS.items():
            started = time.thread_time()
            found = find(gray_a)
            after_finding = time.thread_time()
            describe(gray_a, found)
            seconds = after_finding - started, time.thread_time() - started
            expected = carried(found[0], a, b, se3.inverse(poses[k]) @ poses[k + 1])
            shares = again(expected, find(gray_b)[0])
            values[way].append((len(found[0]), *(1000 * s for s in seconds), *shares))
    return [m for way in WAYS for m in _means(folder.name, way, values[way])]


def _means(on: str, way: str, rows: Sequence[tuple[float, ...]]) -> list[Measurement]:
    count, find_ms, both_ms, right, chance = np.mean(rows, 0).tolist()
    return [
        Measurement(on, way, "corners a frame", round(count)),
        Measurement(on, way, "found in", find_ms, "ms"),
        Measurement(on, way, "found and described in", both_ms, "ms"),
        Measurement(on, way, "found again", 100 * right, "%"),
        Measurement(on, way, "found again by chance", 100 * chance, "%"),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("captures", type=Path, nargs="+", metavar="CAPTURE")
    parser.add_argument("--every", type=int, default=10, help="frames from pair to pair")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    for find in WAYS.values():  # compiled once
        find(np.zeros((16, 16), np.uint8))
    found = [m for capture in asked.captures for m in measure(capture, asked.every)]
    return conclude("corners", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
