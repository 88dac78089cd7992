"""How long a map takes, held against SIFT alone, ORB-SLAM3 and Open3D's odometry, in one run.

    python benchmarks/speed.py [CAPTURE...] [--orb-slam3 PYTHON VOCABULARY] [--record]

Without captures: those of ../shared/captures, else a rendered apartment. For each, several times in
turn: SIFT on all cores from images in memory, by OpenCV's default settings and by vnav's; `vnav
build-map` from nothing, by its own report of each stage, by the default and by the preset fast;
ORB-SLAM3, by the Python of its own environment; SIFT again, so that other load on the machine
counts for both; and a map of the first half of the frames. Then Open3D's RGB-D odometry (hybrid) on
a sample of frame pairs. Times are medians over the runs; so are ratios, each to SIFT with OpenCV's
settings in the same run, those of fast to ORB-SLAM3. Exit code 1 where something wanted is missed.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from hard_versions import Source, write, write_camera
from numpy.typing import NDArray
from recording import ROOT, Measurement, add_record_option, missed, record, table

from vnav.config import CaptureConfig, FeaturesConfig
from vnav.features import front_end
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture
from vnav.io.sources.rectify import rectified
from vnav.io.store.map_folder import STAGES
from vnav.synthetic import DEMO, cached_capture

SHARED = ROOT.parent / "shared" / "captures"
ORB_SLAM3 = ROOT.parent / "shared" / "peers" / "orbslam3.py"
SIFT_FRAMES, OPEN3D_PAIRS, RUNS = 150, 20, 3
SIFT, PEER = "SIFT alone, OpenCV's settings", "ORB-SLAM3"
FAST, BUT_FUSE = "--config fast", "all but fuse"
WANTED_OF_SIFT = {  # wall time of all stages
    "house": 1.6,
    "redkitchen01": 1.2,
    "fr1_desk": 1.2,
}
WANTED_OF_PEER = {  # wall time by the preset fast
    ("house", BUT_FUSE): 2.0,
    ("redkitchen01", BUT_FUSE): 1.5,
    ("redkitchen01", "all"): 1.8,
    ("fr1_desk", BUT_FUSE): 1.5,
    ("fr1_desk", "all"): 1.8,
}
WANTED_MB, WANTED_DOUBLING = 1000, 2.2

Image = NDArray[np.uint8]
Reports = dict[str, dict[str, Any]]  # by stage
Times = NDArray[np.float64]  # (2,): wall and CPU, milliseconds a frame
Rows = dict[str, Times]


def captures(asked: Sequence[str]) -> list[Path]:
    """What is asked for, else what is there."""
    if asked:
        return [Path(path) for path in asked]
    shared = [SHARED / name for name in WANTED_OF_SIFT]
    return shared if all(path.is_dir() for path in shared) else [cached_capture(DEMO)]


def evenly(capture: Capture, count: int) -> list[int]:
    """Frames spread over the capture."""
    return np.unique(np.linspace(0, len(capture) - 1, count).round().astype(int)).tolist()


def ms_a_frame(extract: Callable[[Image], Any], images: Sequence[Image]) -> Times:
    """Wall and CPU time of one image when all cores are at it; the first ones do not count."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(extract, images[:8]))
        started = time.perf_counter(), time.process_time()
        list(pool.map(extract, images))
        ended = time.perf_counter(), time.process_time()
    return np.subtract(ended, started) / len(images) * 1e3


def default_sift() -> Callable[[Image], Any]:
    """OpenCV's SIFT as it comes, one detector a thread."""
    own = threading.local()

    def extract(color: Image) -> Any:
        if not hasattr(own, "sift"):
            own.sift = cv2.SIFT.create()
        return own.sift.detectAndCompute(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), None)

    return extract


def sift_ms(images: Sequence[Image]) -> tuple[Times, Times]:
    """By OpenCV's settings, and by vnav's."""
    vnav = front_end(FeaturesConfig())
    return ms_a_frame(default_sift(), images), ms_a_frame(vnav.extract, images)


