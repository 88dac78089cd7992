"""camera.toml: the pinhole cameras of a capture or of photos; see docs/captures.md.

Files of other tools are read as what a camera.toml would say, and checked alike.
"""

import dataclasses
import difflib
import math
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

from vnav.config import preset_cameras
from vnav.core import se3
from vnav.core.camera import LEAST, MOST_SIDE_PX, Camera, Intrinsics, registered_camera
from vnav.errors import CameraError
from vnav.io.cameras.tables import is_number
from vnav.io.cameras.tool_files import is_tool_file, read_tables
from vnav.io.files import read_toml

_PINHOLE = ("fx", "fy", "cx", "cy")
_COLOR_KEYS = ("width", "height", *_PINHOLE, "distortion")
_DEPTH_KEYS = ("units_per_metre", *_COLOR_KEYS, "T_color_depth")
MILLIMETRES = 1000.0  # units a metre of most sensors
GUESS = "a guess: replace it"
NO_REMARKS: Mapping[str, str] = MappingProxyType({})
_FARTHEST_M = 1.0  # no depth sensor sits farther from its colour camera


def read_camera(path: Path, *, has_depth: bool = True, units_per_metre: float = 0.0) -> Camera:
    """The colour camera and depth sensor that a camera.toml, or a file of another tool, describes.

    ``units_per_metre`` above 0 replaces what the file says of them. Of a capture without depth,
    [depth] may be missing. CameraError names the file, the key, what was expected and what was
    found.
    """
    values, where = _read(path), str(path)
    if units_per_metre > 0:
        values = _with_units(values, units_per_metre)
    if not (has_depth or "depth" in values):
        return Camera(_color(values, where), units_per_metre=1.0)
    if is_tool_file(path) and "depth" not in values:
        raise _without_units(path, _color(values, where))
    return _camera(values, where)


def read_color(path: Path) -> Intrinsics:
    """The colour camera alone, for photos: [depth] may be missing."""
    return _color(_read(path), str(path))


def camera_text(camera: Camera | Intrinsics, remarks: Mapping[str, str] = NO_REMARKS) -> str:
    """The camera.toml of a camera, of intrinsics without [depth].

    ``remarks``: comments by key, in both tables alike.
    """
    if isinstance(camera, Intrinsics):
        tables = {"color": _written(camera)}
    else:
        tables = {"color": _written(camera.color), "depth": _depth_table(camera)}
    return "\n\n".join(
        "\n".join([f"[{name}]", *_lines(table, remarks)]) for name, table in tables.items()
    )


def _depth_table(camera: Camera) -> dict[str, Any]:
    depth: dict[str, Any] = {"units_per_metre": camera.units_per_metre}
    if camera.depth is not None and camera.T_color_depth is not None:
        rows = [list(row) for row in camera.T_color_depth]
        depth |= _written(camera.depth) | {"T_color_depth": rows}
    return depth


def _written(intrinsics: Intrinsics) -> dict[str, Any]:
    values = dataclasses.asdict(intrinsics)
    distortion = list(values.pop("distortion"))
    return values | ({"distortion": distortion} if distortion else {})


def _lines(table: Mapping[str, Any], remarks: Mapping[str, str]) -> Iterator[str]:
    for key, value in table.items():
        yield f"{key} = {value!r}" + (f"  # {remarks[key]}" if key in remarks else "")


def preset_camera(name: str) -> Camera:
    """A camera that ships with vnav; CameraError lists them where there is none of that name."""
    return read_camera(preset_path(name))


def preset_path(name: str) -> Path:
    """The camera.toml of a camera that ships with vnav; CameraError as in `preset_camera`."""
    if name not in preset_cameras():
        known = ", ".join(preset_cameras())
        raise CameraError(f"expected a camera preset ({known}), found '{name}'")
    return Path(str(_presets() / f"{name}.toml"))


def _presets() -> Any:
    return resources.files("vnav.configs") / "cameras"


def _read(path: Path) -> dict[str, Any]:
    if is_tool_file(path):
        return read_tables(path)
    try:
        return read_toml(path)
    except OSError as error:
        raise CameraError(f"expected a camera file at {path}, found: {error.strerror}") from error
    except ValueError as error:
        raise CameraError(f"expected TOML in {path}, found: {error}") from error


def _with_units(values: dict[str, Any], units_per_metre: float) -> dict[str, Any]:
    depth = values.get("depth", {})
    if not isinstance(depth, Mapping):
        return values
    return values | {"depth": {**depth, "units_per_metre": units_per_metre}}


