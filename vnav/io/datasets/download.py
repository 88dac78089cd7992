"""Downloads that go on where they broke off."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from http import HTTPStatus
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

from vnav import __version__
from vnav.core.progress import Progress, silent
from vnav.errors import DatasetError
from vnav.io.files import write_text
from vnav.io.store.map_folder import to_json

TIMEOUT_S = 30.0  # without a byte
CHUNK = 1 << 18
MB = 1_000_000


@dataclass(frozen=True)
class _Source:
    """What a part of a file was downloaded from; it is gone on with only from the same."""

    url: str
    validator: str  # ETag or Last-Modified: changes when the file does
    bytes: int


def download(url: str, path: Path, progress: Progress = silent) -> None:
    """Fetch the file at an http(s) address, going on with what ``path`` holds of it already.

    What was fetched is kept when the connection breaks off; a connection that brought something
    is taken up again at once (RFC 9110, 14.2: Range with If-Range). A server that knows no
    ranges, or whose file has changed, starts over. DatasetError where nothing more comes.
    """
    if urlsplit(url).scheme not in ("http", "https"):
        raise DatasetError(f"expected an address that begins with https:// or http://, found {url}")
    kept = -1
    while _size(path) > kept:
        kept = _size(path)
        if _transfer(url, path, progress):
            _source_file(path).unlink(missing_ok=True)
            return
    raise DatasetError(
        f"expected the rest of {url}, found that the connection broke off after"
        f" {_size(path) / 1e6:.1f} MB; these are kept, run the same command again to go on"
    )


def _transfer(url: str, path: Path, progress: Progress) -> bool:
    """Whether the file is whole after one connection."""
    kept = _kept(url, path)
    if kept is not None and kept.bytes == _size(path):
        return True
    response, total = _answer(url, path, kept)
    name, whole = urlsplit(url).path.rpartition("/")[2], total // MB + 1
    with response, path.open("ab") as file:
        for chunk in _chunks(response):
            file.write(chunk)
            progress(f"{name}, MB", file.tell() // MB, whole)
    if _size(path) < total:
        return False
    progress(f"{name}, MB", whole, whole)
    return True


def _answer(url: str, path: Path, kept: _Source | None) -> tuple[HTTPResponse, int]:
    """A response whose bytes belong behind those in ``path``, and the size of the whole file.

    Where the server does not go on, what is in ``path`` is dropped, and the file comes anew.
    """
    response = _ask(url, path, kept)
    if kept is not None and response is not None and _goes_on(response, path, kept):
        return response, kept.bytes
    if response is None or response.status != HTTPStatus.OK:
        response = _ask(url, path, None)
    if response is None or not response.headers.get("Content-Length", "").isdecimal():
        raise DatasetError(
            f"expected a server that tells how long {url} is, found none; name another with --from"
        )
    source = _Source(url, _validator(response), int(response.headers["Content-Length"]))
    path.write_bytes(b"")
    write_text(_source_file(path), to_json(asdict(source)))
    return response, source.bytes


def _ask(url: str, path: Path, kept: _Source | None) -> HTTPResponse | None:
    """The server's answer, to a question for the rest where some is kept; None for "no such"."""
    headers = {"User-Agent": f"vnav/{__version__}"}
    if kept is not None:
        headers |= {"Range": f"bytes={_size(path)}-", "If-Range": kept.validator}
    try:
        response: HTTPResponse = urlopen(Request(url, headers=headers), timeout=TIMEOUT_S)
    except HTTPError as error:
        if kept is not None and error.code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
            return None
        raise DatasetError(
            f"expected an archive at {url}, found: {error.code} {error.reason}; it may have moved:"
            " see the page that 'vnav datasets list' gives, or name a mirror with --from"
        ) from error
    except (URLError, HTTPException, OSError) as error:
        reason = getattr(error, "reason", error)
        raise DatasetError(
            f"expected to reach {urlsplit(url).netloc}, found: {reason}; is there a network?"
            " Fetch it where there is one and copy the folder, or name a mirror with --from"
        ) from error
    return response


def _goes_on(response: HTTPResponse, path: Path, kept: _Source) -> bool:
    asked = f"bytes {_size(path)}-{kept.bytes - 1}/{kept.bytes}"
    return (
        response.status == HTTPStatus.PARTIAL_CONTENT
        and response.headers.get("Content-Range") == asked
    )


def _chunks(response: HTTPResponse) -> Iterator[bytes]:
    """What comes until the end, or until the connection breaks off."""
    while True:
        try:
            chunk = response.read1(CHUNK)
        except (HTTPException, OSError):
            return
        if not chunk:
            return
        yield chunk


def _validator(response: HTTPResponse) -> str:
    tag = response.headers.get("ETag", "")
    return response.headers.get("Last-Modified", "") if not tag or tag.startswith("W/") else tag


def _kept(url: str, path: Path) -> _Source | None:
    """Where the part in ``path`` came from; None where it cannot be gone on with."""
    try:
        source = _Source(**json.loads(_source_file(path).read_text("utf-8")))
    except (OSError, ValueError, TypeError):
        return None
    fits = source.url == url and source.validator and 0 < _size(path) <= source.bytes
    return source if fits else None


def _source_file(path: Path) -> Path:
    return path.with_name(f"{path.name}.json")


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0
