"""How long finding a photo takes, held against its SIFT, exhaustive matching and other solvers.

    python benchmarks/locating.py [--out DIR] [--every N] [--record]

builds what is missing of the maps in DIR: house, with its photos, and the first half of
redkitchen01 at its true poses, asked for every tenth frame of the second half (both from
../shared/captures; without them a rendered apartment at its true poses); and a building of 2 and of
20 rooms. In one run, each photo goes through everything in turn, so that other load on the machine
counts for all; ratios are to the SIFT extraction of the same photo, and medians are told. Those of
CPU time hardly depend on other load; SIFT spreads over the cores, what follows does not.

Exhaustive matching: the features with depth of every keyframe against the photo's, one keyframe
after the other, by the ratio test; the pose from the matches of the 12 keyframes with most of them
by poselib's RANSAC at vnav's threshold (vnav's own where poselib is not there), with no further
verification. Recall counts poses within 5 cm and 5 degrees. poselib and pycolmap also solve the
matches that vnav's first RANSAC of a photo got. Exit code 1 where something wanted is missed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as for the command line

import numpy as np  # noqa: E402
from exhaustive import Exhaustive, by_poselib, by_pycolmap, optional  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from photo_cases import Case, building, cases, command  # noqa: E402
from recording import Measurement, add_record_option, missed, record, table  # noqa: E402

from vnav.config import Config  # noqa: E402
from vnav.core import se3  # noqa: E402
from vnav.core.camera import CameraPrior  # noqa: E402
from vnav.features import sift  # noqa: E402
from vnav.io.store.index_file import load_index  # noqa: E402
from vnav.io.store.tree_file import load_tree  # noqa: E402
from vnav.localisation import localise  # noqa: E402
from vnav.localisation.hypotheses import hypothesise  # noqa: E402
from vnav.localisation.hypotheses.ransac import (  # noqa: E402
    RansacOptions,
    estimate_absolute_pose,
)
from vnav.localisation.matches import Correspondences2D3D  # noqa: E402
from vnav.localisation.verdict.answer import PhotoAnswer  # noqa: E402
from vnav.memory import keep_freed  # noqa: E402
from vnav.stages import locate  # noqa: E402
from vnav.stages.locate import Locator  # noqa: E402

Array = NDArray[np.float64]
Times = NDArray[np.float64]  # (2,): wall and CPU, seconds

WANTED_COLD_MS, WANTED_LARGE_COLD_MS, WANTED_LOAD_MS = 1000, 1500, 300
WANTED_GROWTH, WANTED_BUSY = 1.5, 75
WANTED_STREAM = 1.4  # times SIFT, wall
MISSED_AT_MOST = 1  # photos that exhaustive matching finds and vnav does not
RIGHT_M, RIGHT_DEG = 0.05, 5.0
ROOMS = 2, 20
COLD_RUNS = 5
SIFT, ALL, REST = "SIFT of the photo", "all that follows", "quantisation and the rest"
PEER = "SIFT of the same photo"
SOLVERS = ("poselib", "pycolmap")
WANTED = {ALL: 0.5}  # times SIFT, wall
PARTS = (  # what is told, and the functions that do it
    (SIFT, sift.Sift, "extract"),
    (ALL, locate, "prepare"),
    (ALL, locate, "localise"),
    ("search", localise, "search"),
    ("search", localise, "search_repeated"),
    ("hypotheses", localise, "hypothesise"),
    ("hypotheses", localise, "displaced"),
    ("verification", localise, "verify"),
    ("verdict", localise, "decide"),
)


def now() -> Times:
    """Wall and CPU time of all threads, in seconds."""
    return np.array([time.perf_counter(), time.process_time()])


@dataclass
class Clock:
    """Times by name, and what the first RANSAC of a photo was given and took."""

    spent: dict[str, Times] = field(default_factory=dict)
    solved: tuple[Correspondences2D3D, CameraPrior, RansacOptions, Times] | None = None

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed."""

        def timed(*arguments: Any) -> Any:
            started = now()
            result = function(*arguments)
            self.spent[name] = self.spent.get(name, np.zeros(2)) + now() - started
            return result

        return timed

    def keeping(self, solver: Callable[..., Any]) -> Callable[..., Any]:
        """The solver; its first arguments and times are kept."""

        def kept(
            matched: Correspondences2D3D,
            prior: CameraPrior,
            options: RansacOptions,
            rng: np.random.Generator,
        ) -> Any:
            started = now()
            result = solver(matched, prior, options, rng)
            if self.solved is None and result is not None:
                self.solved = matched, prior, options, now() - started
            return result

        return kept


