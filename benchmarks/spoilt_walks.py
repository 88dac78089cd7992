"""Drawn recordings as other recorders make them: hands, lenses and sensors with faults, by seed.

    python benchmarks/spoilt_walks.py OUT [--first 0] [--walks 12] [--config fast] [--record]

Renderings have a steady hand, a pinhole camera and even light. This takes the recordings of
drawn_walks.py from OUT/captures, rendered where they are not there, and writes each to
OUT/spoilt/captures with some of `FAULTS`. It maps them by `vnav build-map` to OUT/spoilt/maps, or
to one named as the preset is, each once, and scores the trajectory. Exit code 1 where a wrong map
is called good.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from drawn_walks import built_of, folders, of_poses, run, spec_of, told
from hard_versions import Image, Source, write, write_camera, write_turned
from numpy.typing import NDArray
from people import rendered
from recording import Measurement

from vnav.core import se3
from vnav.core.camera import Camera, Intrinsics
from vnav.io.formats.trajectories import read_tum

FAULTS = ("hand", "lens", "corners", "balance", "bands", "steps", "flying", "lost")
SHARE = 0.4  # of the recordings that have each
TREMOR_RAD, ROLL_RAD = 0.026, 0.26  # at most
ZOOM = 1.3  # so that no place of a turned or bent image lies outside of the rendered one
BASELINE_M, STEP_PX = 0.075, 1 / 8  # of a sensor that measures disparities
EDGE_M, FLYING = 0.1, 0.4  # of depth; share of the pixels there that hang between

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recorder:
    """Who makes a recording anew: its faults, and how large each is, all by the seed."""

    source: Source
    seed: int

    def _rng(self, *of: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, 91, *of])

    @cached_property
    def faults(self) -> tuple[str, ...]:
        """Those of `FAULTS` that it has; one at least."""
        rng = self._rng()
        drawn = tuple(fault for fault in FAULTS if rng.random() < SHARE)
        return drawn or (str(rng.choice(FAULTS)),)

    @cached_property
    def camera(self) -> Intrinsics:
        """What it records with: rendered pixels, nearer, and bent by a lens."""
        rng, camera = self._rng(1), self.source.camera.color
        zoom = ZOOM if {"hand", "lens"} & set(self.faults) else 1.0
        k1 = rng.uniform(-0.25, 0.15)
        bent = (k1, -0.2 * k1, *rng.normal(0, 5e-4, 2)) if "lens" in self.faults else ()
        distortion = tuple(float(k) for k in bent)
        return replace(camera, fx=zoom * camera.fx, fy=zoom * camera.fy, distortion=distortion)

    @cached_property
    def turns(self) -> Array:
        """How each frame is turned (N, 3, 3) against the rendered one: a hand trembles, rolls."""
        rng, t = self._rng(2), self.source.stamps_s - self.source.stamps_s[0]
        if "hand" not in self.faults:
            return np.broadcast_to(np.eye(3), (len(t), 3, 3))
        rate, phase = rng.uniform(0.5, 4, (2, 3)), rng.uniform(0, 2 * np.pi, (2, 3))
        waves = np.sin(2 * np.pi * rate * t[:, None, None] + phase).sum(1) / 2
        angles = waves * rng.uniform(0.2, 1, 3) * TREMOR_RAD
        angles[:, 2] += rng.uniform(0, ROLL_RAD) * np.sin(2 * np.pi * t / rng.uniform(4, 12))
        return np.array([se3.exp_so3(angle) for angle in angles])

    @cached_property
    def rays(self) -> Array:
        """Of its pixels (H, W, 3)."""
        width, height = self.camera.size
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 1, 2)
        bent = np.array(self.camera.distortion or (0.0, 0, 0, 0))
        x, y = cv2.undistortPoints(pixels.astype(float), self.camera.K, bent).reshape(-1, 2).T
        return np.stack([x, y, np.ones_like(x)], -1).reshape(height, width, 3)

    @cached_property
    def rows(self) -> list[int]:
        """Frames that are not lost: bursts of up to half a second are."""
        rng, stamps_s = self._rng(3), self.source.stamps_s
        kept = np.ones(len(stamps_s), bool)
        longest = max(2, round(0.5 / float(np.median(np.diff(stamps_s)))))
        for first in rng.integers(5, len(kept) - 10, rng.integers(2, 7)):
            kept[first : first + rng.integers(1, longest)] = "lost" not in self.faults
        return np.flatnonzero(kept).tolist()

    def _places(self, row: int) -> tuple[NDArray[np.float32], NDArray[np.float32], Array]:
        """Where its pixels lie in the rendered image, and how far along their rays 1 m is."""
        rays = self.rays @ self.turns[row].T
        u, v = np.moveaxis(self.source.camera.color.project(rays).astype(np.float32), -1, 0)
        return u, v, rays[..., 2]

    def color(self, row: int, image: Image) -> Image:
        """What it makes of a colour image (H, W, 3)."""
        u, v, _ = self._places(row)
        seen = cv2.remap(image, u, v, cv2.INTER_LINEAR).astype(float)
        height, width = seen.shape[:2]
        y, x = np.mgrid[:height, :width]
        rng, t = self._rng(4), self.source.stamps_s[row]
        if "corners" in self.faults:
            r2 = ((x - width / 2) ** 2 + (y - height / 2) ** 2) / (width / 2) ** 2
            seen *= (1 - rng.uniform(0.15, 0.3) * r2)[..., None]
        if "balance" in self.faults:
            phase, period_s = rng.uniform(0, 2 * np.pi, 3), rng.uniform(3, 15)
            seen *= 1 + rng.uniform(0.03, 0.12) * np.sin(phase + 2 * np.pi * t / period_s)
        if "bands" in self.faults:
            waves = np.sin(2 * np.pi * (rng.uniform(2, 5) * y / height + rng.uniform() * row))
            seen *= (1 + rng.uniform(0.05, 0.15) * waves)[..., None]
        return np.clip(seen + 0.5, 0, 255).astype(np.uint8)

    def depth(self, row: int, image: Image) -> Image:
        """What it makes of a depth image (H, W), in the units of the source."""
        u, v, along = self._places(row)
        units = self.source.camera.units_per_metre
        depth_m = cv2.remap(image.astype(np.float32), u, v, cv2.INTER_NEAREST) / along / units
        if "flying" in self.faults:
            rng, around = self._rng(5, row), np.ones((3, 3))
            farthest = cv2.dilate(depth_m, around)
            nearest = cv2.erode(np.where(depth_m > 0, depth_m, np.inf), around)
            hangs = (depth_m > 0) & (farthest - nearest > EDGE_M)
            hangs &= rng.random(depth_m.shape) < FLYING
            between = depth_m + rng.random(depth_m.shape) * (farthest - depth_m)
            depth_m = np.where(hangs, between, depth_m)
        if "steps" in self.faults:
            focal_m, known = self.camera.fx * BASELINE_M, depth_m > 0
            disparity = np.round(focal_m / depth_m[known] / STEP_PX) * STEP_PX
            depth_m[known] = focal_m / np.maximum(disparity, STEP_PX)
        return np.clip(np.round(depth_m * units), 0, 65535).astype(np.uint16)


def spoilt(capture: Path, seed: int, folder: Path) -> Recorder:
    """The recorder, whose capture is written where it is not there."""
    recorder = Recorder(Source.open(capture), seed)
    if folder.is_dir():
        return recorder
    draft = folder.with_name(f"{folder.name}.draft")
    write(recorder.source, draft, recorder.rows, recorder.color, recorder.depth)
    units = recorder.source.camera.units_per_metre
    write_camera(draft / "camera.toml", Camera(recorder.camera, units))
    truth = read_tum(capture / "groundtruth.txt")
    frame = np.abs(truth.stamps_s[:, None] - recorder.source.stamps_s).argmin(1)
    T_rendered_turned = np.array([se3.make(R, np.zeros(3)) for R in recorder.turns[frame]])
    write_turned(draft / "groundtruth.txt", truth, T_rendered_turned)
    draft.rename(folder)
    return recorder


def measured(seed: int, out: Path, config: str) -> Iterator[Measurement]:
    """One recording: its map against the truth, and what the map says of itself."""
    spec = spec_of(seed)
    rendering = rendered(folders(out, seed, config)[0], spec)
    capture, map_of = folders(out / "spoilt", seed, config)
    faults = " ".join(spoilt(rendering, seed, capture).faults)
    on, what = f"{seed}: {told(spec)}; {faults}", f"vnav {config}".strip()
    score = built_of(capture, map_of, config)
    yield from of_poses(on, what, spec, capture, map_of, score)


def main(arguments: Sequence[str] | None = None) -> int:
    return run("spoilt_walks", __doc__, measured, arguments, 12)


if __name__ == "__main__":
    sys.exit(main())
