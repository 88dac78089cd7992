"""Public sequences on this machine: fetched whole or not at all, and checked."""

import hashlib
import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

from vnav.caches import user_cache
from vnav.core.progress import Progress, silent
from vnav.errors import DatasetError
from vnav.io.datasets.catalogue import PublicSequence
from vnav.io.datasets.download import download
from vnav.io.datasets.unpack import Manifest, unpack
from vnav.io.files import write_text
from vnav.io.store.map_folder import to_json
from vnav.io.store.records import read_json


class _ArchiveRecord(TypedDict):
    bytes: int
    sha256: str


class _FetchRecord(TypedDict):
    """What was fetched, and what it held."""

    url: str
    archive: _ArchiveRecord
    files: Manifest


@dataclass(frozen=True)
class Verdict:
    """What became of a fetched sequence: paths of its files below its folder."""

    files: int
    missing: list[str] = field(default_factory=list)
    damaged: list[str] = field(default_factory=list)  # of another size or content

    @property
    def whole(self) -> bool:
        """Whether every file is what was unpacked."""
        return not self.missing and not self.damaged


def datasets_folder() -> Path:
    """Where sequences are kept: ``$VNAV_DATASETS``, else ``vnav/datasets`` in the user's cache."""
    if named := os.environ.get("VNAV_DATASETS"):
        return Path(named)
    return user_cache() / "datasets"


def state(sequence: PublicSequence, root: Path) -> str:
    """How far a sequence is: "fetched", "begun", "own copy" (not by `fetch`), or "" for not."""
    if (root / sequence.name).exists():
        return "fetched" if _record_path(sequence, root).is_file() else "own copy"
    return "begun" if _archive(sequence, root).exists() else ""


def fetch(sequence: PublicSequence, root: Path, progress: Progress = silent) -> bool:
    """Make the folder ``root / sequence.name``; False where it was there already, and whole.

    The archive is downloaded, compared with the published checksum or the one recorded at the
    first fetch, and unpacked into a draft that becomes the folder at last; then it is removed. A
    damaged folder is replaced. DatasetError where any of this fails; what was downloaded is kept
    for the next time, unless it is that which is wrong.
    """
    folder = root / sequence.name
    if folder.exists() and not _record_path(sequence, root).is_file():
        raise DatasetError(
            f"expected to fetch to {folder}, found a folder there that was not fetched by vnav;"
            " use it as it is, move it away, or name another place with --to"
        )
    if folder.exists() and verify(sequence, root).whole:
        return False
    try:
        root.mkdir(parents=True, exist_ok=True)
        archive = _archive(sequence, root)
        download(sequence.url, archive, progress)
        _install(archive, sequence, root, progress)
    except OSError as error:
        raise DatasetError(
            f"expected to write to {root}, found: {error.strerror}; make room there, give write"
            " permission, or name another folder with --to"
        ) from error
    return True


def verify(sequence: PublicSequence, root: Path) -> Verdict:
    """Compare every file of a fetched sequence with what was unpacked; files beside are ignored."""
    files = _record(sequence, root)["files"]
    folder = root / sequence.name
    missing = [name for name in files if not (folder / name).is_file()]
    damaged = [
        name
        for name, (size, sha256) in files.items()
        if name not in missing
        and ((folder / name).stat().st_size != size or _sha256(folder / name) != sha256)
    ]
    return Verdict(len(files), missing, damaged)


def _install(archive: Path, sequence: PublicSequence, root: Path, progress: Progress) -> None:
    """Make a downloaded archive the sequence's folder, and record what it held."""
    draft, old = (root / f".{sequence.name}.{end}" for end in ("draft", "old"))
    for leftover in (draft, old):
        shutil.rmtree(leftover, ignore_errors=True)
    try:
        sha256 = _checked(archive, sequence, root)
        files = unpack(archive, draft, progress)
    except (DatasetError, OSError) as error:
        shutil.rmtree(draft, ignore_errors=True)
        if isinstance(error, DatasetError):
            archive.unlink()
        raise
    top, files = _top(draft, files)
    about = {"bytes": archive.stat().st_size, "sha256": sha256}
    record = {"url": sequence.url, "archive": about, "files": files}
    write_text(_record_path(sequence, root), to_json(record))
    folder = root / sequence.name
    if folder.exists():
        folder.rename(old)
    top.rename(folder)
    for leftover in (draft, old):
        shutil.rmtree(leftover, ignore_errors=True)
    archive.unlink()


def _checked(archive: Path, sequence: PublicSequence, root: Path) -> str:
    """The archive's sha256; DatasetError where it is not the published, or the first, one."""
    found, path = _sha256(archive), _record_path(sequence, root)
    if sequence.sha256:
        expected, source = sequence.sha256, "as published"
    elif path.is_file():
        expected, source = _record(sequence, root)["archive"]["sha256"], f"as recorded in {path}"
    else:
        return found
    if found != expected:
        raise DatasetError(
            f"expected an archive of {sequence.name} with sha256 {expected} {source}, found"
            f" {found} at {sequence.url}: it came damaged or has changed; fetch it again, and if"
            f" you trust the change, remove {path}"
        )
    return found


def _top(draft: Path, files: Manifest) -> tuple[Path, Manifest]:
    """The folder in which all of an archive lies, and its files from there."""
    entries = list(draft.iterdir())
    if len(entries) != 1 or not entries[0].is_dir():
        return draft, files
    prefix = f"{entries[0].name}/"
    return entries[0], {name.removeprefix(prefix): about for name, about in files.items()}


def _record(sequence: PublicSequence, root: Path) -> _FetchRecord:
    path = _record_path(sequence, root)
    try:
        return read_json(path, _FetchRecord)
    except (OSError, ValueError) as error:
        raise DatasetError(
            f"expected the record of {sequence.name} in {path}, found: {error}; remove it and"
            f" {root / sequence.name}, and run 'vnav datasets fetch {sequence.name}'"
        ) from error


def _record_path(sequence: PublicSequence, root: Path) -> Path:
    return root / f"{sequence.name}.json"


def _archive(sequence: PublicSequence, root: Path) -> Path:
    return root / f".{sequence.name}.tgz"


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
