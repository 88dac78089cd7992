"""The map folder: sole owner of its layout; see docs/map-folder.md.

A stage owns one folder and writes it whole: into a draft beside it, then renamed, so that a crash
never leaves half a stage. ``stage.json`` records vnav's version, the settings, and the content of
all inputs and of all its files; a stage is reused only where all of these are what they were, and
a file is given out only where it is. JSON files are sealed with a hash of their own.
"""

import errno
import hashlib
import json
import os
import secrets
import shutil
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vnav import __version__
from vnav.errors import MEND, MapError, StaleArtifact
from vnav.io.files import read_text, write_text
from vnav.io.store.map_lock import NAME as LOCK
from vnav.io.store.map_lock import unwritable
from vnav.io.store.records import (
    CaptureList,
    MappedCapture,
    StageNote,
    StageRecord,
    checked,
    is_kind,
    kept_overlays,
    require_inside,
)

FORMAT = 7
STAGES = ("odometry", "vocabulary", "loops", "optimise", "fuse", "index")
_LEFTOVERS = tuple(f".{name}.*" for name in (*STAGES, "map.json"))  # drafts, and what they replace
PARTS = ".parts"  # odometry of captures that are being joined, a folder for each
_OWN = (*_LEFTOVERS, *STAGES, PARTS, "reports", "state")
_SEAL = "sha256"  # in every JSON file, of what else is in it
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True)
class _Record:
    """What a stage.json says, a hash of it, and which file it was."""

    file: tuple[int, int, int]
    values: StageRecord
    digest: str


