"""The readers of single files, fuzzed: a value, or an error that a user can mend; nothing else."""

import hashlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from attacks.attempt import Attempt, anything
from attacks.maps import drawn
from attacks.mutations import spoilt, spoilt_text

Random = np.random.Generator


@dataclass(frozen=True)
class Kind:
    """A kind of files: who reads it, one that is intact, and what alters it.

    ``checked``: the format has checksums, so that what is altered is refused or reads the same.
    """

    read: Callable[[Path], Any]
    source: Callable[[Path], bytes]
    suffix: str
    text: bool = False
    checked: bool = False


def attempt(rng: Random, folder: Path) -> Attempt:
    """A file that was altered, given to its reader."""
    name = drawn(rng, list(KINDS))
    kind = KINDS[name]
    whole = folder / f"whole{kind.suffix}"
    whole.write_bytes(kind.source(folder))
    how, content = (spoilt_text if kind.text else spoilt)(whole.read_bytes(), rng)
    (folder / f"file{kind.suffix}").write_bytes(content)
    call = (read, (name, f"file{kind.suffix}"))
    return Attempt(f"{how} of {name}", call=call, judge=as_whole if kind.checked else anything)


def as_whole(result: Any, intact: Any) -> str:
    """What is read is that of the whole file, which the call read before."""
    return "" if "other than the whole" not in result.out else "another content in silence"


def read(name: str, path: str) -> int:
    """Read a file, and the whole one beside it."""
    from vnav.errors import VnavError

    kind = KINDS[name]
    whole = hashed(kind.read(Path(f"whole{kind.suffix}")))
    try:
        found = hashed(kind.read(Path(path)))
    except VnavError as error:
        print(f"vnav: {error}", file=sys.stderr)
        return 1
    print("as the whole" if found == whole else "other than the whole")
    return 0


def hashed(value: Any) -> str:
    """A hash of what was read."""
    digest = hashlib.sha256()
    for array in arrays(value):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def arrays(value: Any) -> Any:
    """All arrays and texts in a value."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, dict | list | tuple):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from arrays(inner)
    elif hasattr(value, "__dict__"):
        yield from arrays(vars(value))
    else:
        yield np.array(list(repr(value).encode()), np.uint8)


def the_file(name: str) -> Callable[[Path], bytes]:
    return lambda folder: (folder / name).read_bytes()


def an_image(suffix: str) -> Callable[[Path], bytes]:
    def source(folder: Path) -> bytes:
        return cv2.imencode(suffix, cv2.imread(str(folder / "photos" / "000.jpg")))[1].tobytes()

    return source


def a_depth_image(folder: Path) -> bytes:
    return sorted((folder / "capture" / "depth").iterdir())[0].read_bytes()


def arrays_of(path: Path) -> Any:
    from vnav.io.formats.arrays_file import load_arrays

    return load_arrays(path, "run it again")


def a_grid(path: Path) -> Any:
    from vnav.io.formats.grid_files import read_grid

    (path.parent / "grid.pgm").unlink(missing_ok=True)
    (path.parent / "grid.pgm").symlink_to("map/fuse/grid.pgm")
    return read_grid(path)


def a_grid_image(path: Path) -> Any:
    from vnav.io.formats.grid_files import read_grid

    text = Path("map/fuse/grid.yaml").read_text("utf-8").replace("grid.pgm", path.name)
    beside = path.with_suffix(".yaml")
    beside.write_text(text, "utf-8")
    return read_grid(beside)


def function(module: str, name: str) -> Callable[[Path], Any]:
    """A reader, imported where it is used: most are heavy."""

    def call(path: Path) -> Any:
        from importlib import import_module

        return getattr(import_module(f"vnav.io.{module}"), name)(path)

    return call


def settings_of(path: Path) -> Any:
    from vnav.config import load

    return load(str(path))


def a_suite(path: Path) -> Any:
    from vnav.io.datasets.suite_file import read_suite

    return read_suite(str(path))


def an_archive(path: Path) -> Any:
    from vnav.io.datasets.unpack import unpack

    return unpack(path, path.with_name(f"unpacked-{path.stem}"))


def packed(folder: Path) -> bytes:
    import io
    import tarfile

    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w:gz") as tar:
        tar.add(folder / "capture" / "depth", "depth")
    return content.getvalue()


SETTINGS = b"seed = 1\n[fuse]\nvoxel_m = 0.03\n[features.sift]\nroot_sift = true\n"
SUITE = b"""[suite]
name = "mine"
[[sequence]]
name = "one"
capture = "capture"
hold_out_every = 5
settings = {fuse = {voxel_m = 0.05}}
peers = [{system = "x", source = "y", ate_m = 0.01}]
"""
A_TOOLS_CAMERA = b"""{"width": 320, "height": 240, "depth_scale": 1000.0,
 "intrinsic_matrix": [262.5, 0.0, 0.0, 0.0, 262.5, 0.0, 159.5, 119.5, 1.0]}
