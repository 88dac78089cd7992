"""Suites: which sequences are evaluated, against which truth, beside which published figures.

The format is described in docs/evaluating.md.
"""

import dataclasses
import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from vnav import config
from vnav.config import Config, preset_cameras
from vnav.errors import CaptureError, ConfigError
from vnav.io.datasets.fetched import datasets_folder
from vnav.io.files import read_toml
from vnav.io.formats.camera_file import preset_path

NAME = re.compile(r"\w[\w.+-]*(/\w[\w.+-]*)*")  # a folder can be called by it
Values = Mapping[str, Any]
EntryT = TypeVar("EntryT")


@dataclass(frozen=True)
class Peer:
    """What was published about another system on a sequence: ATE RMSE in metres, or a note."""

    system: str
    source: str
    ate_m: float = 0.0  # 0: none
    note: str = ""


@dataclass(frozen=True)
class Entry:
    """A sequence as the suite names it; empty texts and 0 stand for what is not given."""

    name: str
    capture: str
    camera: str = ""
    truth: str = ""
    config: str = ""
    settings: Values = field(default_factory=dict)
    queries: str = ""
    hold_out_every: int = 0
    peers: tuple[Peer, ...] = ()


@dataclass(frozen=True)
class Suite:
    """A list of sequences; ``folder``: where relative paths begin."""

    name: str
    description: str
    folder: Path
    entries: tuple[Entry, ...]

    def config_of(self, entry: Entry) -> Config:
        """The settings of a sequence; ConfigError where its preset or one of them is unknown."""
        beside = self.folder / entry.config
        source = str(beside) if entry.config and beside.is_file() else entry.config or None
        return config.updated(config.load(source), entry.settings, f"settings of {entry.name}")


@dataclass(frozen=True)
class SequenceFiles:
    """Where the files of a sequence lie; None for what is not given."""

    capture: Path
    camera: Path | None
    truth: Path | None
    queries: Path | None


def read_suite(source: str) -> Suite:
    """The suite in a file, or the one of that name that ships with vnav.

    ConfigError names the file and the key that is unknown, missing or of another type.
    """
    path, folder = _place(source)
    try:
        values = read_toml(path)
    except OSError as error:
        raise ConfigError(f"expected a suite at {path}, found: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"expected TOML in {path}, found: {error}") from error
    head = _entry(_Head, values.get("suite", {}), f"[suite] of {path}")
    _known(values, ("suite", "sequence"), str(path))
    rows = values.get("sequence")
    if not isinstance(rows, list) or not rows:
        raise ConfigError(f"expected [[sequence]] in {path}, found none")
    entries = tuple(_sequence(row, n, path) for n, row in enumerate(rows, 1))
    names = [entry.name for entry in entries]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"expected one sequence of a name in {path}, found two '{name}'")
    return Suite(head.name or path.stem, head.description, folder, entries)


def shipped_suites() -> list[str]:
    """Names of the suites that ship with vnav."""
    files = resources.files("vnav.datasets").iterdir()
    suites = (file for file in files if file.name.endswith(".toml"))
    return sorted(f.name.removesuffix(".toml") for f in suites if "[suite]" in f.read_text("utf-8"))


def files_of(entry: Entry, suite_folder: Path) -> SequenceFiles:
    """Where a sequence's files lie; CaptureError names what is not there.

    A relative path is looked for beside the suite, then in the folder of fetched datasets; those of
    camera, truth and queries in the capture, too.
    """
    places = suite_folder, datasets_folder()
    capture = _found(entry, "capture", places)
    inside = *places, capture

    def given(key: str) -> Path | None:
        return _found(entry, key, inside) if getattr(entry, key) else None

    if entry.camera in preset_cameras():
        camera: Path | None = preset_path(entry.camera)
    else:
        camera = given("camera")
    return SequenceFiles(capture, camera, given("truth"), given("queries"))


@dataclass(frozen=True)
class _Head:
    name: str = ""
    description: str = ""


def _place(source: str) -> tuple[Path, Path]:
    """A suite's file, and the folder in which its relative paths begin."""
    path, shipped = Path(source), shipped_suites()
    if path.is_file():
        return path, path.parent.absolute()
    if source in shipped:
        return Path(str(resources.files("vnav.datasets") / f"{source}.toml")), datasets_folder()
    raise ConfigError(
        f"expected a suite file, or one of {', '.join(shipped)}, found neither: '{source}'"
    )


def _found(entry: Entry, key: str, places: Iterable[Path]) -> Path:
    paths = [place / Path(getattr(entry, key)).expanduser() for place in places]
    for path in paths:
        if path.exists():
            return path
    looked = " or ".join(dict.fromkeys(str(path) for path in paths))
    fetch = "; 'vnav datasets list' tells what can be fetched" if key == "capture" else ""
    raise CaptureError(f"expected the {key} of {entry.name} at {looked}, found nothing{fetch}")


def _sequence(row: Any, number: int, path: Path) -> Entry:
    where = f"[[sequence]] {number} of {path}"
    entry = _entry(Entry, row, where)
    if not NAME.fullmatch(entry.name):
        raise ConfigError(
            f"expected a name of letters, digits and ._+-/ in {where}, found '{entry.name}'"
        )
    if entry.hold_out_every < 0 or entry.hold_out_every == 1:
        raise ConfigError(
            f"expected hold_out_every of 2 or more in {where}, found {entry.hold_out_every}"
        )
    peers = tuple(_entry(Peer, peer, f"peers of {where}") for peer in entry.peers)
    for peer in peers:
        if not peer.ate_m and not peer.note:
            raise ConfigError(f"expected ate_m or note for {peer.system} in {where}, found none")
    return dataclasses.replace(entry, peers=peers)


def _entry(kind: type[EntryT], values: Any, where: str) -> EntryT:
    """A dataclass from a TOML table; ConfigError for keys and types that do not fit."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"expected a table for {where}, found {values!r}")
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    _known(values, fields, where)
    types = get_type_hints(kind)
    fitting = {
        key: _fitting(value, types[key], f"{key} in {where}") for key, value in values.items()
    }
    for name, f in fields.items():
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if name not in values and required:
            raise ConfigError(f"expected {name} in {where}, found none")
    return kind(**fitting)


def _known(values: Values, known: Iterable[str], where: str) -> None:
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            hint = f"did you mean '{near[0]}'?" if near else f"known are: {', '.join(known)}"
            raise ConfigError(f"unknown key '{key}' in {where}; {hint}")


def _fitting(value: Any, kind: Any, where: str) -> Any:
    if kind is float and type(value) is int:
        return float(value)
    wanted = {str: "text", int: "a whole number", float: "a number", Values: "a table"}
    fits = {str: str, int: int, float: float, Values: Mapping}.get(kind, list)
    if not isinstance(value, fits) or isinstance(value, bool):
        raise ConfigError(f"expected {wanted.get(kind, 'a list')} for {where}, found {value!r}")
    return tuple(value) if isinstance(value, list) else value
