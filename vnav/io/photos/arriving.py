"""Photos that are still being written, and those that come into a folder."""

import hashlib
import os
import stat
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from vnav.io.files import read_bytes
from vnav.io.formats.images import is_whole
from vnav.io.photos.photo_files import photos_in

POLL_S = 0.05  # between two looks at a file, or at a folder
SETTLED_S = 1.0  # unchanged for so long, a file whose format does not tell its end is whole
PATIENCE_S = 5.0  # unchanged for so long, a file that is not whole is taken as it is
LOOKING = 0.1  # share of the time that looking at a folder may take


@dataclass(frozen=True)
class _Stamp:
    """Which file has a name, and how it looks from outside."""

    device: int
    inode: int
    size: int
    changed_ns: int


class _WrittenFile:
    """A file that somebody may be writing."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp: _Stamp | None = None
        self._since_s = 0.0

    def is_finished(self) -> bool:
        """Whether it is a whole image, or has not changed for long; also where there is no file."""
        stamp, now_s = _stamp_of(self._path), time.monotonic()
        if stamp is None:
            return True
        if stamp != self._stamp:
            self._stamp, self._since_s = stamp, now_s
        unchanged_s = max(now_s - self._since_s, time.time() - stamp.changed_ns / 1e9)
        whole = is_whole(self._path)
        if whole:
            return _stamp_of(self._path) == stamp
        return unchanged_s >= (PATIENCE_S if whole is False else SETTLED_S)


def wait_until_written(path: Path) -> None:
    """Return when a photo is whole, or has not changed for `PATIENCE_S`; at once for no file.

    PNG and JPEG tell where they end. A file of another format is whole when it has not changed for
    `SETTLED_S`.
    """
    file = _WrittenFile(path)
    while not file.is_finished():
        time.sleep(POLL_S)


def arriving_photos(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """The photos of a folder in order of name, then each one that comes, for ever.

    Each once, when it is written: a file that is renamed or touched is the same photo, one with
    other content is another. Hidden files are drafts, and left out. PhotoError where there is no
    folder.
    """
    files, given, known = dict[Path, _WrittenFile](), dict[Path, _Stamp](), set[object]()
    while True:
        started_s = time.monotonic()
        for path in photos_in(Path(folder)):
            stamp = _stamp_of(path)
            if path.name.startswith(".") or stamp is None or given.get(path) == stamp:
                continue
            if not files.setdefault(path, _WrittenFile(path)).is_finished():
                continue
            photo = stamp.device, stamp.inode, _digest(path)
            given[path] = stamp
            del files[path]
            if photo not in known:
                known.add(photo)
                yield path
                if not path.exists():  # it was renamed before it was read
                    known.discard(photo)
        time.sleep(max(POLL_S, (time.monotonic() - started_s) / LOOKING))


def _stamp_of(path: Path) -> _Stamp | None:
    """Of a regular file; None where there is none of that name."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    if not stat.S_ISREG(status.st_mode):
        return None
    return _Stamp(status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)


def _digest(path: Path) -> bytes:
    """Of what a file holds; empty where it cannot be read."""
    try:
        return hashlib.blake2b(read_bytes(path), digest_size=16).digest()
    except OSError:
        return b""