def open3d_ms(capture: Capture) -> Times:
    """Median times of Open3D's hybrid RGB-D odometry between neighbours, as it comes."""
    import open3d as o3d

    intrinsics = capture.camera.color
    camera = o3d.camera.PinholeCameraIntrinsic(
        *intrinsics.size, intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy
    )
    hybrid = o3d.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm()
    option = o3d.pipelines.odometry.OdometryOption()

    def image(index: int) -> Any:
        frame = capture.read(index)
        return o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(np.ascontiguousarray(frame.color)),
            o3d.geometry.Image(np.ascontiguousarray(frame.depth_m)),
            depth_scale=1.0,
            depth_trunc=8.0,
        )

    seconds = []
    for k in evenly(capture, OPEN3D_PAIRS + 1)[:-1]:
        a, b = image(k), image(k + 1)
        started = time.perf_counter(), time.process_time()
        o3d.pipelines.odometry.compute_rgbd_odometry(b, a, camera, np.eye(4), hybrid, option)
        ended = time.perf_counter(), time.process_time()
        seconds.append(np.subtract(ended, started))
    return np.asarray(np.median(seconds, 0)) * 1e3


def build(capture: Path, folder: Path, *options: str) -> Reports:
    """Reports of a fresh map, by stage; "map" is the whole."""
    command = [sys.executable, "-P", "-m", "vnav", "build-map", capture, "--map", folder, *options]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    reports = folder / "reports"
    return {s: json.loads((reports / f"{s}.json").read_text("utf-8")) for s in (*STAGES, "map")}


