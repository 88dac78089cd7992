"""Copies of what a map holds, in the formats that other programs read."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vnav.core.point_cloud import PointCloud
from vnav.core.posed_images import PosedImages
from vnav.errors import MapError
from vnav.io.files import whole_file, write_bytes, write_text
from vnav.io.formats import colmap
from vnav.io.formats.gltf import write_glb
from vnav.io.formats.las import require_laspy, write_las
from vnav.io.formats.ply import write_cloud, write_obj
from vnav.io.formats.trajectories import read_tum, write_kitti
from vnav.io.formats.transforms import DEPTH_UNITS_PER_METRE, write_transforms
from vnav.io.store.artifacts import load_cloud, load_keyframe_depth, load_mesh
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.posed_keyframes import load_posed_keyframes

Writer = Callable[[MapFolder, Path], list[Path]]


def export(
    folder: MapFolder, out: Path, wanted: Mapping[str, Sequence[str]]
) -> dict[str, list[Path]]:
    """Write what is wanted, parts and formats of `PARTS`, into ``out``; what each part became.

    That are files, and folders of images. Files of the same names are replaced. StaleArtifact names
    the command to run where a stage is missing, before anything is written; MapError where ``out``
    lies in the map or cannot be written, or where a format needs a package that is not installed.
    """
    if out.resolve().is_relative_to(folder.root.resolve()):
        raise MapError(
            f"expected to export to a folder outside the map {folder.root}, found {out}; name"
            " another with --out"
        )
    for part in wanted:
        folder.stage(PARTS[part].stage)
    if "las" in wanted.get("cloud", ()):
        require_laspy()
    try:
        out.mkdir(parents=True, exist_ok=True)
        return {
            part: [p for form in forms for p in PARTS[part].formats[form](folder, out)]
            for part, forms in wanted.items()
        }
    except OSError as error:
        raise MapError(
            f"expected to write to {out}, found: {error.strerror}; name another folder with --out"
        ) from error


def _copy(stage: str, *names: str) -> Writer:
    """A writer that copies files of a stage."""

    def write(folder: MapFolder, out: Path) -> list[Path]:
        return [_copied(folder.file(stage, name), out) for name in names]

    return write


def _trajectories(folder: MapFolder, out: Path) -> list[Path]:
    """One file a capture: ``stamp tx ty tz qx qy qz qw``, camera to world."""
    return [_copied(source, out) for source in _sources(folder)]


def _kitti_trajectories(folder: MapFolder, out: Path) -> list[Path]:
    """One file of poses a capture, and one of their times, which the format has no place for."""
    written = []
    for source in _sources(folder):
        trajectory = read_tum(source)
        poses, times = out / f"{source.stem}.kitti", out / f"{source.stem}.times"
        write_kitti(poses, trajectory)
        write_text(times, "".join(f"{stamp_s:.9f}\n" for stamp_s in trajectory.stamps_s))
        written += [poses, times]
    return written


def _sources(folder: MapFolder) -> list[Path]:
    """The trajectories of all captures."""
    names = [f"trajectory_{number}.tum" for number in range(len(folder.captures))]
    return [folder.file("optimise", name) for name in names if name in folder.files("optimise")]


def _copied(source: Path, out: Path) -> Path:
    with source.open("rb") as content, whole_file(out / source.name) as copy:
        shutil.copyfileobj(content, copy)
    return out / source.name


def _obj(folder: MapFolder, out: Path) -> list[Path]:
    write_obj(out / "mesh.obj", load_mesh(folder))
    return [out / "mesh.obj"]


def _glb(folder: MapFolder, out: Path) -> list[Path]:
    write_glb(out / "mesh.glb", load_mesh(folder))
    return [out / "mesh.glb"]


def _las(folder: MapFolder, out: Path) -> list[Path]:
    write_las(out / "cloud.las", load_cloud(folder))
    return [out / "cloud.las"]


def _colmap(folder: MapFolder, out: Path) -> list[Path]:
    """A model in the folders that COLMAP and its readers expect, beside the images."""
    views, sparse = load_posed_keyframes(folder), out / "sparse" / "0"
    sparse.mkdir(parents=True, exist_ok=True)
    return [_images(folder, views, out), *colmap.write_model(sparse, views)]


def _transforms(folder: MapFolder, out: Path) -> list[Path]:
    """Poses and cameras, images and depth, and the landmarks as a cloud to begin with."""
    views = load_posed_keyframes(folder)
    colors, depths = _images(folder, views, out), _depths(folder, views, out)
    path, cloud = out / "transforms.json", out / "landmarks.ply"
    write_cloud(cloud, PointCloud(views.landmarks.points_world, views.colors))
    write_transforms(path, views, colors.name, depths.name, cloud.name)
    return [colors, depths, cloud, path]


def _images(folder: MapFolder, views: PosedImages, out: Path) -> Path:
    """A folder of the keyframes' colour images."""
    (out / "images").mkdir(exist_ok=True)
    for image in views.images:
        _copied(folder.file("odometry", f"keyframes/{image.name}.jpg"), out / "images")
    return out / "images"


def _depths(folder: MapFolder, views: PosedImages, out: Path) -> Path:
    """A folder of their depth, 16 bits, 0 where there is none."""
    (out / "depths").mkdir(exist_ok=True)
    for image in views.images:
        depth = np.rint(load_keyframe_depth(folder, image.row) * DEPTH_UNITS_PER_METRE)
        _, data = cv2.imencode(".png", depth.astype(np.uint16))
        write_bytes(out / "depths" / f"{image.name}.png", data.tobytes())
    return out / "depths"


@dataclass(frozen=True)
class Part:
    """Something that a map holds: what it is, the stage that makes it, and a writer a format."""

    meaning: str
    stage: str
    formats: Mapping[str, Writer]


PARTS = {
    "trajectory": Part(
        "Poses of all frames.",
        "optimise",
        {"tum": _trajectories, "kitti": _kitti_trajectories},
    ),
    "cloud": Part(
        "The coloured cloud; LAS needs laspy.",
        "fuse",
        {"ply": _copy("fuse", "cloud.ply"), "las": _las},
    ),
    "octomap": Part(
        "Occupied and free space.",
        "fuse",
        {"bt": _copy("fuse", "occupancy.bt"), "ot": _copy("fuse", "occupancy.ot")},
    ),
    "grid": Part(
        "The grid and its walked corridor, as ROS map_server reads them.",
        "fuse",
        {"pgm": _copy("fuse", "grid.pgm", "grid.yaml", "walked.pgm", "walked.yaml")},
    ),
    "mesh": Part(
        "The coloured surface.",
        "fuse",
        {"ply": _copy("fuse", "mesh.ply"), "obj": _obj, "glb": _glb},
    ),
    "graph": Part("The pose graph.", "optimise", {"g2o": _copy("optimise", "graph.g2o")}),
    "colmap": Part(
        "Keyframes and landmarks as COLMAP's sparse model, with the images.",
        "optimise",
        {"txt": _colmap},
    ),
    "transforms": Part(
        "Keyframes as NeRF and Nerfstudio take them, with colour and depth images.",
        "optimise",
        {"json": _transforms},
    ),
}
