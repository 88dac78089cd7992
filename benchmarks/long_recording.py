"""How time and memory grow with a recording: a capture walked up and down, with new noise.

    python benchmarks/long_recording.py OUT CAPTURE [--frames 18000] [--record]

builds two maps in OUT by `vnav.build_map`: of the first 1000 frames of such a recording, and of
all. Every frame has noise of its own on top of the capture's, in colour and depth. A place is seen
again on every way. Exit code 1 where something wanted is missed. 18,000 frames take half an hour.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from recording import Measurement, add_record_option, conclude

import vnav
from vnav.config import CaptureConfig
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.core.trajectory import Trajectory
from vnav.evaluation.score import score
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.map_folder import STAGES

SHORT = 1000  # frames, that the time of a frame is held against
GREY_SIGMA, DEPTH_SIGMA_PER_M2 = 2.0, 0.0015
WANTED_GROWTH, WANTED_MB = 1.2, 4000
MOST_OFF_S = 0.02  # from a frame to its true pose


@dataclass(frozen=True)
class UpAndDown:
    """A capture of so many frames: another one forwards, backwards, and so on."""

    source: Capture
    frames: int

    @property
    def name(self) -> str:
        """Of the map's capture."""
        return f"{self.source.name}_up_and_down"

    @property
    def camera(self) -> Camera:
        """That of the source."""
        return self.source.camera

    @property
    def has_depth(self) -> bool:
        """That the source has."""
        return self.source.has_depth

    @property
    def poses(self) -> Trajectory | None:
        """None are known."""
        return None

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Which frame (N,) of the source each one is."""
        there = np.arange(len(self.source))
        way = np.concatenate([there, there[-2:0:-1]])
        return np.resize(way, self.frames)

    @cached_property
    def stamps_s(self) -> NDArray[np.float64]:
        """Times (N,), at the source's rate."""
        step_s = float(np.median(np.diff(self.source.stamps_s)))
        return self.source.stamps_s[0] + step_s * np.arange(self.frames)

    def __len__(self) -> int:
        return self.frames

    def read(self, index: int) -> Frame:
        """The source's frame, with noise that no other has."""
        frame, rng = self.source.read(int(self.rows[index])), np.random.default_rng([index])
        noise = GREY_SIGMA * rng.standard_normal(frame.color.shape, np.float32)
        color = np.clip(frame.color + noise + 0.5, 0, 255).astype(np.uint8)
        off = DEPTH_SIGMA_PER_M2 * rng.standard_normal(frame.depth_m.shape, np.float32)
        depth_m = np.maximum(frame.depth_m + off * frame.depth_m**2, 0)
        stamp_s = float(self.stamps_s[index])
        return replace(frame, index=index, stamp_s=stamp_s, color=color, depth_m=depth_m)

    def fingerprint(self) -> str:
        """Of the source, and of how often it is walked."""
        return sha256(f"{self.source.fingerprint()} {self.frames}".encode()).hexdigest()


def truth(capture: UpAndDown, path: Path) -> Trajectory:
    """True poses at the times of the frames that have one."""
    known = read_tum(path)
    asked_s = capture.source.stamps_s[capture.rows]
    nearest = np.abs(known.stamps_s[:, None] - capture.source.stamps_s).argmin(0)[capture.rows]
    near = np.abs(known.stamps_s[nearest] - asked_s) < MOST_OFF_S
    return Trajectory(capture.stamps_s[near], known.T_world_camera[nearest[near]])


def measure(out: Path, path: Path, frames: int) -> list[Measurement]:
    """Time of a frame by stage, memory and error, of a short recording and of the long one."""
    source, found = open_capture(path, CaptureConfig()), list[Measurement]()
    short: dict[str, float] = {}
    for count in (SHORT, frames):
        capture, folder = UpAndDown(source, count), out / f"{path.name}_{count}"
        vnav.build_map(capture, folder, progress=tell)
        seconds = {stage: report(folder, stage)["seconds"] / count for stage in (*STAGES, "map")}
        short = short or seconds
        on = f"{path.name} up and down, {count} frames"
        found += [*right(capture, folder, path, on), *times(seconds, short, on)]
    return found


def right(capture: UpAndDown, folder: Path, path: Path, on: str) -> list[Measurement]:
    """How large and how exact a map is."""
    memory_mb = report(folder, "map")["values"]["peak_memory_mb"]
    estimate = read_tum(folder / "optimise" / "trajectory_0.tum")
    error = score(estimate, truth(capture, path / "groundtruth.txt"), MOST_OFF_S)
    return [
        Measurement(on, "build-map", "peak memory", memory_mb, "MB", f"at most {WANTED_MB}"),
        Measurement(on, "build-map", "frames with a pose", len(estimate)),
        Measurement(on, "build-map", "ATE RMSE", error.ate.translation_m.rmse, "m"),
    ]


def times(seconds: dict[str, float], short: dict[str, float], on: str) -> list[Measurement]:
    """The time of a frame by stage, and how it has grown from that of a short recording."""
    found = []
    for stage, each in seconds.items():
        limit = f"at most {WANTED_GROWTH:g}" if stage == "map" else None
        what, grown = "all" if stage == "map" else stage, each / short[stage]
        found.append(Measurement(on, what, "wall time", 1e3 * each, "ms"))
        peer = f"{SHORT} frames"
        found.append(Measurement(on, what, "wall time, ratio", grown, "", limit, peer))
    return found


def report(folder: Path, stage: str) -> dict[str, Any]:
    """What a stage reports."""
    found: dict[str, Any] = json.loads((folder / "reports" / f"{stage}.json").read_text("utf-8"))
    return found


def tell(task: str, done: int, total: int) -> None:
    """Say now and then how far it is."""
    if done % 500 == 0:
        print(f"{task} {done}/{total}", flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("capture", type=Path, metavar="CAPTURE")
    parser.add_argument("--frames", type=int, default=18000)
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    found = measure(asked.out, asked.capture, asked.frames)
    return conclude("long_recording", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
