"""Drawn recordings as other recorders make them: hands, lenses and sensors with faults, by seed.

    python benchmarks/spoilt_walks.py OUT [--first 0] [--walks 12] [--config fast] [--record]

Renderings have a steady hand, a pinhole camera and even light. This takes the recordings of
drawn_walks.py from OUT/captures, rendered where they are not there, and writes each to
OUT/spoilt/captures with some of `FAULTS`. A hand that trembles is rendered, in OUT/trembling, so
that a late depth image sees it later. It maps them by `vnav build-map` to OUT/spoilt/maps, or to
one named as the preset is, each once, and scores the trajectory. Exit code 1 where a wrong map is
called good.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from drawn_walks import built_of, drawn, folders, of_poses, run, told, with_room
from hard_versions import Image, Source, write, write_camera
from numpy.typing import NDArray
from people import rendered
from recording import Measurement

from vnav.core.camera import Camera, Intrinsics
from vnav.synthetic import CaptureSpec

FAULTS = ("hand", "lens", "corners", "balance", "bands", "steps", "flying", "lost")
SHARE = 0.4  # of the recordings that have each
TREMOR_DEG, ROLL_DEG = (0.3, 1.5), (0, 15)  # of a hand
ZOOM = 1.3  # so that no place of a bent image lies outside of the rendered one
BASELINE_M, STEP_PX = 0.075, 1 / 8  # of a sensor that measures disparities
EDGE_M, FLYING = 0.1, 0.4  # of depth; share of the pixels there that hang between

Array = NDArray[np.float64]


def rng_of(seed: int, *of: int) -> np.random.Generator:
    """Of what a seed draws."""
    return np.random.default_rng([seed, 91, *of])


def faults_of(seed: int) -> tuple[str, ...]:
    """Those of `FAULTS` that a seed draws; one at least."""
    rng = rng_of(seed)
    found = tuple(fault for fault in FAULTS if rng.random() < SHARE)
    return found or (str(rng.choice(FAULTS)),)


def trembling(spec: CaptureSpec) -> CaptureSpec:
    """The same recording by a hand that trembles and rolls."""
    rng = rng_of(spec.seed, 2)
    tremor_deg, roll_deg = rng.uniform(*TREMOR_DEG), rng.uniform(*ROLL_DEG)
    return replace(spec, tremor_deg=tremor_deg, roll_deg=roll_deg)


@dataclass(frozen=True)
class Recorder:
    """Who makes a recording anew: its faults, and how large each is, all by the seed."""

    source: Source
    seed: int
    faults: tuple[str, ...]

    @cached_property
    def camera(self) -> Intrinsics:
        """What it records with: rendered pixels, nearer, and bent by a lens."""
        camera = self.source.camera.color
        if "lens" not in self.faults:
            return camera
        rng = rng_of(self.seed, 1)
        k1 = float(rng.uniform(-0.25, 0.15))
        distortion = (k1, -0.2 * k1, *rng.normal(0, 5e-4, 2).tolist())
        return replace(camera, fx=ZOOM * camera.fx, fy=ZOOM * camera.fy, distortion=distortion)

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
        rng, stamps_s = rng_of(self.seed, 3), self.source.stamps_s
        kept = np.ones(len(stamps_s), bool)
        longest = max(2, round(0.5 / float(np.median(np.diff(stamps_s)))))
        for first in rng.integers(5, len(kept) - 10, rng.integers(2, 7)):
            kept[first : first + rng.integers(1, longest)] = "lost" not in self.faults
        return np.flatnonzero(kept).tolist()

    @cached_property
    def places(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where its pixels lie in the rendered image: u and v (H, W)."""
        u, v = np.moveaxis(self.source.camera.color.project(self.rays), -1, 0)
        return u.astype(np.float32), v.astype(np.float32)

    def color(self, row: int, image: Image) -> Image:
        """What it makes of a colour image (H, W, 3)."""
        seen = cv2.remap(image, *self.places, cv2.INTER_LINEAR).astype(float)
        height, width = seen.shape[:2]
        y, x = np.mgrid[:height, :width]
        rng, t = rng_of(self.seed, 4), self.source.stamps_s[row]
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
        units = self.source.camera.units_per_metre
        depth_m = cv2.remap(image.astype(np.float32), *self.places, cv2.INTER_NEAREST) / units
        if "flying" in self.faults:
            rng, around = rng_of(self.seed, 5, row), np.ones((3, 3))
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


def spoilt(recorder: Recorder, folder: Path) -> Path:
    """The capture's folder, written where it is not there."""
    if not folder.is_dir():
        source, draft = recorder.source, folder.with_name(f"{folder.name}.draft")
        write(source, draft, recorder.rows, recorder.color, recorder.depth)
        camera = Camera(recorder.camera, source.camera.units_per_metre)
        write_camera(draft / "camera.toml", camera)
        draft.rename(folder)
    return folder


def measured(seed: int, out: Path, config: str) -> Iterator[Measurement]:
    """One recording: its map against the truth, and what the map says of itself."""
    spec, faults, where = drawn(seed), faults_of(seed), out
    if "hand" in faults:
        spec, where = trembling(spec), out / "trembling"
    spec = with_room(spec)
    rendering = rendered(folders(where, seed, config)[0], spec)
    folder, map_of = folders(out / "spoilt", seed, config)
    capture = spoilt(Recorder(Source.open(rendering), seed, faults), folder)
    on, what = f"{seed}: {told(spec)}; {' '.join(faults)}", f"vnav {config}".strip()
    score = built_of(capture, map_of, config)
    yield from of_poses(on, what, spec, capture, map_of, score)


def main(arguments: Sequence[str] | None = None) -> int:
    return run("spoilt_walks", __doc__, measured, arguments, 12)


if __name__ == "__main__":
    sys.exit(main())
