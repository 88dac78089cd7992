"""Recordings that begin among people: stretches of walks past them, each mapped by itself.

    python benchmarks/among_people.py OUT [--scenes one_room apartment] [--seeds 2] [--record]

renders the walks past 35 % people that people.py takes to OUT/captures, once, and maps four
stretches of each up to its poses. Somebody who stands still when a stretch begins has never been
seen to move. ATE is told as a share of the way. Exit code 1 where a frame is lost, or a map that
is wrong by verdicts.py's measure is not called doubtful.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from shutil import copy

from accuracy import poses_in
from people import FRAMES, name_of, rendered, spec_of
from recording import Measurement, add_record_option, conclude
from verdicts import WRONG, scored_and_doubtful, share_off, with_poses

import vnav
from vnav.config import Config

SHARE = 0.35  # of the pixels
STRETCHES = 4  # of a walk, which overlap
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


def measured(on: str, capture: Path, root: Path) -> Iterator[Measurement]:
    """A stretch mapped up to its poses: how many has it, how far off, and what is said of it."""
    config, frames, what = Config(), len(vnav.open_capture(capture)), "vnav"
    folder = with_poses(capture, root, config)
    found, is_doubtful = scored_and_doubtful(capture, folder, config)
    off, posed = share_off(found), poses_in(folder.root / "optimise" / "trajectory_0.tum")
    yield Measurement(on, what, "frames with a pose", posed, "", f"at least {frames}")
    yield Measurement(on, what, "ATE RMSE", found.ate.translation_m.rmse, "m")
    yield Measurement(on, what, "ATE of the way", 100 * off, "%")
    yield Measurement(on, what, "called doubtful", int(is_doubtful))
    in_silence = int(off > WRONG and not is_doubtful)
    yield Measurement(on, what, "wrong and called good", in_silence, "", "at most 0")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures, which are rendered once, and of maps")
    parser.add_argument("--scenes", nargs="+", choices=list(FRAMES), default=list(FRAMES))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--width", type=int, default=640, help="of the images, in pixels")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    captures, found = asked.out / "captures", []
    captures.mkdir(parents=True, exist_ok=True)
    for scene in asked.scenes:
        for seed in range(asked.seeds):
            name, frames = name_of(scene, SHARE, seed), FRAMES[scene] // 2
            walk = rendered(captures / name, spec_of(scene, SHARE, seed, asked.width))
            for first in begins_of(FRAMES[scene]):
                part = stretch(walk, first, frames, captures / f"{name}_from{first}")
                on = f"{scene}, seed {seed}, frames {first} to {first + frames - 1}"
                found += measured(on, part, asked.out / "maps" / part.name)
    return conclude("among_people", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
