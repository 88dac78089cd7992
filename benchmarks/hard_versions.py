"""Hard versions of a capture: what makes other systems lose track, written as TUM captures.

    python benchmarks/hard_versions.py CAPTURE... --out DIR

writes DIR/<capture>_<version>/, and two suites for `vnav evaluate`: DIR/hard.toml lists all,
DIR/seeds.toml the clean ones, to be run with several seeds. Images that are not changed are links
to the capture's own; changed ones are written without loss. All that is random comes from a seed.
Frames of which too little is left to ask anything are listed in unusable.txt beside their capture.
"""

import argparse
import os
import shutil
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.camera import Camera, Intrinsics
from vnav.core.trajectory import Trajectory
from vnav.io.formats.camera_file import camera_text, read_camera
from vnav.io.formats.trajectories import read_tum, write_tum
from vnav.io.sources import tum
from vnav.io.sources.frame_list import FramePair, ImageFile

BLUR_PX, BLURRED_EVERY = 9, 10
EXPOSURES, EXPOSED_FOR = (1.0, 0.5, 1.0, 2.0), 15  # of stored values; each jump is a factor of 2
DEPTH_BLOCK_PX = 80
CUT_S = 3.0
LAMP_LEFT, LAMP_REACH = 0.3, 0.28  # brightness far from the centre; share of the image width
LAMP_NOISE = 2.0  # grey levels: a darker image has no less of it
DROP_SEEDS = range(5)
LEAST_SEEN = 0.05  # share of the pixels that are neither black nor clipped in a usable image

Image = NDArray[np.uint8] | NDArray[np.uint16]
Change = Callable[[int, Image], Image | None]  # of a frame's image, None where it stays as it is


