"""Copies of what a map holds, in the formats that other programs read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from vnav.errors import MapError
from vnav.io.files import copy_into, write_text
from vnav.io.formats.las import require_laspy
from vnav.io.formats.rrd import require_rerun
from vnav.io.formats.trajectories import read_tum, write_kitti
from vnav.io.store.map_folder import MapFolder

Writer = Callable[[MapFolder, Path], list[Path]]


def export(
    folder: MapFolder, out: Path, wanted: Mapping[str, Sequence[str]]
) -> dict[str, list[Path]]:
    """Write what is wanted, parts and formats of `PARTS`, into ``out``; what each part became.

    That are files, and folders of images. Files of the same names are replaced. StaleArtifact names
    the command to run where a stage is missing, before anything is written; MapError where ``out``
    lies in the map or cannot be written, where a part or a format is unknown, or where it needs a
    package that is not installed.
    """
    if out.resolve().is_relative_to(folder.root.resolve()):
        raise MapError(
            f"expected to export to a folder outside the map {folder.root}, found {out}; name"
            " another with --out"
        )
    for part, forms in wanted.items():
        _require_known(part, forms)
        folder.stage(PARTS[part].stage)
        for form in forms:
            _require_package(part, form)
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


def everything() -> tuple[dict[str, list[str]], list[str]]:
    """Every part in every format that can be written here, and why some formats cannot."""
    possible, reasons = dict[str, list[str]](), list[str]()
    for name, part in PARTS.items():
        for form in part.formats:
            try:
                _require_package(name, form)
            except MapError as error:
                reasons.append(str(error))
            else:
                possible.setdefault(name, []).append(form)
    return possible, reasons


def _require_known(part: str, forms: Sequence[str]) -> None:
    """MapError where a map has no such part, or it cannot be written so."""
    if part not in PARTS:
        raise MapError(f"expected a part of a map, of {', '.join(PARTS)}, found {part!r}")
    for form in forms:
        if form not in PARTS[part].formats:
            possible = " or ".join(PARTS[part].formats)
            raise MapError(
                f"expected the format of the part {part} to be {possible}, found {form!r}"
            )


def _require_package(part: str, form: str) -> None:
    """MapError where a format needs a package that is not installed."""
    if (part, form) in PACKAGES:
        PACKAGES[part, form]()


def _copy(stage: str, *names: str) -> Writer:
    """A writer that copies files of a stage."""

    def write(folder: MapFolder, out: Path) -> list[Path]:
        return [copy_into(out, folder.file(stage, name)) for name in names]

    return write


def _trajectories(folder: MapFolder, out: Path) -> list[Path]:
    """One file a capture: ``stamp tx ty tz qx qy qz qw``, camera to world."""
    return [copy_into(out, source) for source in _sources(folder)]


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


def _made(name: str) -> Writer:
    """A writer of `vnav.io.store.conversions`, which takes long to load."""

    def write(folder: MapFolder, out: Path) -> list[Path]:
        writer: Writer = getattr(import_module("vnav.io.store.conversions"), name)
        return writer(folder, out)

    return write


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
        {"ply": _copy("fuse", "cloud.ply"), "las": _made("las")},
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
    "keepout": Part(
        "Floor to keep out of, as the mask that Nav2's keepout filter takes.",
        "fuse",
        {"pgm": _made("keepout")},
    ),
    "mesh": Part(
        "The coloured surface.",
        "fuse",
        {"ply": _copy("fuse", "mesh.ply"), "obj": _made("obj"), "glb": _made("glb")},
    ),
    "graph": Part("The pose graph.", "optimise", {"g2o": _copy("optimise", "graph.g2o")}),
    "colmap": Part(
        "Keyframes and landmarks as COLMAP's sparse model, with the images.",
        "optimise",
        {"txt": _made("colmap")},
    ),
    "transforms": Part(
        "Keyframes as NeRF and Nerfstudio take them, with colour and depth images.",
        "optimise",
        {"json": _made("transforms")},
    ),
    "rerun": Part(
        "All of it for the rerun viewer; needs rerun-sdk.",
        "fuse",
        {"rrd": _made("rerun")},
    ),
}

PACKAGES = {("cloud", "las"): require_laspy, ("rerun", "rrd"): require_rerun}
