"""places.toml of a map: places that have a name, each tied to a frame, moved with it.

It is no stage's. Building and extending a map leave it as it is, and what it says is brought to
where the frames are then. People may edit it.
"""

import json
import shlex
from collections.abc import Iterable
from typing import Literal

import msgspec
import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.places import (
    GOAL,
    ONE_WAY,
    Anchor,
    LostPlace,
    NamedPlace,
    Zones,
    point_of,
    zones_of,
)
from vnav.errors import MapError
from vnav.io.files import read_toml, write_text
from vnav.io.store.artifacts import load_frame_table, load_odometry, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.map_lock import only_writer, unwritable
from vnav.io.store.records import PoseNote

NAME = "places.toml"
CORNERS = 3  # of a polygon, at least
LONGEST = 100  # characters of a name
MOST_M = 1e4  # no place lies farther from the origin


class PlaceTable(msgspec.Struct, forbid_unknown_fields=True):
    """One table of the file; its header is the name."""

    kind: Literal["goal", "keep-out", "one-way"]
    points_m: list[tuple[float, float]]
    capture: str
    frame: int
    T_world_frame: PoseNote
    yaw_rad: float | None = None


def load_places(folder: MapFolder) -> dict[str, NamedPlace | LostPlace]:
    """Each place where it lies in the map as it is now, in order of entry, or why it lies nowhere.

    MapError where the file is not such a one.
    """
    stored = _stored(folder)
    if not stored:
        return {}
    frames, poses = load_frame_table(folder), load_optimised(folder).T_world_camera
    number = {each["fingerprint"]: each["id"] for each in folder.captures}
    found: dict[str, NamedPlace | LostPlace] = {}
    for name, place in stored.items():
        capture, index = number.get(place.anchor.capture, -1), place.anchor.frame
        rows = np.flatnonzero((frames.capture == capture) & (frames.index == index))
        if len(rows) and np.isfinite(poses[rows[0]]).all():
            found[name] = place.moved(poses[rows[0]])
        else:
            of = "a capture that is not in it" if capture < 0 else f"capture {capture}"
            reason = f"it is tied to frame {index} of {of}, of which the map has no pose"
            found[name] = LostPlace(place.kind, reason)
    return found


def require_placed(folder: MapFolder, name: str, place: NamedPlace | LostPlace) -> NamedPlace:
    """A place that lies somewhere; MapError where it does not."""
    if isinstance(place, LostPlace):
        raise MapError(
            f"expected the {place.kind} '{name}' in the map {folder.root} as it is now, found that"
            f" {place.reason}; run 'vnav edit {folder.root} remove {shlex.quote(name)}' and name it"
            " anew"
        )
    return place


def load_zones(folder: MapFolder) -> Zones:
    """What is kept out of or crossed one way only; MapError where one of these lies nowhere."""
    floor = {name: place for name, place in load_places(folder).items() if place.kind != GOAL}
    return zones_of({name: require_placed(folder, name, place) for name, place in floor.items()})


def add_place(
    folder: MapFolder, name: str, kind: str, points_m: Array, yaw_rad: float | None = None
) -> None:
    """Name a goal or a polygon (N, 2) of floor, tied to the keyframe that is nearest.

    MapError where the name is taken or none that can be, or the map cannot be written.
    """
    _require_usable(name, kind, points_m)
    place = NamedPlace(kind, points_m, yaw_rad, _nearest(folder, points_m.mean(0)))
    with only_writer(folder.root):
        stored = _stored(folder)
        if name in stored:
            raise MapError(
                f"expected a new name, found '{name}', a {stored[name].kind} of {folder.root}; run"
                f" 'vnav edit {folder.root} remove {shlex.quote(name)}' first"
            )
        _write(folder, {**stored, name: place})


def remove_place(folder: MapFolder, name: str) -> None:
    """Forget a place; MapError where there is none of that name, or the map cannot be written."""
    with only_writer(folder.root):
        stored = _stored(folder)
        if name not in stored:
            raise MapError(
                f"expected the name of a place of {folder.root}, found '{name}';"
                f" {known_names(stored)}"
            )
        _write(folder, {other: place for other, place in stored.items() if other != name})


