"""Recordings that begin among people, those by a camera that stays, and those among things.

    python benchmarks/among_people.py OUT [--scenes one_room apartment] [--seeds 2] [--record]

renders the walks past 35 % people that people.py takes to OUT/captures, once, and maps four
stretches of each up to its poses. Somebody who stands still when a stretch begins has never been
seen to move. ATE is told as a share of the way. Then come the motions of TUM's recordings of
walking people, in one_room at 30 Hz, where three people cover half of the view, and at times four
fifths; and things that move as a whole before a camera on a halfsphere and before one that walks.
Exit code 1 where a frame is lost, a camera that stays is off by more than `MOST_M`, or a map that
is wrong, by that or by verdicts.py's measure, is not called doubtful.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from shutil import copy

from accuracy import poses_in
from people import FRAMES, name_of, rendered, spec_of
from recording import Measurement, add_record_option, conclude
from verdicts import WRONG, of_verdict, scored_and_doubtful, share_off, with_poses

import vnav
from vnav.config import Config
from vnav.synthetic import CaptureSpec
from vnav.synthetic.staying import MOTIONS
from vnav.synthetic.things import THINGS

SHARE = 0.35  # of the pixels
STRETCHES = 4  # of a walk, which overlap
MOST_M = 0.01  # published results on TUM's recordings are 0.006 m and more
LISTS = "rgb.txt", "depth.txt", "groundtruth.txt"


def begins_of(frames: int) -> list[int]:
    """First frames of the stretches, each of half a walk."""
    return [k * (frames // 2) // (STRETCHES - 1) for k in range(STRETCHES)]


def stretch(capture: Path, first: int, frames: int, folder: Path) -> Path:
    """A capture of some frames of another, whose images it names."""
    if not folder.is_dir():
        folder.mkdir(parents=True)
        copy(capture / "camera.toml", folder)
        for images in ("rgb", "depth"):
            (folder / images).symlink_to((capture / images).resolve())
        for name in LISTS:
            head, *lines = (capture / name).read_text("utf-8").splitlines()
            kept = [head, *lines[first : first + frames]]
            (folder / name).write_text("\n".join(kept) + "\n", "utf-8")
    return folder


def staying(motion: str, seed: int, width: int) -> CaptureSpec:
    """A camera that stays about one place, past people who walk close by."""
    alone = replace(spec_of("one_room", 0.0, seed, width), frames=450, photos=0, rate_hz=30.0)
    return replace(alone, motion=motion, walkers=3, walker_share=0.5)


def among_things(thing: str, motion: str, seed: int, width: int) -> CaptureSpec:
    """A camera before something that moves as a whole; without a motion it walks."""
    alone = replace(spec_of("one_room", 0.0, seed, width), frames=300, photos=0, rate_hz=30.0)
    return replace(alone, motion=motion, thing=thing)


def measured(
    on: str, capture: Path, root: Path, most_m: float | None = None
) -> Iterator[Measurement]:
    """A recording mapped up to its poses: how many has it, how far off, and what is said of it.

    ``most_m``: that it may be off, where the way is too short to tell.
    """
    config, frames, what = Config(), len(vnav.open_capture(capture)), "vnav"
    folder = with_poses(capture, root, config)
    found, doubtful = scored_and_doubtful(capture, folder, config)
    posed = poses_in(folder.root / "optimise" / "trajectory_0.tum")
    off_m, wrong_m = found.ate.translation_m.rmse, most_m or WRONG * found.paths_m[0]
    yield Measurement(on, what, "frames with a pose", posed, "", f"at least {frames}")
    yield Measurement(on, what, "ATE RMSE", off_m, "m", most_m and f"at most {most_m:g}")
    if most_m is None:
        yield Measurement(on, what, "ATE of the way", 100 * share_off(found), "%")
    yield from of_verdict(on, what, off_m, wrong_m, doubtful)


def of_stretches(asked: argparse.Namespace) -> Iterator[Measurement]:
    """Recordings that begin in the middle of a walk."""
    captures = asked.out / "captures"
    for scene, seed in product(asked.scenes, range(asked.seeds)):
        name, frames = name_of(scene, SHARE, seed), FRAMES[scene] // 2
        walk = rendered(captures / name, spec_of(scene, SHARE, seed, asked.width))
        for first in begins_of(FRAMES[scene]):
            part = stretch(walk, first, frames, captures / f"{name}_from{first}")
            on = f"{scene}, seed {seed}, frames {first} to {first + frames - 1}"
            yield from measured(on, part, asked.out / "maps" / part.name)


def of_staying(asked: argparse.Namespace) -> Iterator[Measurement]:
    """Recordings by a camera that stays about one place."""
    for motion, seed in product(MOTIONS, range(asked.seeds)):
        name = f"{motion}_seed{seed}"
        capture = rendered(asked.out / "captures" / name, staying(motion, seed, asked.width))
        on = f"one_room, {motion}, seed {seed}"
        yield from measured(on, capture, asked.out / "maps" / name, MOST_M)


def of_things(asked: argparse.Namespace) -> Iterator[Measurement]:
    """Recordings among things that move."""
    for thing, motion, seed in product(THINGS, ("halfsphere", ""), range(asked.seeds)):
        name = f"{thing}_{motion or 'walk'}_seed{seed}"
        spec = among_things(thing, motion, seed, asked.width)
        capture = rendered(asked.out / "captures" / name, spec)
        on = f"one_room, {thing}, {motion or 'a walk'}, seed {seed}"
        yield from measured(on, capture, asked.out / "maps" / name, MOST_M)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures, which are rendered once, and of maps")
    scenes = "of the walks; none: only the cameras that stay, and things"
    parser.add_argument(
        "--scenes", nargs="*", choices=list(FRAMES), default=list(FRAMES), help=scenes
    )
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--width", type=int, default=640, help="of the images, in pixels")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    (asked.out / "captures").mkdir(parents=True, exist_ok=True)
    found = [*of_stretches(asked), *of_staying(asked), *of_things(asked)]
    return conclude("among_people", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
