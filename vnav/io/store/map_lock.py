"""One writer of a map at a time."""

import fcntl
import json
import os
import shlex
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from vnav.errors import MapError

NAME = ".lock"
FLAGS = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC


@contextmanager
def only_writer(root: Path) -> Iterator[None]:
    """In this block nobody else writes the map in a folder, which is made where it is missing.

    The lock is the kernel's and ends with the process, however that ends; a file in the folder
    says who holds it. It follows the folder where that is renamed. MapError names the holder where
    there is one, or says why nothing can be written. A folder made here that stays empty goes.
    """
    with ExitStack() as undo:
        try:
            if not root.exists():
                root.mkdir(parents=True)
                undo.callback(_remove_empty, root)
            folder = os.open(root, os.O_RDONLY | os.O_DIRECTORY)
            undo.callback(os.close, folder)
            file = _locked(root, folder)
        except OSError as error:
            raise unwritable(root, error) from error
        undo.callback(os.close, file)
        undo.callback(_unlink, folder)
        os.ftruncate(file, 0)
        os.write(file, json.dumps(_holder()).encode())
        yield


def unwritable(root: Path, error: OSError) -> MapError:
    """What is told where a map cannot be written."""
    return MapError(
        f"expected to write a map at {root}, found: {error.strerror}; give write permission, make"
        " room, or name another folder with --map"
    )


def _locked(root: Path, folder: int) -> int:
    """The lock file, open and held: the one that is there, not one that its holder removed."""
    while True:
        file = os.open(NAME, FLAGS, 0o666, dir_fd=folder)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            told = os.read(file, 4096)
            os.close(file)
            raise _taken(root, told) from None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file), os.stat(NAME, dir_fd=folder)):
                return file
        os.close(file)


def _holder() -> dict[str, str | int]:
    return {"process": os.getpid(), "host": socket.gethostname(), "command": shlex.join(sys.argv)}


def _taken(root: Path, told: bytes) -> MapError:
    try:
        holder = json.loads(told)
        who = "process {process} on {host} ({command})".format(**holder)
    except (ValueError, KeyError, TypeError):  # it has only just begun
        who = "another process"
    return MapError(
        f"expected to be the only one who writes the map {root}, found that {who} writes it; wait"
        " until it is done, or name another folder with --map"
    )


def _unlink(folder: int) -> None:
    with suppress(FileNotFoundError):
        os.unlink(NAME, dir_fd=folder)


def _remove_empty(root: Path) -> None:
    with suppress(OSError):
        root.rmdir()