class MapFolder:
    """One map on disk."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._records: dict[str, _Record] = {}

    @classmethod
    def open(cls, root: Path) -> "MapFolder":
        """An existing map; MapError where there is none or its format is another."""
        _put_back(root)
        path = root / "map.json"
        if not path.is_file():
            if root.is_dir() and any(root.iterdir()):
                raise MapError(
                    f"expected a map at {root}, found a folder without map.json; name a map with"
                    " --map, or make one in a folder of its own: 'vnav build-map CAPTURE --map MAP'"
                )
            raise MapError(
                f"expected a map at {root}, found no map.json; make one with 'vnav build-map"
                f" CAPTURE --map {root}' or name another with --map"
            )
        values = _json(path)
        found = values.get("format")
        if found != FORMAT:
            raise MapError(
                f"expected map format {FORMAT} in {path}, found {found};"
                f" build the map anew with 'vnav build-map CAPTURE --map {root} --fresh'"
            )
        checked(_unsealed(values, path), CaptureList, path)
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
            for path in _matching(root, _OWN if fresh else _LEFTOVERS):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            folder.set_captures(captures)
        except OSError as error:
            raise unwritable(root, error) from error
        return folder

    def _found(self, fresh: bool) -> list[MappedCapture]:
        """The captures of the map that is here, none where it is to be made."""
        path = self.root / "map.json"
        if path.exists() and not fresh:
            return self.open(self.root).captures
        if path.exists() and not self._is_own:
            raise MapError(
                f"expected a map's map.json in {self.root}, found another file of that name, and"
                " deleted nothing; name another folder with --map"
            )
        if not path.exists() and self.root.exists():
            others = self.foreign_files()
            if others:
                raise MapError(
                    f"expected a map or an empty folder at {self.root}, found other files"
                    f" ({others[0].name}); name another folder with --map"
                )
        return []

    @property
    def _is_own(self) -> bool:
        """Whether map.json is vnav's; of one that is damaged, a stage beside it tells."""
        try:
            return "captures" in _json(self.root / "map.json")
        except MapError:
            return any(_intact(self.root / stage / "stage.json") for stage in STAGES)

    @property
    def captures(self) -> list[MappedCapture]:
        """The map's captures."""
        path = self.root / "map.json"
        return checked(_read_json(path), CaptureList, path)["captures"]

    def set_captures(self, captures: Sequence[MappedCapture]) -> None:
        """Replace the list of captures."""
        _write_json(self.root / "map.json", {"format": FORMAT, "captures": list(captures)})

    def inputs_of(self, *stages: str) -> dict[str, str]:
        """What a stage depends on: a hash over each named stage's recorded output."""
        for stage in stages:
            self.stage(stage)
        return {stage: self._record(stage).digest for stage in stages}

    def is_current(
        self, stage: str, settings: Mapping[str, Any], inputs: Mapping[str, str]
    ) -> bool:
        """Whether the stage was made by this version from these settings and inputs, unharmed."""
        try:
            record = self.recorded(stage)
        except StaleArtifact:
            return False
        if record is None:
            return False
        made_from = {key: value for key, value in record.items() if key != "files"}
        wanted = {"vnav": __version__, "settings": dict(settings), "inputs": dict(inputs)}
        if made_from != json.loads(to_json(wanted)):
            return False
        return self.is_whole(stage)

    def is_whole(self, stage: str) -> bool:
        """Whether a finished stage's folder holds the files that the stage wrote, and no others."""
        return self.files(stage) == _digests(self.root / stage)

    def stage(self, stage: str) -> Path:
        """Folder of a finished stage; StaleArtifact where it is missing or its inputs changed."""
        folder = self.root / stage
        if not (folder / "stage.json").is_file():
            raise StaleArtifact(
                f"expected the finished stage '{stage}' in {self.root}, found none; run"
                f" 'vnav build-map' or 'vnav {stage} --map {self.root}'"
            )
        for name, digest in self._record(stage).values["inputs"].items():
            if name in STAGES and self.inputs_of(name) != {name: digest}:
                raise StaleArtifact(
                    f"stage '{stage}' in {self.root} was made from another '{name}' than is there"
                    f" now; run 'vnav {stage} --map {self.root}' again"
                )
        return folder

    def file(self, stage: str, name: str) -> Path:
        """A file of a finished stage as the stage wrote it; StaleArtifact where it is not that."""
        path, known = self.stage(stage) / name, self.files(stage)
        if name not in known or not path.is_file():
            found = "none"
        elif _digest(path) != known[name]:
            found = "another content"
        else:
            return path
        command = "build-map CAPTURE" if stage == STAGES[0] else stage
        raise StaleArtifact(
            f"expected {path} as the stage '{stage}' wrote it, found {found}; run 'vnav {command}"
            f" --map {self.root}' again"
        )

    def files(self, stage: str) -> dict[str, str]:
        """Names of the files that a stage wrote, in its folder, and hashes of what they hold."""
        return self._record(stage).values["files"]

    def require_finished(self) -> None:
        """StaleArtifact where a stage is missing or stale, MapError where another vnav made it."""
        for stage in STAGES:
            self.stage(stage)
            version = self._record(stage).values["vnav"]
            if version != __version__:
                raise MapError(
                    f"expected stages made by vnav {__version__} in {self.root}, found '{stage}'"
                    f" made by {version}; build the map anew with 'vnav build-map CAPTURE --map"
                    f" {self.root} --fresh'"
                )

    def size_mb(self, *stages: str) -> float:
        """Size of some stages on disk, of all by default; without reports, which come and go."""
        files = (p for stage in stages or STAGES for p in (self.root / stage).rglob("*"))
        return round(sum(p.stat().st_size for p in files if p.is_file()) / 1e6, 2)

    def foreign_files(self) -> list[Path]:
        """What lies in the folder and is not vnav's."""
        own = _matching(self.root, (*_OWN, "map.json", LOCK))
        return sorted(set(self.root.iterdir()) - set(own))

    def settings(self, stage: str) -> dict[str, Any]:
        """What a finished stage was made with: the seed, and its sections of the configuration."""
        self.stage(stage)
        return self._record(stage).values["settings"]

    def recorded(self, stage: str) -> StageRecord | None:
        """What a stage, stale or not, was made by and from; None where it is missing."""
        is_there = (self.root / stage / "stage.json").is_file()
        return self._record(stage).values if is_there else None

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
        unique = secrets.token_hex(8)
        draft, old = (self.root / f".{stage}.{unique}.{end}" for end in ("draft", "old"))
        final = self.root / stage
        try:
            draft.mkdir()
        except OSError as error:
            raise unwritable(self.root, error) from error
        try:
            yield draft
            record = {"vnav": __version__, "settings": dict(settings), "inputs": dict(inputs)}
            _write_json(draft / "stage.json", record | {"files": _digests(draft)})
            _sync(draft)
        except OSError as error:
            shutil.rmtree(draft, ignore_errors=True)
            if error.errno not in FULL:
                raise
            raise MapError(
                f"expected room for the stage '{stage}' of the map {self.root}, found:"
                f" {error.strerror}; what is finished is kept: make room and run the command again"
            ) from error
        if final.exists():
            final.rename(old)
        draft.rename(final)
        shutil.rmtree(old, ignore_errors=True)

    def write_report(self, stage: str, report: Mapping[str, Any]) -> None:
        """Counts, quality and seconds of a stage, for people; not an input of anything."""
        (self.root / "reports").mkdir(exist_ok=True)
        _write_json(self.root / "reports" / f"{stage}.json", report)

    @property
    def page(self) -> Path:
        """What `vnav report` writes; it may not be there."""
        return self.root / "reports" / "report.html"

    def report(self, stage: str) -> dict[str, Any]:
        """A stage's last report, empty where there is none."""
        found = _intact(self.root / "reports" / f"{stage}.json")
        return found if is_kind(found, StageNote) else {}

    def write_current(self, pose: Mapping[str, Any]) -> None:
        """Remember the last located pose; OSError where the map is read-only."""
        self._write_state("current", {"pose": dict(pose)})

    def current(self) -> dict[str, Any] | None:
        """The last located pose; None where no photo was located since the map got its world."""
        return self._state("current").get("pose")

    def write_planned(self, path: Mapping[str, Any]) -> None:
        """Remember the last path; OSError where the map is read-only."""
        self._write_state("path", {"plan": dict(path)})

    def planned(self) -> dict[str, Any] | None:
        """The last path; None where none was found since the map got its world."""
        return self._state("path").get("plan")

    def write_photos(self, poses: Sequence[Mapping[str, Any]]) -> None:
        """Remember the photos that were located last together; OSError where it is read-only."""
        self._write_state("photos", {"photos": [dict(pose) for pose in poses]})

    def photos(self) -> list[dict[str, Any]]:
        """The photos that were located last together, in the world that the map has now."""
        found: list[dict[str, Any]] = self._state("photos").get("photos", [])
        return found if is_kind(found, list[dict[str, Any]]) else []

    def write_overlays(self, overlays: Sequence[tuple[str, bytes]]) -> None:
        """Keep small JPEGs of the photos located last, by name; OSError where it is read-only."""
        kept = [{"photo": name, "jpeg": b64encode(data).decode()} for name, data in overlays]
        self._write_state("overlays", {"overlays": kept})

    def overlays(self) -> list[tuple[str, bytes]]:
        """Names and JPEGs of the photos located last, in the world that the map has now."""
        return kept_overlays(self._state("overlays").get("overlays"))

    def _write_state(self, name: str, values: Mapping[str, Any]) -> None:
        (self.root / "state").mkdir(exist_ok=True)
        _write_json(self.root / "state" / f"{name}.json", {"world": self._world(), **values})

    def _state(self, name: str) -> dict[str, Any]:
        """What was remembered in the world that the map has now, empty where nothing was."""
        state = _intact(self.root / "state" / f"{name}.json")
        return state if state.get("world") == self._world() else {}

    def _record(self, stage: str) -> "_Record":
        """A stage's stage.json, read once as long as it is the same file."""
        path = self.root / stage / "stage.json"
        status = path.stat()
        file = status.st_ino, status.st_mtime_ns, status.st_size
        known = self._records.get(stage)
        if known is None or known.file != file:
            values = checked(_read_json(path), StageRecord, path)
            require_inside(values["files"], path)
            known = self._records[stage] = _Record(file, values, _digest(path))
        return known

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