@dataclass(frozen=True)
class Source:
    """A TUM capture to make versions of."""

    root: Path
    camera: Camera
    frames: tuple[FramePair, ...]

    @classmethod
    def open(cls, root: Path) -> "Source":
        """The capture in a folder with rgb.txt, depth.txt, camera.toml and groundtruth.txt."""
        frames = tum.list_frames(root, CaptureConfig()).pairs
        return cls(root.resolve(), read_camera(root / "camera.toml"), frames)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Times (N,) of the frames."""
        return np.array([pair.color.stamp_s for pair in self.frames])


def unchanged(row: int, image: Image) -> None:
    """Leave the image as it is."""


def clean(source: Source, folder: Path) -> None:
    """The capture itself."""
    write(source, folder, range(len(source.frames)))


def every_third(source: Source, folder: Path) -> None:
    """One frame in three."""
    write(source, folder, range(0, len(source.frames), 3))


def dropped(share: float, seed: int) -> Callable[[Source, Path], None]:
    """The version that lacks a random share of the frames."""

    def version(source: Source, folder: Path) -> None:
        count = len(source.frames)
        kept = np.random.default_rng(seed).permutation(count)[round(share * count) :]
        write(source, folder, sorted(kept.tolist()))

    return version


def blurred(source: Source, folder: Path) -> None:
    """Every tenth frame smeared by 9 pixels in a random direction."""

    def smear(row: int, image: Image) -> Image | None:
        if row % BLURRED_EVERY != BLURRED_EVERY - 1:
            return None
        angle_rad = np.random.default_rng([0, row]).uniform(0, np.pi)
        return cv2.filter2D(image, -1, line_kernel(BLUR_PX, angle_rad))

    write(source, folder, range(len(source.frames)), color=smear)


def exposed(source: Source, folder: Path) -> None:
    """Exposure that jumps by a factor of 2 every 15 frames; what is too bright is clipped."""

    def expose(row: int, image: Image) -> Image | None:
        factor = EXPOSURES[row // EXPOSED_FOR % len(EXPOSURES)]
        return None if factor == 1 else cv2.convertScaleAbs(image, alpha=factor)

    write(source, folder, range(len(source.frames)), color=expose)


def lamp(source: Source, folder: Path) -> None:
    """A lamp on the camera: bright in the centre, three tenths of it in the corners."""

    def light(row: int, image: Image) -> Image:
        height, width = image.shape[:2]
        y, x = np.mgrid[:height, :width]
        r2 = ((x - (width - 1) / 2) ** 2 + (y - (height - 1) / 2) ** 2) / (LAMP_REACH * width) ** 2
        left = LAMP_LEFT + (1 - LAMP_LEFT) * np.exp(-r2)
        noise = np.random.default_rng([2, row]).normal(0, LAMP_NOISE, image.shape)
        return np.clip(image * left[..., None] + noise + 0.5, 0, 255).astype(np.uint8)

    write(source, folder, range(len(source.frames)), color=light)


def half_depth(source: Source, folder: Path) -> None:
    """Half of the blocks of every depth image missing, others in every frame."""

    def blank(row: int, image: Image) -> Image:
        rows, columns = (-(-size // DEPTH_BLOCK_PX) for size in image.shape)
        order = np.random.default_rng([1, row]).permutation(rows * columns)
        kept = (order < rows * columns // 2).reshape(rows, columns)
        mask = kept.repeat(DEPTH_BLOCK_PX, 0).repeat(DEPTH_BLOCK_PX, 1)
        return np.where(mask[: image.shape[0], : image.shape[1]], image, 0).astype(image.dtype)

    write(source, folder, range(len(source.frames)), depth=blank)


def black_first(source: Source, folder: Path) -> None:
    """The first colour image black."""

    def blacken(row: int, image: Image) -> Image | None:
        return np.zeros_like(image) if row == 0 else None

    write(source, folder, range(len(source.frames)), color=blacken)


def rolled(source: Source, folder: Path) -> None:
    """The camera turned by 90 degrees about its axis for the whole run: upright images."""

    def turn(row: int, image: Image) -> Image:
        return cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE)

    write(source, folder, range(len(source.frames)), color=turn, depth=turn)
    write_camera(folder / "camera.toml", rolled_camera(source.camera))
    truth = read_tum(source.root / "groundtruth.txt")
    T_camera_rolled = se3.inverse(se3.make(R_ROLLED_CAMERA, np.zeros(3)))
    turned = Trajectory(truth.stamps_s, truth.T_world_camera @ T_camera_rolled)
    (folder / "groundtruth.txt").unlink()
    write_tum(folder / "groundtruth.txt", turned)


def cut(source: Source, folder: Path) -> None:
    """Three seconds missing in the middle."""
    stamps = source.stamps_s
    off = np.abs(stamps - (stamps[0] + stamps[-1]) / 2)
    write(source, folder, np.flatnonzero(off > CUT_S / 2).tolist())


VERSIONS: dict[str, Callable[[Source, Path], None]] = {
    "clean": clean,
    "every_third": every_third,
    "dropped_20": dropped(0.20, 0),
    "blurred": blurred,
    "exposed": exposed,
    "lamp": lamp,
    "half_depth": half_depth,
    "black_first": black_first,
    "rolled": rolled,
    "cut": cut,
} | {f"dropped_2_seed_{seed}": dropped(0.02, seed) for seed in DROP_SEEDS}


# A camera rolled so that its images are turned clockwise: pixel (u, v) goes to (H - 1 - v, u).
R_ROLLED_CAMERA = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def rolled_camera(camera: Camera) -> Camera:
    """The camera of the turned images; depth that is not registered is turned with it."""
    if camera.depth is None or camera.T_color_depth is None:
        return Camera(rolled_intrinsics(camera.color), camera.units_per_metre)
    R = se3.make(R_ROLLED_CAMERA, np.zeros(3))
    T = R @ np.array(camera.T_color_depth) @ se3.inverse(R)
    rows = tuple(tuple(row) for row in T.tolist())
    depth = rolled_intrinsics(camera.depth)
    return Camera(rolled_intrinsics(camera.color), camera.units_per_metre, depth, rows)


def rolled_intrinsics(camera: Intrinsics) -> Intrinsics:
    """Pinhole and distortion of images turned clockwise: x and y become -y and x."""
    distortion = camera.distortion
    if distortion:
        k1, k2, p1, p2, *k3 = distortion
        distortion = (k1, k2, p2, -p1, *k3)
    return Intrinsics(
        camera.height,
        camera.width,
        camera.fy,
        camera.fx,
        camera.height - 1 - camera.cy,
        camera.cx,
        distortion,
    )


def line_kernel(length_px: int, angle_rad: float) -> NDArray[np.float64]:
    """A kernel (length, length) that averages along a line through its centre; sums to 1."""
    steps = np.linspace(-0.5, 0.5, 32 * length_px + 1) * (length_px - 1)
    column, row = steps * np.cos(angle_rad), steps * np.sin(angle_rad)
    kernel = np.zeros((length_px, length_px))
    centre = length_px // 2
    for r in range(length_px):
        for c in range(length_px):
            near_c = np.maximum(0, 1 - np.abs(column - (c - centre)))
            near_r = np.maximum(0, 1 - np.abs(row - (r - centre)))
            kernel[r, c] = (near_c * near_r).sum()
    return kernel / kernel.sum()


def write(
    source: Source,
    folder: Path,
    rows: Iterable[int],
    color: Change = unchanged,
    depth: Change = unchanged,
) -> None:
    """A capture of these frames of the source, some of their images changed."""
    rows = list(rows)
    (folder / "changed").mkdir(parents=True)
    (folder / "original").symlink_to(source.root, target_is_directory=True)
    for name in ("camera.toml", "groundtruth.txt"):
        (folder / name).symlink_to(source.root / name)
    unusable: list[str] = []

    def written(file: ImageFile, name: str, row: int, change: Change) -> str:
        """Where, below the folder, an image lies: among the originals, or changed."""
        image = cv2.imread(str(file.path), cv2.IMREAD_UNCHANGED) if change != unchanged else None
        image = None if image is None else change(row, image)
        if image is None:
            return f"original/{os.path.relpath(file.path.resolve(), source.root)}"
        if name == "rgb" and not usable(image):
            unusable.append(f"{file.stamp_s:.6f}")
        changed = f"changed/{name}_{row:06d}.png"
        _, data = cv2.imencode(".png", image, (cv2.IMWRITE_PNG_COMPRESSION, 1))
        (folder / changed).write_bytes(data.tobytes())
        return changed

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for name, change in (("rgb", color), ("depth", depth)):
            pairs = [source.frames[k] for k in rows]
            files = [pair.color if name == "rgb" else pair.depth for pair in pairs]
            count = len(rows)
            paths = pool.map(written, files, [name] * count, rows, [change] * count)
            lines = [f"{f.stamp_s:.6f} {p}" for f, p in zip(files, paths, strict=True)]
            (folder / f"{name}.txt").write_text("\n".join(["# time file", *lines, ""]), "utf-8")
    (folder / "unusable.txt").write_text("".join(f"{s}\n" for s in sorted(unusable)), "utf-8")


def usable(color: Image) -> bool:
    """Whether enough of a colour image is neither black nor clipped."""
    seen = ((color > 0) & (color < 255)).any(-1)
    return bool(seen.mean() >= LEAST_SEEN)


def write_camera(path: Path, camera: Camera) -> None:
    """Replace a camera.toml."""
    path.unlink()
    path.write_text(f"{camera_text(camera)}\n", "utf-8")


def write_suite(path: Path, captures: list[str], versions: Iterable[str]) -> None:
    """A suite of these versions of these captures, that lie beside it."""
    lines = ["[suite]", f'description = "{", ".join(captures)}: where others lose track"']
    for name in [(capture, version) for capture in captures for version in versions]:
        lines += ["", "[[sequence]]", f'name = "{"/".join(name)}"', f'capture = "{"_".join(name)}"']
    path.write_text("\n".join([*lines, ""]), "utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description="Write hard versions of captures.")
    parser.add_argument("captures", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    for capture in asked.captures:
        source = Source.open(capture)
        for name, version in VERSIONS.items():
            folder = asked.out / f"{source.root.name}_{name}"
            if not folder.exists():
                draft = folder.with_name(f".{folder.name}.draft")
                shutil.rmtree(draft, ignore_errors=True)
                version(source, draft)
                draft.rename(folder)
            print(folder)
    names = [capture.resolve().name for capture in asked.captures]
    write_suite(asked.out / "hard.toml", names, VERSIONS)
    write_suite(asked.out / "seeds.toml", names, ["clean"])


if __name__ == "__main__":
    main()