def known_names(names: Iterable[str]) -> str:
    """Which there are, as the end of a sentence."""
    return f"it has {', '.join(map(repr, names)) or 'none'}; 'vnav edit' adds others"


def _require_usable(name: str, kind: str, points_m: Array) -> None:
    is_other = name == "current" or point_of(name) is not None
    if not name.strip() or len(name) > LONGEST or not name.isprintable() or is_other:
        raise MapError(
            f"expected a name of 1 to {LONGEST} printable characters other than 'current' and X,Y,"
            f" found {name[:LONGEST]!r}"
        )
    if kind != GOAL and len(points_m) < CORNERS:
        raise MapError(
            f"expected a polygon of {CORNERS} corners X,Y or more, found {len(points_m)}"
        )
    if not (np.abs(points_m) < MOST_M).all():
        raise MapError(f"expected points within {MOST_M:g} m, found {points_m.tolist()}")


def _nearest(folder: MapFolder, point: Array) -> Anchor:
    """The keyframe that was taken nearest to a point of the floor."""
    odometry, poses = load_odometry(folder), load_optimised(folder).T_world_camera
    rows = odometry.keyframe_rows
    rows = rows[np.isfinite(poses[rows]).all((1, 2))]
    row = rows[np.hypot(*(poses[rows, :2, 3] - point).T).argmin()]
    capture = folder.captures[odometry.frames.capture[row]]["fingerprint"]
    return Anchor(capture, int(odometry.frames.index[row]), poses[row])


def _stored(folder: MapFolder) -> dict[str, NamedPlace]:
    """What the file says; empty where there is none."""
    path = folder.root / NAME
    if not path.exists():
        return {}
    try:
        tables = msgspec.convert(read_toml(path), dict[str, PlaceTable])
        return {name: _place(name, table) for name, table in tables.items()}
    except (OSError, ValueError) as error:
        raise MapError(
            f"expected places as vnav writes them in {path}, found: {error};"
            " mend or remove the file"
        ) from error


def _place(name: str, table: PlaceTable) -> NamedPlace:
    points_m, T_world_frame = np.array(table.points_m), np.array(table.T_world_frame)
    count = 1 if table.kind == GOAL else max(CORNERS, len(points_m))
    numbers = [*points_m.ravel(), *T_world_frame.ravel(), table.yaw_rad or 0.0]
    if len(points_m) != count or not all(abs(each) < MOST_M for each in numbers):
        raise ValueError(f"{len(points_m)} points of the {table.kind} '{name}', or endless numbers")
    if table.kind == ONE_WAY and table.yaw_rad is None:
        raise ValueError(f"no yaw_rad of the one-way '{name}', which is the way that it leads")
    if not se3.is_rigid(T_world_frame):
        raise ValueError(f"T_world_frame of '{name}', which is no pose")
    anchor = Anchor(table.capture, table.frame, T_world_frame)
    return NamedPlace(table.kind, points_m, table.yaw_rad, anchor)


def _write(folder: MapFolder, places: dict[str, NamedPlace]) -> None:
    path = folder.root / NAME
    head = "# Places of this map, by vnav edit: metres and radians, when the frame had that pose.\n"
    try:
        write_text(path, head + "".join(_table(name, place) for name, place in places.items()))
    except OSError as error:
        raise unwritable(folder.root, error) from error


def _table(name: str, place: NamedPlace) -> str:
    """A name, a hash and numbers are the same in TOML and in JSON."""
    anchor = place.anchor
    values = {
        "kind": place.kind,
        "points_m": place.points_m.tolist(),
        **({} if place.yaw_rad is None else {"yaw_rad": place.yaw_rad}),
        "capture": anchor.capture,
        "frame": anchor.frame,
        "T_world_frame": anchor.T_world_camera.tolist(),
    }
    lines = [f"{key} = {_text(value)}" for key, value in values.items()]
    return "\n".join(["", f"[{_text(name)}]", *lines, ""])


def _text(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)
