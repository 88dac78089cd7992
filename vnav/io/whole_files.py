"""Files that are written whole or not at all, wherever a user wants them."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

LONGEST = 40  # of a name, in its draft's; no file system takes more than 255 bytes
DEVICES = Path("/dev")


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


def write_text(path: Path, text: str) -> None:
    """Write text in UTF-8, whole or not at all; see `whole_file`."""
    write_bytes(path, text.encode())