@contextmanager
def watched() -> Iterator[Clock]:
    """A clock on the parts of finding a photo."""
    clock = Clock()
    before = [(module, name, getattr(module, name)) for _, module, name in PARTS]
    before.append((hypothesise, "estimate_absolute_pose", estimate_absolute_pose))
    try:
        for part, module, name in PARTS:
            setattr(module, name, clock.around(part, getattr(module, name)))
        kept = clock.keeping(estimate_absolute_pose)
        setattr(hypothesise, "estimate_absolute_pose", kept)  # noqa: B010
        yield clock
    finally:
        for module, name, function in before:
            setattr(module, name, function)


def asked(locator: Locator, photo: Path) -> tuple[PhotoAnswer, dict[str, Times], Clock]:
    """The answer, and times of SIFT, of all that follows, and of its parts."""
    with watched() as clock:
        answer = locator.locate(photo)
    spent = clock.spent
    parts = [times for name, times in spent.items() if name not in (SIFT, ALL)]
    return answer, spent | {REST: spent[ALL] - np.sum(parts, 0)}, clock


def solvers(clock: Clock) -> dict[str, Times]:
    """Times of vnav's and other solvers on the matches of the photo's first RANSAC."""
    if clock.solved is None:
        return {}
    matched, prior, options, ours = clock.solved
    spent = {"the first RANSAC, by vnav": ours}
    for name, solve in (("poselib", by_poselib), ("pycolmap", by_pycolmap)):
        if module := optional(name):
            started = now()
            solve(module, matched, prior, options.threshold_px)
            spent[f"the same by {name}"] = now() - started
    return spent


def is_right(T_world_camera: Array | None, true: Array) -> bool:
    """Whether a pose is within 5 cm and 5 degrees."""
    if T_world_camera is None:
        return False
    off = se3.inverse(true) @ T_world_camera
    degrees = np.rad2deg(se3.rotation_angle(off))
    return bool(np.linalg.norm(off[:3, 3]) <= RIGHT_M and degrees <= RIGHT_DEG)


def photos_of_case(case: Case, every: int) -> tuple[list[Measurement], list[Measurement]]:
    """Ask a case's photos: what it took, and how many poses are right."""
    config = Config()
    locator, exhaustive = Locator.open(case.folder, config, case.camera), Exhaustive(case.folder)
    photos, rows = case.photos[::every], []
    locator.locate(photos[0])  # what is only done once is done
    right = np.zeros(3, int)
    for photo in photos:
        answer, spent, clock = asked(locator, photo)
        started = now()
        pose = exhaustive.locate(answer, config)
        spent["exhaustive matching"] = now() - started
        rows.append(spent | solvers(clock))
        likeliest = answer.result.hypotheses[:1]
        poses = [
            answer.best.view.T_world_camera if answer.best else None,
            likeliest[0].view.T_world_camera if likeliest else None,
            pose,
        ]
        right += [is_right(pose, case.truth[photo.name]) for pose in poses]
    return times_of(f"{case.name}, a photo", rows), recall(case.name, len(photos), right.tolist())


