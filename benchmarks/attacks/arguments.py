"""Options and arguments that make no sense, to every command."""

from pathlib import Path

import numpy as np

from attacks.attempt import Attempt, anything
from attacks.captures import CHECK, ODOMETRY
from attacks.maps import LOCATE, PLAN, drawn
from attacks.mutations import word

Random = np.random.Generator
NUMBERS = ("nan", "inf", "-inf", "-1", "0", "1e308", "-1e308", "1e-320", "10000000000000000000000")
PATHS = ("", ".", "/", "/dev/null", "/dev/full", "/dev/zero", "/proc/self/mem", "none", "n" * 300)
PATHS += ("out/" * 2000, "\udcff", "a\nb", "\x1b[2J", "-", "capture")
PATHS += ("map/index/index.npz", "photos/000.jpg", "map/map.json")
POINTS = (
    "1,1",
    "nan,1",
    "inf,inf",
    "1e308,-1e308",
    "1,2,3",
    ",",
    "1",
    "current",
    "0x1,1",
    "-99,99",
)


def attempt(rng: Random, folder: Path) -> Attempt:
    """A command with one argument or option that nobody means."""
    number, path, text = drawn(rng, NUMBERS), drawn(rng, PATHS), word(rng)[:2000].replace("\0", "")
    points = ("--from", drawn(rng, POINTS), "--to", drawn(rng, POINTS))
    truth = "capture/groundtruth.txt"
    commands = (
        ("plan", "--map", "map", *points, "--json"),
        ("plan", "--map", "map", *points, "--png", drawn(rng, [path, "out/path.png"])),
        (*PLAN, "--robot-radius", number),
        (*PLAN, "--tolerance", number),
        (*PLAN, "--csv", path),
        (*PLAN, "--camera", path),
        (*LOCATE, "--csv", path),
        (*LOCATE, "--overlay", path),
        (*LOCATE, "--camera", path),
        (*LOCATE, "--log-file", drawn(rng, PATHS[:-3])),  # it is appended to as it is
        (*LOCATE, "--jobs", number),
        (*LOCATE, "--scheduler", drawn(rng, ["", "x", "tcp://", "tcp://127.0.0.1:1"])),
        ("locate", path, "--map", "map"),
        ("locate", "photos/000.jpg", "--map", path),
        ("info", path),
        ("config", path),
        ("config", text),
        ("report", path),
        ("export", path, "--cloud", "ply", "--out", "out"),
        ("export", "map", "--cloud", "ply", "--out", path),
        ("check", path),
        (*CHECK, "--camera", path),
        ("odometry", "capture", "--map", path) if path not in SHARED else ("info", path),
        (*ODOMETRY, "--camera", path),
        (*ODOMETRY, "--trajectory", path),
        (*ODOMETRY, "--config", path),
        (*ODOMETRY, "--set", text),
        ("build-map", path, "--map", "new"),
        ("extend", path, "capture"),
        ("score", truth, truth, "--frames", number),
        ("score", truth, truth, "--max-difference", number),
        ("score", path, truth),
        ("score", truth, path),
        ("evaluate", path),
        ("evaluate", text),
        ("datasets", "verify", text),
        ("datasets", "list", "--in", path),
        (text,),
        ("locate", f"--{text}"),
    )
    command = drawn(rng, commands)
    shown = " ".join(command)[:200]
    return Attempt(repr(shown), command, anything)


SHARED = ("", ".", "/")  # where a map is written on purpose, it must not be where all else lies
