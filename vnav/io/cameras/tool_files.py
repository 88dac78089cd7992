"""Which tool wrote a camera file, and where a capture folder has one.

A new format is one module like `vnav.io.cameras.open3d` and its name in `FORMATS`.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from vnav.errors import CameraError
from vnav.io.cameras import colmap, nerf, open3d, record3d, ros
from vnav.io.cameras.tables import Tables
from vnav.io.files import read_text


class CameraFormat(Protocol):
    """What a module that knows one format of camera files offers."""

    NAME: str
    FILES: tuple[str, ...]  # what the tool calls it, from the capture's folder

    def recognises(self, content: Any) -> bool:
        """Whether it is this format: JSON and YAML are decoded, other files are text."""

    def tables(self, content: Any) -> Tables:
        """What a camera.toml would say; ValueError where that cannot be said."""


FORMATS: tuple[CameraFormat, ...] = (open3d, ros, colmap, record3d, nerf)

_DECODERS: dict[str, Callable[[str], Any]] = {
    ".json": json.loads,
    "metadata": json.loads,
    ".yaml": ros.read_yaml,
    ".yml": ros.read_yaml,
    ".txt": str,
}


def is_tool_file(path: Path) -> bool:
    """Whether its name is that of a tool's file, not of a camera.toml."""
    return _kind(path) in _DECODERS


def read_tables(path: Path) -> Tables:
    """What a camera.toml would say, from a tool's file; CameraError tells why it cannot be said."""
    content = _content(path)
    reader = _reader_of(content)
    if reader is None:
        known = ", ".join(each.NAME for each in FORMATS)
        raise CameraError(
            f"expected a camera.toml, or a camera file of {known}, at {path}, found none of these"
        )
    try:
        return reader.tables(content)
    except ValueError as error:
        raise CameraError(f"{path} ({reader.NAME}): {error}") from error


def files_beside(folder: Path) -> list[Path]:
    """The camera files that tools left in a capture folder; what cannot be read is none."""
    places = [folder / name for reader in FORMATS for name in reader.FILES]
    return [path for path in places if path.is_file() and _is_readable(path)]


def _is_readable(path: Path) -> bool:
    try:
        return _reader_of(_content(path)) is not None
    except CameraError:
        return False


def _reader_of(content: Any) -> CameraFormat | None:
    return next((reader for reader in FORMATS if reader.recognises(content)), None)


def _content(path: Path) -> Any:
    try:
        return _DECODERS[_kind(path)](read_text(path))
    except OSError as error:
        raise CameraError(f"expected a camera file at {path}, found: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise CameraError(f"expected text in the camera file {path}, found: {error}") from error
    except (ValueError, RecursionError) as error:
        kind = "YAML" if _kind(path) in (".yaml", ".yml") else "JSON"
        raise CameraError(f"expected {kind} in the camera file {path}, found: {error}") from error


def _kind(path: Path) -> str:
    return path.suffix.lower() or path.name