def _write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write an object with the seal that `_read_json` holds it against."""
    write_text(path, to_json({**values, _SEAL: _seal(values)}))


def _read_json(path: Path) -> dict[str, Any]:
    """What `_write_json` wrote; StaleArtifact where it is something else."""
    return _unsealed(_json(path), path)


def _unsealed(values: dict[str, Any], path: Path) -> dict[str, Any]:
    """What stands under a seal; StaleArtifact where it is not what was sealed."""
    seal = values.pop(_SEAL, "")
    try:
        is_whole = seal == _seal(values)
    except ValueError:  # a number that vnav writes into no JSON
        is_whole = False
    if not is_whole:
        raise StaleArtifact(f"expected {path} as vnav wrote it, found another content; {MEND}")
    return values


def _intact(path: Path) -> dict[str, Any]:
    """What `_write_json` wrote; empty where it is missing or damaged, which loses a note."""
    try:
        return _read_json(path)
    except MapError:
        return {}


def _seal(values: Mapping[str, Any]) -> str:
    return hashlib.sha256(to_json(values).encode()).hexdigest()


def _json(path: Path) -> dict[str, Any]:
    try:
        value = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise MapError(f"expected JSON in {path}, found: {error}; build with --fresh") from error
    if not isinstance(value, dict):
        raise MapError(f"expected a JSON object in {path}, found another value; build with --fresh")
    return value


def _matching(root: Path, patterns: Iterable[str]) -> list[Path]:
    return [path for pattern in patterns for path in root.glob(pattern)]


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _digests(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "stage.json")
    return {p.relative_to(folder).as_posix(): _digest(p) for p in files}


def _sync(folder: Path) -> None:
    """Have all files of a folder on the disk: a rename may reach it before what is renamed."""
    for path in (*folder.rglob("*"), folder):
        file = os.open(path, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)
