"""How true trajectories are, how often photos are right, how large maps are.

    python benchmarks/accuracy.py CAPTURE... [--maps DIR] [--peer NAME=TRAJECTORY] [--record]

builds the map of each capture, or takes the one that lies in DIR, called as its capture. It scores
the trajectory against the capture's groundtruth.txt, locates the capture's photos where it has
photos/groundtruth.txt, and asks every map for 40 frames of each other capture, which must all be
refused. All of it goes through the command line, as a user does it. Seconds are printed and not
recorded: speed.py measures time, in turns with peers. Exit code 1 where something wanted is missed.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from photo_cases import command
from recording import Measurement, add_record_option, missed, record, table

from vnav.evaluation.metrics import WRONG, relocalisation_error
from vnav.io.formats.trajectories import read_photo_poses

STRANGERS = 40  # frames asked of another place's map
NEAR = ((0.05, 2.0), (0.05, 5.0))  # metres, degrees
WANTED_ATE_M = {"house": 0.015, "redkitchen01": 0.045}
WANTED_RIGHT = {"house": 37}  # photos within the first of NEAR
WANTED_MB = 2048
NOT_LOCATED = 3  # exit code of `vnav locate`

Answers = list[dict[str, Any]]


def vnav(*arguments: object, expected: Sequence[int] = (0,)) -> Any:
    """What a command prints as JSON; CalledProcessError where it fails."""
    done = subprocess.run(command(*arguments, "--json"), text=True, stdout=subprocess.PIPE)
    if done.returncode not in expected:
        done.check_returncode()
    return json.loads(done.stdout)


def built(capture: Path, folder: Path, *options: str) -> None:
    """The map of a capture, made where it is not there; how long that took is printed."""
    started = time.perf_counter()
    build = command("build-map", capture, "--map", folder, *options)
    subprocess.run(build, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    print(f"{capture.name}: build-map {time.perf_counter() - started:.0f} s")


def trajectory(capture: Path, what: str, file: Path, score: dict[str, Any]) -> list[Measurement]:
    """Coverage, ATE and RPE of a trajectory by its score; what is wanted of vnav's."""
    frames, name = frames_of(capture), capture.name
    ours = what.startswith("vnav")
    limit = f"at most {WANTED_ATE_M[name]:g}" if ours and name in WANTED_ATE_M else None
    over = score["rpe"]["1 s"]
    found = [
        Measurement(name, what, "frames", frames),
        Measurement(name, what, "frames with a pose", poses_in(file)),
        Measurement(name, what, "ATE RMSE", score["ate_m"]["rmse"], "m", limit),
    ]
    if over["pairs"]:
        found += [
            Measurement(name, what, "RPE over 1 s", over["translation_m"]["rmse"], "m"),
            Measurement(name, what, "RPE over 1 s", over["rotation_deg"]["rmse"], "deg"),
        ]
    return found


def frames_of(capture: Path) -> int:
    """Colour images of a capture with rgb.txt."""
    return poses_in(capture / "rgb.txt")


def poses_in(file: Path) -> int:
    """Lines that are no comment."""
    lines = file.read_text("utf-8").splitlines()
    return sum(bool(line.strip()) and not line.startswith("#") for line in lines)


def errors(answers: Answers, photos: Path, T_truth_world: np.ndarray) -> np.ndarray:
    """Metres and degrees (N, 2) of the N located photos."""
    truth = read_photo_poses(photos / "groundtruth.txt")
    located = [answer for answer in answers if answer["located"]]
    poses = np.array([answer["T_world_camera"] for answer in located]).reshape(-1, 4, 4)
    true = np.array([truth[Path(answer["photo"]).name] for answer in located]).reshape(-1, 4, 4)
    return np.stack(relocalisation_error(T_truth_world @ poses, true), -1)


def photos_found(name: str, asked: int, off: np.ndarray) -> list[Measurement]:
    """Counts of photos by their errors (N, 2) in metres and degrees."""
    what, m, deg = "its photos", off[:, 0], off[:, 1]
    found = [
        Measurement(name, what, "asked", asked),
        Measurement(name, what, "answered", len(off)),
    ]
    for k, (near_m, near_deg) in enumerate(NEAR):
        wanted = f"at least {WANTED_RIGHT[name]}" if not k and name in WANTED_RIGHT else None
        inside = int(((m <= near_m) & (deg <= near_deg)).sum())
        quantity = f"within {100 * near_m:g} cm and {near_deg:g} deg"
        found.append(Measurement(name, what, quantity, inside, wanted=wanted))
    wrong = int(((m > WRONG[0]) | (deg > WRONG[1])).sum())
    return [*found, Measurement(name, what, "wrong", wrong, wanted="at most 0")]