def times_of(on: str, rows: list[dict[str, Times]]) -> list[Measurement]:
    """Medians over the photos of times by name, and of their ratios to the same photo's SIFT."""
    names, found = list(dict.fromkeys(name for row in rows for name in row)), []
    of_sift = np.array([row[SIFT] for row in rows])
    for name in sorted(names, key=lambda name: (name != SIFT, name == ALL)):
        times = np.array([row.get(name, np.zeros(2)) for row in rows])
        wall, cpu = np.median(times / of_sift, 0).tolist()
        wall_ms, cpu_ms = (1e3 * np.median(times, 0)).tolist()
        limit = f"at most {WANTED[name]:g}" if name in WANTED else None
        found += [
            Measurement(on, name, "wall time", wall_ms, "ms", None, PEER),
            Measurement(on, name, "CPU time", cpu_ms, "ms", None, PEER),
            Measurement(on, name, "wall time, ratio", wall, "", limit, PEER),
            Measurement(on, name, "CPU time, ratio", cpu, "", None, PEER),
        ]
    return found


def recall(name: str, photos: int, right: Sequence[int]) -> list[Measurement]:
    """How many poses given, likeliest, and by exhaustive matching are right."""
    solver = "poselib" if optional("poselib") else "vnav's RANSAC"
    whats = ("pose given", "likeliest pose", f"exhaustive matching with {solver}")
    limits = (None, f"at least {right[2] - MISSED_AT_MOST}", None)
    within = f"within {100 * RIGHT_M:g} cm and {RIGHT_DEG:g} deg"
    found = []
    for what, count, limit in zip(whats, right, limits, strict=True):
        found.append(Measurement(name, f"its photos, {what}", "asked", photos))
        found.append(Measurement(name, f"its photos, {what}", within, count, "", limit))
    return found


def from_shell(case: Case, *arguments: object) -> list[str]:
    """`vnav locate` with these arguments, in the case's map and with its camera."""
    camera = ("--camera", case.camera) if case.camera else ()
    return command("locate", *arguments, "--map", case.folder.root, *camera)


def cold(case: Case, most_ms: float) -> list[Measurement]:
    """How long one photo takes from the shell, and how long the index takes to load."""
    shell = from_shell(case, case.photos[0])
    whole, load = [], []
    for _ in range(COLD_RUNS):
        started = time.perf_counter()
        subprocess.run(shell, stdout=subprocess.DEVNULL, check=False)
        whole.append(time.perf_counter() - started)
        started = time.perf_counter()
        index = load_index(case.folder, load_tree(case.folder))
        load.append(time.perf_counter() - started)
    whole_ms, load_ms = (1e3 * float(np.median(seconds)) for seconds in (whole, load))
    limits = f"at most {most_ms}", f"at most {WANTED_LOAD_MS}"
    on = f"{case.name}, {len(index.points_world)} landmarks, one photo"
    return [
        Measurement(on, "`vnav locate` from the shell", "wall time", whole_ms, "ms", limits[0]),
        Measurement(on, "index and tree loaded", "wall time", load_ms, "ms", limits[1]),
    ]


