"""How well what moves is masked: by the truth of rendered walkers, and where nothing moves.

    python benchmarks/masks.py CAPTURE... [--maps DIR] [--set masking.warp=homography]

A capture with truth/masks is held against the pixels of the walkers who move within 3 s before or
after; of any other, in which nothing moves, the share that is masked all the same is told. Poses
are the true ones, or those of the map DIR/NAME where it is there. "in the end": every frame is
taken for a keyframe, whose mask the frames before and after decide; "at once": the mask that
tracking has, by the frames before.
Exit code 1 where a bound of the documentation is missed.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from recording import Measurement, add_record_option, conclude

from vnav.config import Config, load
from vnav.core.arrays import Array
from vnav.core.association import associate
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import ReducedFrame, in_pixels
from vnav.features.sift import SPACE
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture, read_truth
from vnav.registration.reduction import reduced
from vnav.synthetic.masks import read_moving_masks
from vnav.tracking.frame_masks import FrameMasks
from vnav.tracking.pose_choice import TrackedFrame

Pixels = NDArray[np.bool_]
NO_FEATURES = Features(np.zeros((0, 2)), SPACE.none(), *np.zeros((3, 0)), SPACE)
IOU, RECALL, MEAN_SHARE, MOST_SHARE = 0.6, 0.8, 0.01, 0.1  # that are wanted


@dataclass
class Masks:
    """Masks by row, decided by the frames before, and by those after, too; seconds a frame."""

    at_once: dict[int, Pixels] = field(default_factory=dict)
    in_the_end: dict[int, Pixels] = field(default_factory=dict)
    seconds: list[float] = field(default_factory=list)


def masks_of(capture: Capture, poses: dict[int, Array], config: Config) -> Masks:
    """Of every frame with a pose, as if each became a keyframe."""
    frame_masks, masks = FrameMasks(config), Masks()
    shape = capture.camera.color.size[::-1]
    for row, small in _reduced_frames(capture, sorted(poses)):
        features = FrameFeatures(row, NO_FEATURES, np.zeros((0, 3)))
        frame = TrackedFrame(features, small, capture.camera.color)
        started = time.perf_counter()
        seen = frame_masks.look(frame, poses[row])
        masks.seconds.append(time.perf_counter() - started)
        frame_masks.add(seen, poses[row], is_keyframe=True)
        masks.at_once[row] = in_pixels(seen.moving, shape)
    frame_masks.restart()
    moving = frame_masks.moving
    none = np.zeros(shape, bool)
    masks.in_the_end = {k: in_pixels(moving[k], shape) if k in moving else none for k in poses}
    return masks


def _reduced_frames(capture: Capture, rows: Sequence[int]) -> Iterator[tuple[int, ReducedFrame]]:
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield from zip(rows, pool.map(lambda k: reduced(capture.read(k)), rows), strict=True)


def poses_of(capture: Capture, folder: Path, maps: Path | None) -> dict[int, Array]:
    """Poses by row, of the frames that have one."""
    config = Config().capture
    mapped = maps / folder.name / "optimise" / "trajectory_0.tum" if maps else folder
    given = read_truth(mapped if mapped.is_file() else folder, config)
    pairs = associate(capture.stamps_s, given.stamps_s, config.association_s)
    return {int(row): given.T_world_camera[k] for row, k in pairs}


def against_truth(
    name: str, what: str, found: dict[int, Pixels], truth: Sequence[Pixels]
) -> Iterator[Measurement]:
    """Intersection over union, and the share of what moves that is masked, over all frames."""
    both = sum(int((mask & truth[row]).sum()) for row, mask in found.items())
    either = sum(int((mask | truth[row]).sum()) for row, mask in found.items())
    true = sum(int(truth[row].sum()) for row in found)
    wanted = what == "in the end"
    yield Measurement(name, what, "moving", true / sum(m.size for m in found.values()))
    for quantity, value, least in (
        ("IoU", both / max(either, 1), IOU),
        ("recall", both / max(true, 1), RECALL),
    ):
        yield Measurement(name, what, quantity, value, "", f"at least {least}" if wanted else None)


def without_truth(name: str, what: str, found: Iterable[Pixels]) -> Iterator[Measurement]:
    """The shares that are masked where nothing moves."""
    shares = [float(mask.mean()) for mask in found]
    yield Measurement(
        name, what, "masked, mean", float(np.mean(shares)), "", f"at most {MEAN_SHARE}"
    )
    yield Measurement(name, what, "masked, most", max(shares), "", f"at most {MOST_SHARE}")


def measure(folder: Path, maps: Path | None, config: Config) -> Iterator[Measurement]:
    capture = open_capture(folder, config.capture)
    masks = masks_of(capture, poses_of(capture, folder, maps), config)
    walkers = folder / "truth" / "masks"
    truth = read_moving_masks(folder / "truth") if walkers.is_dir() else None
    for what, found in (("at once", masks.at_once), ("in the end", masks.in_the_end)):
        if truth is None:
            yield from without_truth(folder.name, what, found.values())
        else:
            yield from against_truth(folder.name, what, found, truth)
    time_ms = 1000 * float(np.median(masks.seconds))
    yield Measurement(folder.name, "at once", "time a frame", time_ms, "ms")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("captures", nargs="+", type=Path)
    parser.add_argument("--maps", type=Path, help="whose poses are taken, not the true ones")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    config = load(settings=asked.set)
    found = [m for path in asked.captures for m in measure(path, asked.maps, config)]
    return conclude("masks", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
