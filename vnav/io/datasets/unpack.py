"""Archives of strangers, unpacked so that no member can write outside its folder."""

import gzip
import hashlib
import tarfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from vnav.core.progress import Progress, silent
from vnav.errors import DatasetError

CHUNK = 1 << 20
MB = 1_000_000
MOST_TIMES = 100  # what is unpacked may be as large as the archive; images hardly shrink in it
DAMAGED = (tarfile.TarError, EOFError, zlib.error, gzip.BadGzipFile)

Manifest = dict[str, tuple[int, str]]  # of a folder: relative path -> bytes, sha256


def unpack(archive: Path, folder: Path, progress: Progress = silent) -> Manifest:
    """Write the members of a .tgz into a new folder; what was written, file by file.

    Only files and folders whose names stay inside are accepted, never links or devices, and
    nothing is written twice: so nothing is ever written through a member to elsewhere. They are
    at most `MOST_TIMES` as large as the archive, so that it fills no disk. The
    archive's own checksum is compared too. DatasetError names the member that is not as expected;
    what was unpacked until then is the caller's to remove.
    """
    folder.mkdir()
    written: Manifest = {}
    whole = archive.stat().st_size // MB + 1
    try:
        with archive.open("rb") as file, gzip.open(file) as stream:
            for path, content in _members(stream, archive):
                if content is None:
                    (folder / path).mkdir(parents=True, exist_ok=True)
                else:
                    written[path.as_posix()] = _write(content, folder / path)
                progress(f"unpacking {archive.name}, MB", file.tell() // MB, whole)
    except (*DAMAGED, FileExistsError, NotADirectoryError) as error:
        raise DatasetError(f"expected a whole .tgz in {archive}, found: {error}") from error
    progress(f"unpacking {archive.name}, MB", whole, whole)
    return written


def _members(
    stream: gzip.GzipFile, archive: Path
) -> Iterator[tuple[PurePosixPath, IO[bytes] | None]]:
    """Path and content of each member, None for folders; then the stream's checksum is compared."""
    left = MOST_TIMES * archive.stat().st_size
    with tarfile.open(fileobj=stream, mode="r|") as tar:
        for member in tar:
            left -= member.size
            yield _checked(member, left, archive), tar.extractfile(member)
    while stream.read(CHUNK):
        pass


def _checked(member: tarfile.TarInfo, left: int, archive: Path) -> PurePosixPath:
    """The member's path below the folder; DatasetError where it is none, or nothing is left."""
    path = PurePosixPath(member.name)
    if not (member.isreg() or member.isdir()):
        kind = "a link" if member.islnk() or member.issym() else "neither file nor folder"
        found = f"'{member.name}', which is {kind}"
    elif member.issparse() or left < 0:
        found = f"'{member.name}', with which it is {MOST_TIMES} times as large as its archive"
    elif path.is_absolute() or ".." in path.parts or set(member.name) & set("\\:\0"):
        found = f"'{member.name}', which leads out of it"
    else:
        return path
    raise DatasetError(
        f"expected only files and folders below one folder in {archive}, found {found}; nothing of"
        " it was kept: do not use this archive"
    )


def _write(content: IO[bytes], path: Path) -> tuple[int, str]:
    """Copy into a new file; its bytes and sha256."""
    path.parent.mkdir(parents=True, exist_ok=True)
    digest, count = hashlib.sha256(), 0
    with path.open("xb") as file:
        while chunk := content.read(CHUNK):
            file.write(chunk)
            digest.update(chunk)
            count += len(chunk)
    return count, digest.hexdigest()
