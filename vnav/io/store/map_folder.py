"""The map folder: sole owner of its layout; see docs/map-folder.md.

A stage owns one folder and writes it whole: into a draft beside it, then renamed, so that a crash
never leaves half a stage. ``stage.json`` records vnav's version, the settings and the content of
all inputs; a stage is reused only where all of these are what they were.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vnav import __version__
from vnav.errors import MapError, StaleArtifact

FORMAT = 4
STAGES = ("odometry", "vocabulary", "loops", "optimise", "fuse", "index")
_LEFTOVERS = tuple(f".{stage}.{end}" for stage in STAGES for end in ("draft", "old"))
_OWN = (*_LEFTOVERS, *STAGES, "reports", "state")


class MapFolder:
    """One map on disk."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @classmethod
    def open(cls, root: Path) -> "MapFolder":
        """An existing map; MapError where there is none or its format is another."""
        _put_back(root)
        path = root / "map.json"
        if not path.is_file():
            raise MapError(
                f"expected a map at {root}, found no map.json; make one with 'vnav build-map"
                f" CAPTURE --map {root}' or name another with --map"
            )
        found = _read_json(path).get("format")
        if found != FORMAT:
            raise MapError(
                f"expected map format {FORMAT} in {path}, found {found};"
                f" build the map anew with 'vnav build-map CAPTURE --map {root} --fresh'"
            )
        return cls(root)

    @classmethod
    def create(cls, root: Path, fresh: bool = False) -> "MapFolder":
        """An existing map, or an empty one made here, that can be written; ``fresh`` empties it.

        What an interrupted run left half-done is removed. MapError where the folder holds
        something that is no map, or cannot be written.
        """
        folder = cls(root)
        try:
            _put_back(root)
            captures = folder._found(fresh)
            root.mkdir(parents=True, exist_ok=True)
            for name in _OWN if fresh else _LEFTOVERS:
                if (root / name).exists():
                    shutil.rmtree(root / name)
            folder.set_captures(captures)
        except OSError as error:
            raise MapError(
                f"expected to write a map at {root}, found: {error.strerror}; give write"
                " permission or name another folder with --map"
            ) from error
        return folder

    def _found(self, fresh: bool) -> list[dict[str, Any]]:
        """The captures of the map that is here, none where it is to be made."""
        path = self.root / "map.json"
        if path.exists() and not fresh:
            return self.open(self.root).captures
        if path.exists() and "captures" not in _read_json(path):
            raise MapError(
                f"expected a map's map.json in {self.root}, found another file of that name, and"
                " deleted nothing; name another folder with --map"
            )
        if not path.exists() and self.root.exists():
            names = [p.name for p in self.root.iterdir() if p.name != f".{path.name}.draft"]
            if names:
                raise MapError(
                    f"expected a map or an empty folder at {self.root}, found other files"
                    f" ({min(names)}); name another folder with --map"
                )
        return []

    @property
    def captures(self) -> list[dict[str, Any]]:
        """The map's captures: id, name, fingerprint, camera."""
        captures: list[dict[str, Any]] = _read_json(self.root / "map.json")["captures"]
        return captures

    def set_captures(self, captures: list[dict[str, Any]]) -> None:
        """Replace the list of captures."""
        write_text(self.root / "map.json", to_json({"format": FORMAT, "captures": captures}))

    def inputs_of(self, *stages: str) -> dict[str, str]:
        """What a stage depends on: a hash over each named stage's recorded output."""
        return {stage: _digest(self.stage(stage) / "stage.json") for stage in stages}

    def is_current(
        self, stage: str, settings: Mapping[str, Any], inputs: Mapping[str, str]
    ) -> bool:
        """Whether the stage was made by this version from these settings and inputs, unharmed."""
        path = self.root / stage / "stage.json"
        if not path.is_file():
            return False
        record = _read_json(path)
        made_from = {key: record.get(key) for key in ("vnav", "settings", "inputs")}
        wanted = {"vnav": __version__, "settings": dict(settings), "inputs": dict(inputs)}
        files = record.get("files", {})
        return bool(made_from == json.loads(to_json(wanted)) and files == _digests(path.parent))

    def stage(self, stage: str) -> Path:
        """Folder of a finished stage; StaleArtifact where it is missing or its inputs changed."""
        folder = self.root / stage
        if not (folder / "stage.json").is_file():
            raise StaleArtifact(
                f"expected the finished stage '{stage}' in {self.root}, found none; run"
                f" 'vnav build-map' or 'vnav {stage} --map {self.root}'"
            )
        for name, digest in _read_json(folder / "stage.json")["inputs"].items():
            if name not in STAGES:
                continue
            if _digest(self.stage(name) / "stage.json") != digest:
                raise StaleArtifact(
                    f"stage '{stage}' in {self.root} was made from another '{name}' than is there"
                    f" now; run 'vnav {stage} --map {self.root}' again"
                )
        return folder

    def require_finished(self) -> None:
        """StaleArtifact where a stage is missing or stale, MapError where another vnav made it."""
        for stage in STAGES:
            version = _read_json(self.stage(stage) / "stage.json").get("vnav")
            if version != __version__:
                raise MapError(
                    f"expected stages made by vnav {__version__} in {self.root}, found '{stage}'"
                    f" made by {version}; build the map anew with 'vnav build-map CAPTURE --map"
                    f" {self.root} --fresh'"
                )

    def foreign_files(self) -> list[Path]:
        """What lies in the folder and is not vnav's."""
        own = {*_OWN, "map.json", ".map.json.draft"}
        return sorted(path for path in self.root.iterdir() if path.name not in own)

    def settings(self, stage: str) -> dict[str, Any]:
        """What a finished stage was made with: the seed, and its sections of the configuration."""
        settings: dict[str, Any] = _read_json(self.stage(stage) / "stage.json")["settings"]
        return settings

    def recorded(self, stage: str) -> dict[str, Any]:
        """What a stage, stale or not, was made by and from; empty where it is missing."""
        path = self.root / stage / "stage.json"
        return _read_json(path) if path.is_file() else {}

    def has(self, stage: str) -> bool:
        """Whether a stage is finished and its inputs are those it was made from."""
        try:
            self.stage(stage)
        except StaleArtifact:
            return False
        return True

    @contextmanager
    def writing(
        self, stage: str, settings: Mapping[str, Any], inputs: Mapping[str, str]
    ) -> Iterator[Path]:
        """A draft folder to fill; it becomes the stage when the block ends without an error."""
        draft, final = self.root / f".{stage}.draft", self.root / stage
        try:
            shutil.rmtree(draft, ignore_errors=True)
            draft.mkdir()
        except OSError as error:
            raise MapError(
                f"expected to write to the map {self.root}, found: {error.strerror}; give write"
                " permission or name another folder with --map"
            ) from error
        yield draft
        record = {"vnav": __version__, "settings": dict(settings), "inputs": dict(inputs)}
        write_text(draft / "stage.json", to_json(record | {"files": _digests(draft)}))
        old = self.root / f".{stage}.old"
        shutil.rmtree(old, ignore_errors=True)
        if final.exists():
            final.rename(old)
        draft.rename(final)
        shutil.rmtree(old, ignore_errors=True)

    def write_report(self, stage: str, report: Mapping[str, Any]) -> None:
        """Counts, quality and seconds of a stage, for people; not an input of anything."""
        (self.root / "reports").mkdir(exist_ok=True)
        write_text(self.root / "reports" / f"{stage}.json", to_json(report))

    def report(self, stage: str) -> dict[str, Any]:
        """A stage's last report, empty where there is none."""
        path = self.root / "reports" / f"{stage}.json"
        return _read_json(path) if path.is_file() else {}

    def write_current(self, pose: Mapping[str, Any]) -> None:
        """Remember the last located pose; OSError where the map is read-only."""
        (self.root / "state").mkdir(exist_ok=True)
        state = {"world": self._world(), "pose": dict(pose)}
        write_text(self.root / "state" / "current.json", to_json(state))

    def current(self) -> dict[str, Any] | None:
        """The last located pose; None where no photo was located since the map got its world."""
        path = self.root / "state" / "current.json"
        state = _read_json(path) if path.is_file() else {}
        pose: dict[str, Any] | None = state.get("pose")
        return pose if state.get("world") == self._world() else None

    def _world(self) -> str:
        """What the map's world frame came from, empty before there is one."""
        path = self.root / "optimise" / "stage.json"
        return _digest(path) if path.is_file() else ""


def aside(root: Path) -> Path:
    """Where a map lies for the moment in which another takes its place."""
    root = root.resolve()
    return root.with_name(f".{root.name}.old")


def _put_back(root: Path) -> None:
    """Bring back a map whose replacement was broken off in that moment."""
    if not root.exists() and aside(root).is_dir():
        aside(root).rename(root.resolve())


def to_json(value: Any) -> str:
    """JSON text, the same for the same value; no NaN."""
    return json.dumps(value, indent=1, sort_keys=True, allow_nan=False) + "\n"


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(text, "utf-8")
    os.replace(draft, path)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        value = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise MapError(f"expected JSON in {path}, found: {error}; build with --fresh") from error
    if not isinstance(value, dict):
        raise MapError(f"expected a JSON object in {path}, found another value; build with --fresh")
    return value


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _digests(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "stage.json")
    return {p.relative_to(folder).as_posix(): _digest(p) for p in files}
