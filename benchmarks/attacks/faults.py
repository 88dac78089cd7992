"""What a system does to a process: no room, no home, no streams, few resources, interruptions."""

import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np

from attacks.attempt import Attempt, Disturbance, anything
from attacks.captures import ODOMETRY
from attacks.maps import LOCATE, PLAN, drawn

Random = np.random.Generator
EXPORT = ("export", "map", "--out", "out", "--cloud", "ply", "--mesh", "obj", "--trajectory", "tum")
WRITING = (  # commands, and where their answers lie
    (("index", "--map", "map"), "map/index"),
    (("fuse", "--map", "map"), "map/fuse"),
    (("vocabulary", "--map", "map"), "map/vocabulary"),
    (EXPORT, "out"),
    ((*LOCATE, "--csv", "out/found.csv", "--overlay", "out/drawn.jpg"), "out"),
    (ODOMETRY, "new/odometry"),
)


def attempt(rng: Random, folder: Path) -> Attempt:
    """A command in bad circumstances."""
    hows: tuple[Callable[[Random, Path], Attempt], ...] = (
        *(no_room, no_room, interrupted, interrupted),
        *(nowhere, full_device, streams, few, foreign),
    )
    return hows[rng.integers(len(hows))](rng, folder)


def no_room(rng: Random, folder: Path) -> Attempt:
    """Files cannot become longer than that; with room again, all is as if nothing had been."""
    command, output = drawn(rng, WRITING)
    most = int(10 ** rng.uniform(2, 6.7))
    suffered = Disturbance(limits={resource.RLIMIT_FSIZE: most})
    what = f"files of at most {most} bytes; {' '.join(command)}"
    return Attempt(what, command, disturbance=suffered, outputs=(output,), again=True)


def interrupted(rng: Random, folder: Path) -> Attempt:
    """SIGINT at some moment; then the same command again."""
    command, output = drawn(rng, WRITING)
    seconds = float(rng.uniform(0.05, 6))
    what = f"SIGINT after {seconds:.2f} s; {' '.join(command)}"
    suffered = Disturbance(signal_s=seconds)
    return Attempt(what, command, anything, disturbance=suffered, outputs=(output,), again=True)


def nowhere(rng: Random, folder: Path) -> Attempt:
    """No home, no folder for caches or temporary files."""
    odd = {
        "HOME": drawn(
            rng, [None, "/nonexistent", "/proc", "", "relative", str(folder / "map.txt")]
        ),
        "XDG_CACHE_HOME": drawn(rng, [None, "/proc", "relative", ""]),
        "TMPDIR": drawn(rng, [None, "/nonexistent", "/proc"]),
        "NUMBA_CACHE_DIR": drawn(rng, [None, None, "/proc/1"]),
        "VNAV_DATASETS": drawn(rng, [None, "/proc", ""]),
    }
    command = drawn(rng, [LOCATE, PLAN, ("info", "map", "--json"), ("datasets", "list")])
    what = f"{', '.join(f'{k}={v}' for k, v in odd.items())}; {' '.join(command)}"
    judge = anything if command[0] == "datasets" else None
    return attempt_in(what, command, Disturbance(environment=odd), judge)


def full_device(rng: Random, folder: Path) -> Attempt:
    """What is written goes to a device that is full."""
    command = drawn(
        rng,
        [
            (*LOCATE, "--csv", "/dev/full"),
            (*LOCATE, "--overlay", "/dev/full"),
            (*PLAN, "--csv", "/dev/full"),
            (*PLAN, "--png", "/dev/full"),
            (*LOCATE, "--log-file", "/dev/full"),
            (*LOCATE, "-v", "--log-file", "/dev/full"),
            ("export", "map", "--cloud", "ply", "--out", "/dev/full"),
        ],
    )
    return Attempt(" ".join(command), command, anything, disturbance=Disturbance())


def streams(rng: Random, folder: Path) -> Attempt:
    """Standard streams are closed, full, or know few characters."""
    command = drawn(
        rng, [LOCATE, PLAN, ("info", "map"), ("check", "capture"), ("config",), ODOMETRY]
    )
    name = drawn(rng, ["stdin", "stdout", "stdout", "stderr"])
    where = drawn(rng, ["closed", "/dev/full"])
    encoding = drawn(rng, [None, "ascii", "latin-1"])
    suffered = Disturbance({"PYTHONIOENCODING": encoding, "LC_ALL": "C"}, streams={name: where})
    what = f"{name} is {where}, {encoding}; {' '.join(command)}"
    return Attempt(what, command, anything, disturbance=suffered)


def few(rng: Random, folder: Path) -> Attempt:
    """Few files may be open, or there is little memory."""
    command = drawn(rng, [LOCATE, PLAN, ("info", "map", "--json"), ("check", "capture"), ODOMETRY])
    kind, low, high = drawn(rng, [(resource.RLIMIT_NOFILE, 1.1, 2), (resource.RLIMIT_AS, 8.3, 9.7)])
    most = int(10 ** rng.uniform(low, high))
    name = "open files" if kind == resource.RLIMIT_NOFILE else "bytes of memory"
    what = f"at most {most} {name}; {' '.join(command)}"
    return Attempt(what, command, anything, disturbance=Disturbance(limits={kind: most}))


def foreign(rng: Random, folder: Path) -> Attempt:
    """Nothing can be written, where there is no home either."""
    command = drawn(rng, [LOCATE, PLAN, ("info", "map", "--json"), ("config", "map"), ODOMETRY])
    command = drawn(rng, [command, command, ("report", "map"), ("index", "--map", "map"), EXPORT])
    for path in (*(p for p in folder.rglob("*") if p.is_dir()), folder):
        path.chmod(0o555)
    suffered = Disturbance({"HOME": "/nonexistent", "XDG_CACHE_HOME": None}, unprivileged=True)
    return attempt_in(f"read-only, no home; {' '.join(command)}", command, suffered, None)


def attempt_in(
    what: str,
    command: tuple[str, ...],
    suffered: Disturbance,
    judge: Callable[..., str] | None,
) -> Attempt:
    """An attempt whose answer is the undisturbed one's, where nothing else is said."""
    if judge is None:
        return Attempt(what, command, disturbance=suffered)
    return Attempt(what, command, judge, disturbance=suffered)
