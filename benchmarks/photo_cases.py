"""Maps and the photos that are asked of them, with their true poses: made once, then reused."""

import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from calibrate_confidence import photos_of, true_poses
from numpy.typing import NDArray
from speed import SHARED

from vnav.io.formats.trajectories import read_tum
from vnav.io.store.map_folder import MapFolder
from vnav.synthetic.rendered_capture import KINECT, PHONE, CaptureSpec, write_capture

Array = NDArray[np.float64]

HALF, EVERY = 500, 10  # frames of the kitchen that are mapped; of the others, those asked
FRAMES_A_ROOM, PHOTOS = 65, 20  # of a building


@dataclass(frozen=True)
class Case:
    """A map and what it is asked: photos, their camera (None: beside them), their true poses."""

    name: str
    folder: MapFolder
    photos: list[Path]
    camera: Path | None
    truth: dict[str, Array]  # T_world_camera by file name

    @property
    def stem(self) -> str:
        """Its name, fit for a file's."""
        return self.name.replace("'", "").replace(", ", "_").replace(" ", "_")


def cases(out: Path) -> list[Case]:
    """What is there to ask photos of."""
    if (SHARED / "house").is_dir() and (SHARED / "redkitchen01").is_dir():
        return [house(out), kitchen_halves(out)]
    return [rendered(out, CaptureSpec("apartment", 200, 40, KINECT, PHONE))]


def house(out: Path, *options: str) -> Case:
    """The house as vnav maps it, with these options, and its photos."""
    capture = SHARED / "house"
    folder = built(out / "house", capture, None, *options)
    return Case("house", folder, photos_of(capture), None, true_poses(folder, capture))


def kitchen_halves(out: Path, *options: str) -> Case:
    """Half of the kitchen at its true poses, with these options; frames of the other half."""
    kitchen, half = SHARED / "redkitchen01", out / "redkitchen_half_capture"
    half.mkdir(parents=True, exist_ok=True)
    for name in ("rgb", "depth"):
        lines = (kitchen / f"{name}.txt").read_text("utf-8").splitlines()
        (half / f"{name}.txt").write_text("\n".join(lines[: HALF + 1]) + "\n", "utf-8")
        if not (half / name).exists():
            (half / name).symlink_to((kitchen / name).resolve())
    shutil.copy(kitchen / "camera.toml", half)
    folder = built(out / "redkitchen_half", half, kitchen / "groundtruth.txt", *options)
    photos = sorted((kitchen / "rgb").iterdir(), key=lambda path: float(path.stem))
    photos = photos[HALF::EVERY]
    truth = read_tum(kitchen / "groundtruth.txt")
    stamps = np.array([float(photo.stem) for photo in photos])
    rows = np.abs(truth.stamps_s - stamps[:, None]).argmin(1)
    poses = dict(zip((p.name for p in photos), truth.T_world_camera[rows], strict=True))
    camera = kitchen / "camera.toml"
    return Case("redkitchen01, other half", folder, photos, camera, poses)


def building(out: Path, rooms: int) -> Case:
    """A building of so many rooms, and photos taken in it."""
    small = KINECT.scaled(320, 240)
    frames = FRAMES_A_ROOM * rooms
    return rendered(out, CaptureSpec(f"building_{rooms}", frames, PHOTOS, small, PHONE))


def rendered(out: Path, spec: CaptureSpec) -> Case:
    """A rendered scene at its true poses, and its photos."""
    capture = out / spec.scene / "capture"
    if not capture.is_dir():
        write_capture(capture, spec)
    folder = built(out / spec.scene / "map", capture, capture / "groundtruth.txt")
    truth = true_poses(folder, capture)
    return Case(spec.scene, folder, photos_of(capture), None, truth)


def built(folder: Path, capture: Path, poses: Path | None = None, *options: str) -> MapFolder:
    """The map of a capture; what is there of it already is reused."""
    given = ("--trajectory", poses) if poses else ()
    build = command("build-map", capture, "--map", folder, *given, *options)
    subprocess.run(build, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return MapFolder.open(folder)


def command(*arguments: object) -> list[str]:
    """`vnav` with these arguments, as a process."""
    return [sys.executable, "-P", "-m", "vnav", *map(str, arguments)]
