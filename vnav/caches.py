"""The user's cache folder, and where in it machine code is kept from one run to the next."""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path


def user_cache() -> Path:
    """``vnav`` in ``$XDG_CACHE_HOME``, or in ``~/.cache``; a temporary one for a user without home.

    It need not be there.
    """
    folder = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    return folder / "vnav" if folder.is_absolute() else _temporary()


@cache
def code_cache() -> Path | None:
    """A folder for machine code that only this user can write: what is loaded from it is run.

    ``$NUMBA_CACHE_DIR``, as it is; else the user's cache folder, else a temporary one; None where
    neither can be written.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    return next((folder for folder in _candidates() if _is_own(folder)), None)


def _candidates() -> Iterator[Path]:
    with suppress(FileNotFoundError):  # not even a temporary one
        yield user_cache() / "compiled"
        yield _temporary()


def _temporary() -> Path:
    return Path(tempfile.gettempdir()) / f"vnav-{os.getuid()}"


def _is_own(folder: Path) -> bool:
    """Whether a folder, made where it is missing, belongs to this user and takes files."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
        with tempfile.TemporaryFile(dir=folder):
            is_folder = stat.S_ISDIR(status.st_mode)
            return is_folder and status.st_uid == os.getuid() and not status.st_mode & 0o022
    except OSError:
        return False