def first_half(capture: Path, folder: Path) -> Path:
    """The capture's first half as a TUM capture; its images stay where they are."""
    pairs = open_capture(capture, CaptureConfig()).files.pairs
    folder.mkdir()
    for name in ("color", "depth"):
        images = [getattr(pair, name) for pair in pairs[: len(pairs) // 2]]
        lines = [f"{image.stamp_s:.6f} {image.path.resolve()}" for image in images]
        path = folder / f"{'rgb' if name == 'color' else name}.txt"
        path.write_text("\n".join([*lines, ""]), "utf-8")
    shutil.copy(capture / "camera.toml", folder)
    return folder


def stage_ms(reports: Reports, stages: Sequence[str], count: int) -> Times:
    """What these stages took."""
    keys = ("seconds", "cpu_seconds")
    return np.array([[reports[s][k] for k in keys] for s in stages]).sum(0) / count * 1e3


def orb_slam3_ms(peer: Sequence[str], capture: Path, scratch: Path) -> Times:
    """What ORB-SLAM3 tells of a frame, tracked as fast as it can and read in the same loop."""
    stamps_s = open_capture(capture, CaptureConfig()).stamps_s
    fps = round(1 / float(np.median(np.diff(stamps_s))))
    python, vocabulary = peer
    command = [python, ORB_SLAM3, "run", vocabulary, capture, scratch / "peer.tum", "--fps", fps]
    told = subprocess.run([*map(str, command)], check=True, text=True, capture_output=True).stdout
    found = re.search(r"([0-9.]+) ms/frame wall, ([0-9.]+) CPU", told)
    if found is None:
        raise ValueError(f"expected the time of a frame from {python}, found {told!r}")
    return np.array([float(number) for number in found.groups()])


def registered(path: Path, folder: Path) -> Path:
    """The capture; written as frames are read if its depth is not registered to colour."""
    capture = open_capture(path, CaptureConfig())
    if capture.camera.is_registered:
        return path
    units, rows = capture.camera.units_per_metre, range(len(capture))

    def color(row: int, _image: Image) -> Image:
        return cv2.cvtColor(capture.read(row).color, cv2.COLOR_RGB2BGR)

    def depth(row: int, _image: Image) -> NDArray[np.uint16]:
        return np.rint(capture.read(row).depth_m * units).astype(np.uint16)

    write(Source.open(path), folder, rows, color, depth)
    seen = replace(capture.camera, color=rectified(capture.camera), depth=None, T_color_depth=None)
    write_camera(folder / "camera.toml", seen)
    return folder


def rows_of(sift: Sequence[Times], whole: Reports, fast: Reports, count: int) -> Rows:
    """The times of one run, of SIFT by either settings and of either map."""
    but_fuse = [stage for stage in STAGES if stage != "fuse"]
    return {
        SIFT: sift[0],
        "SIFT alone, vnav's settings": sift[1],
        **{stage: stage_ms(whole, [stage], count) for stage in STAGES},
        BUT_FUSE: stage_ms(whole, but_fuse, count),
        "all": stage_ms(whole, STAGES, count),
        f"{FAST}, {BUT_FUSE}": stage_ms(fast, but_fuse, count),
        f"{FAST}, all": stage_ms(fast, STAGES, count),
    }


def measure(
    path: Path, scratch: Path, peer: Sequence[str] | None
) -> tuple[list[Measurement], list[Measurement]]:
    """The times that one capture takes, in turns with its peers and its first half; its memory."""
    capture = open_capture(path, CaptureConfig())
    count = len(capture)
    images = [np.array(capture.read(k).color) for k in evenly(capture, SIFT_FRAMES)]
    half_capture = first_half(path, scratch / "half_capture")
    of_peer = registered(path, scratch / "registered") if peer else path
    runs: list[Rows] = []
    doubling, memory_mb = [], 0
    for run in range(RUNS):
        before = sift_ms(images)
        whole = build(path, scratch / f"whole_{run}")
        fast = build(path, scratch / f"fast_{run}", *FAST.split())
        others = {PEER: orb_slam3_ms(peer, of_peer, scratch)} if peer else {}
        sift = np.mean([before, sift_ms(images)], 0)
        half = build(half_capture, scratch / f"half_{run}")
        others[f"Open3D hybrid odometry, {OPEN3D_PAIRS} pairs"] = open3d_ms(capture)
        runs.append(rows_of(sift, whole, fast, count) | others)
        doubling.append(stage_ms(whole, ["map"], count) / stage_ms(half, ["map"], count // 2) * 2)
        memory_mb = max(memory_mb, whole["map"]["values"]["peak_memory_mb"])
    load = " ".join(f"{value:.1f}" for value in os.getloadavg())
    print(f"\n## {path.name}: {count} frames, {os.cpu_count()} cores, load {load}\n")
    times = [*compared(path.name, runs), scaling(path.name, doubling)]
    limit = f"at most {WANTED_MB}"
    return times, [Measurement(path.name, "build-map", "peak memory", memory_mb, "MB", limit)]


def compared(name: str, runs: Sequence[Rows]) -> list[Measurement]:
    """Medians over the runs of a frame's times, and of their ratios to peers' of the same run."""
    on, found = f"{name}, a frame", list[Measurement]()
    for what in runs[0]:
        wall_ms, cpu_ms = np.median([rows[what] for rows in runs], 0).tolist()
        found += [
            Measurement(on, what, "wall time", wall_ms, "ms"),
            Measurement(on, what, "CPU time", cpu_ms, "ms"),
            *ratios(on, what, SIFT, runs, WANTED_OF_SIFT.get(name) if what == "all" else None),
        ]
        part = what.removeprefix(f"{FAST}, ")
        if part != what and PEER in runs[0]:
            found += ratios(on, what, PEER, runs, WANTED_OF_PEER.get((name, part)))
    return found


def ratios(
    on: str, what: str, peer: str, runs: Sequence[Rows], wanted: float | None
) -> list[Measurement]:
    """Medians of the ratios of a frame's times; ``wanted``: the most that wall time may be."""
    wall, cpu = np.median([rows[what] / rows[peer] for rows in runs], 0).tolist()
    limit = f"at most {wanted:g}" if wanted else None
    return [
        Measurement(on, what, "wall time, ratio", wall, "", limit, peer),
        Measurement(on, what, "CPU time, ratio", cpu, "", None, peer),
    ]


def scaling(name: str, doubling: Sequence[Times]) -> Measurement:
    """How many times as long the whole capture takes as its first half."""
    ratio, limit = float(np.median(doubling, 0)[0]), f"at most {WANTED_DOUBLING:g}"
    on, peer = f"{name}, all frames", "its first half"
    return Measurement(on, "build-map", "wall time, ratio", ratio, "", limit, peer)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("captures", nargs="*", metavar="CAPTURE")
    parser.add_argument(
        "--orb-slam3",
        nargs=2,
        metavar=("PYTHON", "VOCABULARY"),
        help="of an environment with pyorbslam3, for ../shared/peers/orbslam3.py",
    )
    add_record_option(parser)
    asked, good = parser.parse_args(arguments), True
    for path in captures(asked.captures):
        with tempfile.TemporaryDirectory() as scratch:
            times, memory = measure(path, Path(scratch), asked.orb_slam3)
        print(f"{table(times)}\n\n{table(memory)}", flush=True)
        good &= not missed([*times, *memory])
        if asked.record:  # memory is accuracy.py's to record
            record(f"map_speed_{path.name}", "how fast", times, arguments)
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
