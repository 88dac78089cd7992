"""Copies of what a map holds, in the formats that other programs read."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from vnav.errors import MapError
from vnav.io.formats.ply import read_mesh, write_obj
from vnav.io.formats.trajectories import read_tum, write_kitti
from vnav.io.store.map_folder import MapFolder, write_text

Writer = Callable[[MapFolder, Path], list[Path]]


def export(folder: MapFolder, out: Path, wanted: Mapping[str, str]) -> dict[str, list[Path]]:
    """Write what is wanted (kinds and formats of `FORMATS`) into ``out``; the files of each kind.

    Files of the same names are replaced. StaleArtifact names the command to run where a stage is
    missing, before anything is written; MapError where ``out`` lies in the map or cannot be
    written.
    """
    if out.resolve().is_relative_to(folder.root.resolve()):
        raise MapError(
            f"expected to export to a folder outside the map {folder.root}, found {out}; name"
            " another with --out"
        )
    for kind in wanted:
        folder.stage(STAGE_OF[kind])
    try:
        out.mkdir(parents=True, exist_ok=True)
        return {kind: FORMATS[kind][form](folder, out) for kind, form in wanted.items()}
    except OSError as error:
        raise MapError(
            f"expected to write to {out}, found: {error.strerror}; name another folder with --out"
        ) from error


def _copy(stage: str, *names: str) -> Writer:
    """A writer that copies files of a stage."""

    def write(folder: MapFolder, out: Path) -> list[Path]:
        source = folder.stage(stage)
        return [Path(shutil.copyfile(source / name, out / name)) for name in names]

    return write


def _trajectories(folder: MapFolder, out: Path) -> list[Path]:
    """One file a capture: ``stamp tx ty tz qx qy qz qw``, camera to world."""
    sources = sorted(folder.stage("optimise").glob("trajectory_*.tum"))
    return [Path(shutil.copyfile(source, out / source.name)) for source in sources]


def _kitti_trajectories(folder: MapFolder, out: Path) -> list[Path]:
    """One file of poses a capture, and one of their times, which the format has no place for."""
    written = []
    for source in sorted(folder.stage("optimise").glob("trajectory_*.tum")):
        trajectory = read_tum(source)
        poses, times = out / f"{source.stem}.kitti", out / f"{source.stem}.times"
        write_kitti(poses, trajectory)
        write_text(times, "".join(f"{stamp_s:.9f}\n" for stamp_s in trajectory.stamps_s))
        written += [poses, times]
    return written


def _obj(folder: MapFolder, out: Path) -> list[Path]:
    write_obj(out / "mesh.obj", read_mesh(folder.stage("fuse") / "mesh.ply"))
    return [out / "mesh.obj"]


FORMATS: dict[str, dict[str, Writer]] = {
    "trajectory": {"tum": _trajectories, "kitti": _kitti_trajectories},
    "cloud": {"ply": _copy("fuse", "cloud.ply")},
    "octomap": {"bt": _copy("fuse", "occupancy.bt"), "ot": _copy("fuse", "occupancy.ot")},
    "grid": {"pgm": _copy("fuse", "grid.pgm", "grid.yaml")},
    "mesh": {"ply": _copy("fuse", "mesh.ply"), "obj": _obj},
    "graph": {"g2o": _copy("optimise", "graph.g2o")},
}
STAGE_OF = {kind: "optimise" if kind in ("trajectory", "graph") else "fuse" for kind in FORMATS}
