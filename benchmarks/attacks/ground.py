"""What is attacked: a rendered capture, the finished map of it, and photos."""

import hashlib
import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from vnav.api.building import build_map
from vnav.api.map import open_map
from vnav.config import Config, FeaturesConfig
from vnav.io.store.map_folder import STAGES, to_json
from vnav.synthetic import MINIATURE, cached_capture

FRAMES = 6  # of a capture that is attacked: enough to be tracked
PHOTO_SCALE = 0.5  # as quick as possible
BESIDE = "camera.toml"


@dataclass(frozen=True)
class Ground:
    """Folders that nobody writes to: the parts of what an attempt gets.

    ``map``: finished, one photo of it remembered; ``capture``: TUM, short; ``photos``: of it, with
    their camera beside them.
    """

    root: Path

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the folders."""
        return ("map", "capture", "photos")

    def lay_out(self, folder: Path) -> None:
        """Make an attempt's folder: all parts, as links to their files."""
        for part in self.parts:
            shutil.copytree(self.root / part, folder / part, copy_function=os.link)
        (folder / "out").mkdir()

    def digest(self) -> str:
        """A hash of all of it: what it was at first, it must be at the end."""
        return hashlib.sha256(to_json(digests(self.root, self.parts)).encode()).hexdigest()


def made(root: Path, capture: Path | None = None, mapped: Path | None = None) -> Ground:
    """The ground in a folder: of a capture and its map, which are made where they are not given."""
    ground = Ground(root)
    if (root / "photos").is_dir():
        return ground
    capture = capture or cached_capture(MINIATURE, root / "rendered")
    shorten(capture, root / "capture")
    scale_photos(capture / "photos", root / "draft")
    if mapped is None:
        config = Config(features=FeaturesConfig(max_features=700))
        build_map(capture, root / "map", config=config)
    else:
        shutil.copytree(mapped, root / "map")
    open_map(root / "map").locate(root / "draft" / "000.jpg", remember=True)
    (root / "draft").rename(root / "photos")
    return ground


def shorten(capture: Path, folder: Path) -> None:
    """The first frames of a TUM capture, with all of its truth."""
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        lines = (capture / f"{kind}.txt").read_text("utf-8").splitlines()[: FRAMES + 1]
        (folder / f"{kind}.txt").write_text("\n".join([*lines, ""]), "utf-8")
        for line in lines[1:]:
            shutil.copy(capture / line.split()[1], folder / kind)
    for name in (BESIDE, "groundtruth.txt"):
        shutil.copy(capture / name, folder)


def scale_photos(photos: Path, folder: Path) -> None:
    """Smaller photos, and their camera."""
    folder.mkdir(parents=True)
    for path in sorted(photos.glob("*.jpg")):
        photo = cv2.resize(cv2.imread(str(path)), None, fx=PHOTO_SCALE, fy=PHOTO_SCALE)
        cv2.imwrite(str(folder / path.name), photo)
    size = photo.shape[1::-1]
    write_camera(photos / BESIDE, folder / BESIDE, size)


def write_camera(source: Path, target: Path, size: Sequence[int]) -> None:
    from vnav.io.formats.camera_file import read_color

    camera = read_color(source).scaled(*size)
    names = ("width", "height", "fx", "fy", "cx", "cy")
    lines = [f"{name} = {getattr(camera, name)}" for name in names]
    target.write_text("\n".join(["[color]", *lines, ""]), "utf-8")


def digests(folder: Path, outputs: Sequence[str]) -> dict[str, str]:
    """Hashes of the files below some folders in a folder, by name."""
    files = sorted(p for name in outputs for p in (folder / name).rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hash_of(p) for p in files}


def hash_of(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def replace(path: Path, content: bytes) -> None:
    """Write a file of an attempt anew, so that what it was a link to stays as it is."""
    path.unlink()
    path.write_bytes(content)


def sealed(values: dict[str, object]) -> bytes:
    """JSON as vnav seals it, whatever it says."""
    seal = hashlib.sha256(to_json(values).encode()).hexdigest()
    return to_json({**values, "sha256": seal}).encode()


def seal_anew(root: Path, stage: str) -> None:
    """Record a stage's files as they are, in it and in the stages that were made from it."""
    for name in STAGES[STAGES.index(stage) :]:
        path = root / name / "stage.json"
        record = json.loads(path.read_text("utf-8"))
        del record["sha256"]
        known = [each for each in record["inputs"] if each in STAGES]
        record["inputs"] |= {each: hash_of(root / each / "stage.json") for each in known}
        if name == stage:
            files = (p for p in (root / name).rglob("*") if p.is_file() and p != path)
            record["files"] = {p.relative_to(root / name).as_posix(): hash_of(p) for p in files}
        replace(path, sealed(record))