def stream(case: Case, every: int) -> list[Measurement]:
    """How long a photo takes from its line on stdin to its answer, once the map is loaded."""
    locator = Locator.open(case.folder, Config(), case.camera)
    first, *photos = [case.photos[0], *case.photos[::every]]
    asked(locator, first)  # what is only done once is done
    taken, of_sift = [], []
    with subprocess.Popen(
        from_shell(case, "--stdin"),
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        answered_s(process, first)
        for photo in photos:
            of_sift.append(asked(locator, photo)[1][SIFT][0])
            taken.append(answered_s(process, photo))
        assert process.stdin is not None
        process.stdin.close()
    ratio = float(np.median(np.array(taken) / of_sift))
    on, what, limit = f"{case.name}, a photo", "`vnav locate --stdin`", f"at most {WANTED_STREAM}"
    return [
        Measurement(on, what, "wall time", 1e3 * float(np.median(taken)), "ms", None, PEER),
        Measurement(on, what, "wall time, ratio", ratio, "", limit, PEER),
    ]


def answered_s(process: "subprocess.Popen[str]", photo: Path) -> float:
    """Seconds from a photo's line on stdin to its answer."""
    assert process.stdin is not None
    assert process.stdout is not None
    started = time.perf_counter()
    process.stdin.write(f"{photo}\n")
    process.stdin.flush()
    process.stdout.readline()
    return time.perf_counter() - started


def growth(small: Case, large: Case) -> list[Measurement]:
    """How much longer finding takes in the larger map, each asked for its own photos."""
    found, landmarks = [], []
    for case in (small, large):
        locator = Locator.open(case.folder, Config(), case.camera)
        locator.locate(case.photos[0])  # what is only done once is done
        landmarks.append(len(locator.database.index.points_world))
        found.append([asked(locator, photo) for photo in case.photos])
    located = [sum(answer.best is not None for answer, _, _ in of_map) for of_map in found]
    print(f"{located[0]} and {located[1]} of {len(small.photos)} photos of buildings located\n")
    on, peer = f"{large.name}, {landmarks[1]} landmarks, a photo", f"{small.name}, {landmarks[0]}"
    measured = []
    for name in (SIFT, "search", ALL):
        few, many = (float(np.median([spent[name][0] for _, spent, _ in it])) for it in found)
        limit = f"at most {WANTED_GROWTH}" if name == "search" else None
        measured += [
            Measurement(on, name, "wall time", 1e3 * many, "ms", None, peer),
            Measurement(on, name, "wall time, ratio", many / few, "", limit, peer),
        ]
    return measured


def busy(case: Case) -> list[Measurement]:
    """Which share of all cores `vnav locate DIR --csv` keeps busy."""
    with tempfile.TemporaryDirectory() as scratch:
        photos = Path(scratch) / "photos"
        photos.mkdir()
        for photo in case.photos:
            (photos / photo.name).symlink_to(photo.resolve())
        camera = case.camera or case.photos[0].parent / "camera.toml"
        options = ("--camera", camera, "--csv", Path(scratch) / "poses.csv")
        shell = command("locate", photos, "--map", case.folder.root, *options)
        started = time.perf_counter()
        with subprocess.Popen(shell, stdout=subprocess.DEVNULL) as process:
            usage = os.wait4(process.pid, 0)[2]
            process.returncode = 0  # waited for
        wall_s = time.perf_counter() - started
    share = (usage.ru_utime + usage.ru_stime) / wall_s / len(os.sched_getaffinity(0))
    on, limit = f"{case.name}, {len(case.photos)} photos", f"at least {WANTED_BUSY}"
    return [
        Measurement(on, "`vnav locate DIR --csv`", "of all cores busy", 100 * share, "%", limit)
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("bench/locating"), help="of the maps")
    parser.add_argument("--every", type=int, default=1, help="take every so many photos only")
    add_record_option(parser)
    options = parser.parse_args(arguments)
    keep_freed()  # as the command line does
    for name in (name for name in SOLVERS if not optional(name)):
        print(f"{name} is not installed, and left out; `pip install {name}` brings it in")
    places, buildings = cases(options.out), [building(options.out, rooms) for rooms in ROOMS]
    found: list[tuple[str, str, list[Measurement]]] = []
    for case in places:
        times, right = photos_of_case(case, options.every)
        found.append((f"photo_speed_{case.stem}", "how fast", times))
        found.append((f"photos_{case.stem}_peers", "how often right", right))
    shell = cold(places[0], WANTED_COLD_MS) + cold(buildings[1], WANTED_LARGE_COLD_MS)
    shell += stream(places[0], options.every) + busy(places[0])
    found.append(("photo_speed_shell", "how fast", shell))
    found.append(("photo_speed_growth", "how fast", growth(*buildings)))
    load = " ".join(f"{value:.1f}" for value in os.getloadavg())
    print(f"{os.cpu_count()} cores, load {load}")
    for name, question, measurements in found:
        print(f"\n{table(measurements)}")
        if options.record:
            record(name, question, measurements, arguments, libraries=SOLVERS)
    return int(any(missed(measurements) for _, _, measurements in found))


if __name__ == "__main__":
    sys.exit(main())
