"""What a map's JSON files hold, by type: a crafted one is refused before anything relies on it."""

from pathlib import Path, PurePosixPath
from typing import Any, NotRequired, TypedDict, TypeVar

import msgspec
import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.errors import MEND, MapError
from vnav.io.files import read_bytes

Kind = TypeVar("Kind")
PoseRow = tuple[float, float, float, float]
PoseNote = tuple[PoseRow, PoseRow, PoseRow, PoseRow]  # a transformation
PATH_M = 0.05  # how high above the floor a path is drawn


class MappedCapture(TypedDict):
    """A capture of a map; ``camera``: without the distortion that the recorded one may have."""

    id: int
    name: str
    fingerprint: str
    camera: dict[str, Any]
    recorded_camera: NotRequired[dict[str, Any]]


class CaptureList(TypedDict):
    """map.json, beside its format."""

    captures: list[MappedCapture]


class StageRecord(TypedDict):
    """stage.json: what made a stage, from which settings and inputs, and hashes of its files."""

    vnav: str
    settings: dict[str, Any]
    inputs: dict[str, str]
    files: dict[str, str]


class StageNote(TypedDict, total=False):
    """The report of a stage, for people."""

    values: dict[str, Any]
    lines: list[str]
    warnings: list[str]
    seconds: float
    cpu_seconds: float


class VerdictNote(TypedDict):
    """What the report on quality says first."""

    verdict: str
    doubts: list[str]


class LocatedNote(TypedDict):
    """What state/ says of a located photo, among other things."""

    photo: str
    T_world_camera: PoseNote
    intrinsics: Intrinsics


class PathNote(TypedDict):
    """What state/path.json says of the last path, among other things."""

    path_m: list[tuple[float, float, float]]
    length_m: float


class OverlayNote(TypedDict):
    """What state/overlays.json says of a located photo; bytes are base64 there."""

    photo: str
    jpeg: bytes


def read_json(path: Path, kind: type[Kind]) -> Kind:
    """What a JSON file holds; OSError, or ValueError where it is nothing of that kind."""
    try:
        return msgspec.json.decode(read_bytes(path), type=kind)
    except RecursionError as error:
        raise ValueError("values within values within values") from error


def checked(values: Any, kind: type[Kind], where: object) -> Kind:
    """Values of a file as they are, where they are of that kind; MapError where they are not."""
    try:
        msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise MapError(f"expected {where} as vnav writes it, found: {error}; {MEND}") from error
    found: Kind = values
    return found


def is_kind(values: Any, kind: Any) -> bool:
    """Whether values are of that kind."""
    try:
        msgspec.convert(values, kind)
    except msgspec.ValidationError:
        return False
    return True


def located_camera(note: Any) -> tuple[Array, Intrinsics] | None:
    """``T_world_camera`` (4, 4) of a located photo, and its camera.

    None where its note is none that `locate` wrote.
    """
    if not is_kind(note, LocatedNote):
        return None
    known = note["intrinsics"]
    camera = Intrinsics(*(known[key] for key in ("width", "height", "fx", "fy", "cx", "cy")))
    return (np.array(note["T_world_camera"], float), camera) if camera.is_possible else None


def planned_points(note: Any) -> Array | None:
    """The last path (N, 3), a little above the floor; None where its note is none of `plan`."""
    if not is_kind(note, PathNote) or not note["path_m"]:
        return None
    points = np.array(note["path_m"], float)
    points[:, 2] = PATH_M  # in the place of yaw
    return points


def kept_overlays(notes: Any) -> list[tuple[str, bytes]]:
    """Names and JPEGs of photos; none where the notes are none that `locate` wrote."""
    try:
        return [(n["photo"], n["jpeg"]) for n in msgspec.convert(notes, list[OverlayNote])]
    except msgspec.ValidationError:
        return []


def require_inside(names: dict[str, str], where: object) -> None:
    """MapError where one of a stage's files would lie outside its folder."""
    for name in names:
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts:
            raise MapError(f"expected files below their stage in {where}, found '{name}'; {MEND}")