def _without_units(path: Path, color: Intrinsics) -> CameraError:
    error = CameraError(
        f"expected the units of depth, found none in {path}, whose format does not tell them; give"
        " them with --set capture.units_per_metre=1000 where depth is in millimetres, or save the"
        " proposed camera.toml in the capture and correct its units_per_metre"
    )
    error.add_note(camera_text(Camera(color, MILLIMETRES), {"units_per_metre": GUESS}))
    return error


def _camera(values: Mapping[str, Any], where: str) -> Camera:
    color = _color(values, where)
    depth = _table(values, "depth", _DEPTH_KEYS, where)
    units = _number(depth, "units_per_metre", f"[depth] of {where}", positive=True)
    size = {"width": color.width, "height": color.height}
    if not any(key in depth for key in (*_PINHOLE, "T_color_depth")):
        width, height = (_pixels(size | dict(depth), k, f"[depth] of {where}") for k in size)
        return registered_camera(color, units, (width, height))
    sensor = _intrinsics(size | dict(depth), f"[depth] of {where}")
    return Camera(color, units, sensor, _transform(depth, f"[depth] of {where}"))


def _color(values: Mapping[str, Any], where: str) -> Intrinsics:
    _known(values, ("color", "depth"), where)
    return _intrinsics(_table(values, "color", _COLOR_KEYS, where), f"[color] of {where}")


def _table(
    values: Mapping[str, Any], name: str, keys: tuple[str, ...], where: str
) -> Mapping[str, Any]:
    table = values.get(name)
    if not isinstance(table, Mapping):
        found = "none" if table is None else repr(table)
        raise CameraError(f"expected a table [{name}] in {where}, found {found}")
    _known(table, keys, f"[{name}] of {where}")
    return table


def _known(values: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in values:
        if key not in keys:
            near = difflib.get_close_matches(key, keys, 1)
            hint = f"did you mean '{near[0]}'?" if near else f"known are: {', '.join(keys)}"
            raise CameraError(f"unknown key '{key}' in {where}; {hint}")


def _intrinsics(table: Mapping[str, Any], where: str) -> Intrinsics:
    width, height = (_pixels(table, key, where) for key in ("width", "height"))
    fx, fy = (_number(table, key, where, positive=True) for key in ("fx", "fy"))
    cx, cy = (_number(table, key, where) for key in ("cx", "cy"))
    return Intrinsics(width, height, fx, fy, cx, cy, _distortion(table, where))


def _distortion(table: Mapping[str, Any], where: str) -> tuple[float, ...]:
    values = table.get("distortion", [])
    if not _are_numbers(values) or len(values) not in (0, 4, 5):
        raise CameraError(
            f"expected distortion = [k1, k2, p1, p2, k3] in {where}, found {values!r}"
        )
    return tuple(float(value) for value in values) if any(values) else ()


def _transform(table: Mapping[str, Any], where: str) -> tuple[tuple[float, ...], ...]:
    rows = table.get("T_color_depth")
    if rows is None:
        raise CameraError(
            f"expected T_color_depth in {where} beside the depth camera's fx, fy, cx, cy, found"
            " none; where depth is registered to colour, leave all of them out"
        )
    square = isinstance(rows, list) and len(rows) == 4
    if not square or not all(_are_numbers(row) and len(row) == 4 for row in rows):
        raise CameraError(f"expected T_color_depth as 4 rows of 4 numbers in {where}, found {rows}")
    if not se3.is_rigid(rows, 1e-3):
        raise CameraError(
            f"expected a rotation and a translation in T_color_depth of {where}, found a matrix"
            f" that is not rigid: {rows}"
        )
    distance = math.hypot(*(row[3] for row in rows[:3]))
    if distance > _FARTHEST_M:
        raise CameraError(
            f"expected T_color_depth of {where} in metres, found the cameras {distance:g} m apart;"
            " divide its translation by 1000 if it is in millimetres"
        )
    return tuple(tuple(float(value) for value in row) for row in rows)


def _number(table: Mapping[str, Any], key: str, where: str, *, positive: bool = False) -> float:
    kind = "a positive number" if positive else "a number"
    value = _required(table, key, kind, where)
    if not _are_numbers([value]) or (positive and value < LEAST):
        raise CameraError(f"expected {kind} for {key} in {where}, found {value!r}")
    return float(value)


def _pixels(table: Mapping[str, Any], key: str, where: str) -> int:
    value = _required(table, key, "a number of pixels", where)
    if type(value) is not int or not 0 < value <= MOST_SIDE_PX:
        raise CameraError(f"expected a number of pixels for {key} in {where}, found {value!r}")
    return value


def _required(table: Mapping[str, Any], key: str, kind: str, where: str) -> Any:
    if key not in table:
        raise CameraError(f"expected {kind} for {key} in {where}, found none")
    return table[key]


def _are_numbers(values: Any) -> bool:
    return isinstance(values, list) and all(map(is_number, values))