def photos_accurate(name: str, off: np.ndarray) -> list[Measurement]:
    """The median of the errors (N, 2), nothing for N = 0."""
    if not len(off):
        return []
    middle_m, middle_deg = np.median(off, 0).tolist()
    return [
        Measurement(name, "vnav, its photos", "median error", 100 * middle_m, "cm"),
        Measurement(name, "vnav, its photos", "median error", middle_deg, "deg"),
    ]


def strangers(map_of: Path, name: str, other: Path) -> list[Measurement]:
    """How many frames of another place are located, wrongly."""
    frames = sorted((other / "rgb").iterdir())
    rows = np.linspace(0, len(frames) - 1, min(STRANGERS, len(frames))).astype(int)
    asked = [frames[k] for k in rows]
    options = ("--map", map_of, "--camera", other / "camera.toml")
    answers = vnav("locate", *asked, *options, expected=(0, NOT_LOCATED))
    located, what = sum(answer["located"] for answer in answers), f"frames of {other.name}"
    return [
        Measurement(name, what, "asked", len(asked)),
        Measurement(name, what, "answered", located),
        Measurement(name, what, "wrong", located, wanted="at most 0"),
    ]


def size(name: str, map_of: Path) -> list[Measurement]:
    """What the map holds, on disk and in memory."""
    info = vnav("info", map_of)
    report = json.loads((map_of / "reports" / "map.json").read_text("utf-8"))
    what, memory_mb = "vnav's map", report["values"]["peak_memory_mb"]
    return [
        Measurement(name, what, "frames", info["frames"]),
        Measurement(name, what, "keyframes", info["keyframes"]),
        Measurement(name, what, "landmarks", info["landmarks"]),
        Measurement(name, what, "on disk", info["size_mb"], "MB"),
        Measurement(name, what, "peak memory", memory_mb, "MB", f"at most {WANTED_MB}"),
    ]


def measure(
    capture: Path, map_of: Path, others: Sequence[Path], peers: Sequence[tuple[str, Path]]
) -> dict[str, list[Measurement]]:
    """All that is measured on one capture and its map, by question."""
    name, photos, truth = capture.name, capture / "photos", capture / "groundtruth.txt"
    file = map_of / "optimise" / "trajectory_0.tum"
    score = vnav("score", file, truth)
    accurate = trajectory(capture, "vnav, trajectory", file, score)
    for peer, tum in peers:
        accurate += trajectory(capture, f"{peer}, trajectory", tum, vnav("score", tum, truth))
    right: list[Measurement] = []
    if (photos / "groundtruth.txt").is_file():
        answers = vnav("locate", photos, "--map", map_of, expected=(0, NOT_LOCATED))
        seconds = np.median([sum(answer["seconds"].values()) for answer in answers])
        print(f"{name}: {seconds:.2f} s for a photo")
        off = errors(answers, photos, np.array(score["T_truth_world"]))
        accurate += photos_accurate(name, off)
        right += photos_found(name, len(answers), off)
    for other in others:
        right += strangers(map_of, name, other)
    return {"how accurate": accurate, "how often right": right, "how large": size(name, map_of)}


def peer(text: str) -> tuple[str, Path]:
    """NAME=TRAJECTORY taken apart."""
    name, equals, path = text.partition("=")
    if not equals or not Path(path).is_file():
        raise argparse.ArgumentTypeError(f"expected NAME=TRAJECTORY, a TUM file, found {text!r}")
    return name, Path(path)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("captures", type=Path, nargs="+", metavar="CAPTURE")
    parser.add_argument("--maps", type=Path, help="of the maps; without it they are not kept")
    parser.add_argument(
        "--peer",
        type=peer,
        action="append",
        default=[],
        metavar="NAME=TRAJECTORY",
        help="another system's trajectory of the one capture, as a TUM file",
    )
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    if asked.peer and len(asked.captures) > 1:
        parser.error("expected one CAPTURE with --peer, whose trajectory it is")
    files = {"how accurate": "accuracy", "how often right": "photos", "how large": "size"}
    good = True
    with tempfile.TemporaryDirectory() as scratch:
        folders = {
            capture: (asked.maps or Path(scratch)) / capture.name for capture in asked.captures
        }
        for capture, map_of in folders.items():
            built(capture, map_of)
            others = [other for other in asked.captures if other != capture]
            for question, found in measure(capture, map_of, others, asked.peer).items():
                good &= not missed(found)
                print(f"\n{question}\n\n{table(found)}\n" if found else "", flush=True)
                if asked.record and found:
                    record(f"{files[question]}_{capture.name}", question, found, arguments)
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