"""
A_ROS_CAMERA = b"""image_width: 320
image_height: 240
camera_matrix:
  rows: 3
  cols: 3
  data: [262.5, 0, 159.5, 0, 262.5, 119.5, 0, 0, 1]
distortion_model: plumb_bob
d:
- 0.1
- 0.0
"""
KINDS = {
    "a camera": Kind(
        function("formats.camera_file", "read_camera"),
        the_file("capture/camera.toml"),
        ".toml",
        True,
    ),
    "a tool's camera": Kind(
        function("formats.camera_file", "read_camera"), lambda _: A_TOOLS_CAMERA, ".json", True
    ),
    "a camera of ROS": Kind(
        function("formats.camera_file", "read_camera"), lambda _: A_ROS_CAMERA, ".yaml", True
    ),
    "a trajectory": Kind(
        function("formats.trajectories", "read_tum"),
        the_file("capture/groundtruth.txt"),
        ".txt",
        True,
    ),
    "photo poses": Kind(
        function("formats.trajectories", "read_photo_poses"),
        lambda folder: b"# name\n000.jpg 1 2 3 0 0 0 1\n001.jpg 1 2 3.5 0 0 1 0\n",
        ".poses",
        True,
    ),
    "settings": Kind(settings_of, lambda folder: SETTINGS, ".set.toml", True),
    "a suite": Kind(a_suite, lambda folder: SUITE, ".suite.toml", True),
    "a grid": Kind(a_grid, the_file("map/fuse/grid.yaml"), ".grid.yaml", True),
    "a grid's image": Kind(a_grid_image, the_file("map/fuse/grid.pgm"), ".pgm"),
    "a cloud": Kind(function("formats.ply", "read_cloud"), the_file("map/fuse/cloud.ply"), ".ply"),
    "a mesh": Kind(
        function("formats.ply", "read_mesh"), the_file("map/fuse/mesh.ply"), ".mesh.ply"
    ),
    "arrays": Kind(arrays_of, the_file("map/optimise/map.npz"), ".npz"),
    "a PNG": Kind(function("formats.images", "read_image"), an_image(".png"), ".png", checked=True),
    "depth": Kind(
        function("formats.images", "read_depth"), a_depth_image, ".depth.png", checked=True
    ),
    "a JPEG": Kind(function("formats.images", "read_image"), an_image(".jpg"), ".jpg"),
    "a size": Kind(function("formats.images", "image_size"), an_image(".jpg"), ".size.jpg"),
    "a TIFF": Kind(function("formats.images", "read_image"), an_image(".tif"), ".tif"),
    "a WebP": Kind(function("formats.images", "read_image"), an_image(".webp"), ".webp"),
    "a BMP": Kind(function("formats.images", "read_image"), an_image(".bmp"), ".bmp"),
    "EXIF": Kind(function("photos.exif", "read_exif"), the_file("photos/000.jpg"), ".exif.jpg"),
    "an archive": Kind(an_archive, packed, ".tgz", checked=True),
}
