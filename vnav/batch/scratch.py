"""Temporary folders of tasks; where their owner is killed, the next run clears them."""

import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PREFIX = "vnav-task-"
YOUNG_S = 60.0  # a folder so new may not be held yet


@contextmanager
def scratch() -> Iterator[Path]:
    """A temporary folder for as long as the block, or this process, lives."""
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as name:
        held = os.open(name, os.O_RDONLY)
        try:
            fcntl.flock(held, fcntl.LOCK_EX)  # the kernel lets go of it with this process
            yield Path(name)
        finally:
            os.close(held)


def clear_abandoned() -> None:
    """Remove this user's folders whose process has ended."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        try:
            held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:  # gone, or another user's
            continue
        try:
            status = os.fstat(held)
            if status.st_uid == os.getuid() and time.time() - status.st_mtime > YOUNG_S:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
        except BlockingIOError:  # its process lives
            continue
        finally:
            os.close(held)
