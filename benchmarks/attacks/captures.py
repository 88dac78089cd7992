"""Captures: broken, mixed, huge, oddly named, and lists and cameras that make no sense."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from attacks.attempt import Attempt, anything, told
from attacks.ground import replace
from attacks.maps import drawn
from attacks.mutations import spoilt, spoilt_text, word

Random = np.random.Generator
ODOMETRY = ("odometry", "capture", "--map", "new")
CHECK = ("check", "capture", "--json")
NAMES = (
    "capture\n",
    "\x1b[2Jcapture",
    "-capture",
    "c" * 255,
    "\udcff\udcfe",
    "a b'c\"d",
    "каталог",
)


def attempt(rng: Random, folder: Path) -> Attempt:
    """A capture that is not as it should be, and a command that reads it."""
    hows = (text, text, image, image, image, other_image, structure, named)
    return hows[rng.integers(len(hows))](rng, folder)


def command(rng: Random) -> tuple[str, ...]:
    score = ("score", "capture/groundtruth.txt", "capture")
    return drawn(rng, [CHECK, CHECK, ("check", "capture"), ODOMETRY, score])


def text(rng: Random, folder: Path) -> Attempt:
    """A list, the camera or the truth says something else."""
    name = drawn(rng, ["rgb.txt", "depth.txt", "camera.toml", "groundtruth.txt"])
    path = folder / "capture" / name
    how, content = spoilt_text(path.read_bytes(), rng)
    replace(path, content)
    run = command(rng)
    return Attempt(f"{how} of {name}; {' '.join(run)}", run, anything)


def image(rng: Random, folder: Path) -> Attempt:
    """An image is no image any more: `check` reads every file, and names it."""
    path = drawn(rng, sorted((folder / "capture").glob("*/*")))
    how, lost = destroyed(rng, path)
    run = command(rng)
    judge = told(path.name) if lost and run[0] == "check" else anything
    return Attempt(f"{path.parent.name} image: {how}; {' '.join(run)}", run, judge)


def destroyed(rng: Random, path: Path) -> tuple[str, bool]:
    """What became of an image, and whether nothing can be made of it."""
    data = path.read_bytes()
    how, content = spoilt(data, rng)
    seen_through = path.suffix == ".png" and content != data and "repeat" not in how
    changes: dict[str, tuple[Callable[[], Any], bool]] = {
        how: (lambda: path.write_bytes(content), seen_through),
        f"{how} again": (lambda: path.write_bytes(content), seen_through),
        "missing": (lambda: None, True),
        "empty": (path.touch, True),
        "a folder": (path.mkdir, True),
        "a pipe": (lambda: os.mkfifo(path), True),
        "a link to /dev/zero": (lambda: path.symlink_to("/dev/zero"), True),
        "a link to itself": (lambda: path.symlink_to(path.name), True),
        "8 GB of nothing": (lambda: (path.touch(), os.truncate(path, 2**33)), True),
        "cut": (lambda: path.write_bytes(data[: len(data) // 2]), True),
    }
    name = drawn(rng, list(changes))
    path.unlink()
    changes[name][0]()
    return name, changes[name][1]


def other_image(rng: Random, folder: Path) -> Attempt:
    """Images are whole, of another kind, size or content."""
    kind = drawn(rng, ["rgb", "depth"])
    paths = sorted((folder / "capture" / kind).iterdir())
    how, make = drawn(rng, list(IMAGES.items()))
    chosen = paths if rng.random() < 0.5 else [drawn(rng, paths)]
    for path in chosen:
        old = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
        replace(path, cv2.imencode(path.suffix, make(old, rng))[1].tobytes())
    run = command(rng)
    return Attempt(f"{len(chosen)} {kind} images: {how}; {' '.join(run)}", run, anything)


IMAGES: dict[str, Callable[[Any, Random], Any]] = {
    "half as large": lambda old, rng: old[::2, ::2],
    "one pixel": lambda old, rng: old[:1, :1],
    "a row": lambda old, rng: old[:1],
    "eight bits": lambda old, rng: old.astype(np.uint8),
    "three channels": lambda old, rng: np.stack([old[..., 0] if old.ndim > 2 else old] * 3, -1),
    "one channel": lambda old, rng: old[..., 0] if old.ndim > 2 else old,
    "nothing": lambda old, rng: np.zeros_like(old),
    "saturated": lambda old, rng: np.full_like(old, np.iinfo(old.dtype).max),
    "noise": lambda old, rng: rng.integers(0, 65536, old.shape).astype(old.dtype),
    "upside down": lambda old, rng: np.ascontiguousarray(old[::-1]),
    "a single value": lambda old, rng: np.full_like(old, old.flat[old.size // 2]),
}


def structure(rng: Random, folder: Path) -> Attempt:
    """Files are missing, or those of several formats lie together."""
    capture = folder / "capture"
    how = drawn(rng, list(STRUCTURES))
    STRUCTURES[how](capture)
    run = command(rng)
    return Attempt(f"capture {how}; {' '.join(run)}", run, anything)


def as_color_depth(capture: Path) -> None:
    (capture / "rgb").rename(capture / "color")
    for name in ("rgb.txt", "depth.txt"):
        (capture / name).unlink()


def as_seven_scenes(capture: Path) -> None:
    for kind, name in (("rgb", "color"), ("depth", "depth")):
        for number, path in enumerate(sorted((capture / kind).iterdir())):
            path.rename(capture / f"frame-{number:06d}.{name}.png")
        shutil.rmtree(capture / kind)
        (capture / f"{kind}.txt").unlink()


def with_images(capture: Path, count: int) -> None:
    as_color_depth(capture)
    source = next((capture / "color").iterdir())
    for number in range(count):
        os.link(source, capture / "color" / f"extra_{number}.jpg")


STRUCTURES: dict[str, Callable[[Path], Any]] = {
    "without its images": lambda c: shutil.rmtree(c / "rgb"),
    "without depth.txt": lambda c: (c / "depth.txt").unlink(),
    "without its camera": lambda c: (c / "camera.toml").unlink(),
    "with empty lists": lambda c: replace(c / "rgb.txt", b"# nothing\n"),
    "without anything": lambda c: (shutil.rmtree(c), c.mkdir()),
    "that is a file": lambda c: (shutil.rmtree(c), c.touch()),
    "that is a pipe": lambda c: (shutil.rmtree(c), os.mkfifo(c)),
    "in two formats": lambda c: shutil.copytree(c / "rgb", c / "color"),
    "of color/ and depth/": as_color_depth,
    "as 7-Scenes": as_seven_scenes,
    "with more colour than depth": lambda c: with_images(c, 3),
    "whose camera is a folder": lambda c: (
        (c / "camera.toml").unlink(),
        (c / "camera.toml").mkdir(),
    ),
    "whose list is a pipe": lambda c: ((c / "rgb.txt").unlink(), os.mkfifo(c / "rgb.txt")),
    "whose list is /dev/zero": lambda c: (
        (c / "depth.txt").unlink(),
        (c / "depth.txt").symlink_to("/dev/zero"),
    ),
    "in a link to itself": lambda c: (shutil.rmtree(c), c.symlink_to(c.name)),
    "of one frame": lambda c: replace(
        c / "rgb.txt", b"\n".join((c / "rgb.txt").read_bytes().split(b"\n")[:2])
    ),
    "with 100,000 lines": lambda c: replace(
        c / "rgb.txt", b"".join(b"%d.5 rgb/none.jpg\n" % n for n in range(100_000))
    ),
}


def named(rng: Random, folder: Path) -> Attempt:
    """Odd names of the folder and of images are names."""
    name = drawn(rng, NAMES)
    (folder / "capture").rename(folder / name)
    if rng.random() < 0.5:
        listed = folder / name / "rgb.txt"
        lines = listed.read_bytes().split(b"\n")
        old = lines[1].split()[1].decode()
        new = drawn(rng, ["rgb/ä ö.jpg", "rgb/-x.jpg", "rgb/\x1b[31m.jpg", f"rgb/{word(rng)[:50]}"])
        lines[1] = lines[1].split()[0] + b" " + new.encode("utf-8", "replace")
        replace(listed, b"\n".join(lines))
        if "\0" not in new and "/" not in new[4:] and new[4:] not in ("", ".", ".."):
            os.link(folder / name / old, folder / name / new)
    run = tuple(
        f"./{name}" if part == "capture" else part for part in drawn(rng, [CHECK, ODOMETRY])
    )
    return Attempt(f"capture called {name!r}; {' '.join(run)!r}", run, anything)
