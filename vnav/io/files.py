"""Files that users name: read where they are files and of a size, written whole or not at all."""

import errno
import os
import secrets
import shutil
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

LONGEST = 40  # of a name, in its draft's; no file system takes more than 255 bytes
DEVICES = Path("/dev")
MOST_BYTES = 2**30  # of a file that is read as one


def read_bytes(path: Path) -> bytes:
    """What a regular file holds; OSError for any other, which may never end, and for a huge one."""
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a name that no file can have", str(path))
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "no regular file", str(path))
    if status.st_size > MOST_BYTES:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return path.read_bytes()


def read_text(path: Path) -> str:
    """Text in UTF-8; OSError as `read_bytes`, UnicodeDecodeError where it is no such text."""
    return read_bytes(path).decode("utf-8-sig")


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; OSError as `read_bytes`, ValueError where it is none."""
    try:
        return tomllib.loads(read_text(path))
    except RecursionError as error:
        raise ValueError("tables within tables within tables") from error


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to fill, which takes the place of ``path`` when the block ends without an error.

    A link stays, and what it leads to is replaced. Devices and pipes are written to as they are.
    OSError where that cannot be; what was there is then as it was.
    """
    target = Path(os.path.realpath(path))
    if path.absolute().is_relative_to(DEVICES) or target.exists() and not target.is_file():
        with target.open("ab") as file:
            yield file
        return
    draft = target.with_name(f".{target.name[:LONGEST]}.{secrets.token_hex(8)}.draft")
    mode = target.stat().st_mode & 0o777 if target.exists() else 0o666
    try:
        with open(draft, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; see `whole_file`."""
    with whole_file(path) as file:
        file.write(content)


def copy_into(folder: Path, source: Path) -> Path:
    """A copy of a file in a folder, whole or not at all; see `whole_file`."""
    with source.open("rb") as content, whole_file(folder / source.name) as copy:
        shutil.copyfileobj(content, copy)
    return folder / source.name


def write_text(path: Path, text: str) -> None:
    """Write text in UTF-8, whole or not at all; see `whole_file`."""
    write_bytes(path, text.encode())
