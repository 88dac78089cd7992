"""Copies of what a map holds, in the formats that other programs read."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vnav.errors import MapError
from vnav.io.files import whole_file, write_text
from vnav.io.formats.ply import read_mesh, write_obj
from vnav.io.formats.trajectories import read_tum, write_kitti
from vnav.io.store.map_folder import MapFolder

Writer = Callable[[MapFolder, Path], list[Path]]


def export(
    folder: MapFolder, out: Path, wanted: Mapping[str, Sequence[str]]
) -> dict[str, list[Path]]:
    """Write what is wanted, parts and formats of `PARTS`, into ``out``; the files of each part.

    Files of the same names are replaced. StaleArtifact names the command to run where a stage is
    missing, before anything is written; MapError where ``out`` lies in the map or cannot be
    written.
    """
    if out.resolve().is_relative_to(folder.root.resolve()):
        raise MapError(
            f"expected to export to a folder outside the map {folder.root}, found {out}; name"
            " another with --out"
        )
    for part in wanted:
        folder.stage(PARTS[part].stage)
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
    write_obj(out / "mesh.obj", read_mesh(folder.file("fuse", "mesh.ply")))
    return [out / "mesh.obj"]


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
    "cloud": Part("The coloured cloud.", "fuse", {"ply": _copy("fuse", "cloud.ply")}),
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
    "mesh": Part("The coloured surface.", "fuse", {"ply": _copy("fuse", "mesh.ply"), "obj": _obj}),
    "graph": Part("The pose graph.", "optimise", {"g2o": _copy("optimise", "graph.g2o")}),
}
