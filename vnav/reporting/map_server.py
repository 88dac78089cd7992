"""The page of a map with its whole cloud and surface, served to browsers of this machine.

What can be asked for is the page and its large layers, by addresses that are compared as a whole:
none is the path of a file. The map is read as it is when it is asked for, and not written to.
"""

import logging
import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock
from typing import Any

from vnav.errors import MapError, VnavError
from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_page, view3d
from vnav.reporting import map_pictures as pictures
from vnav.reporting.layers import LARGE, large_layer

HOST = "127.0.0.1"
HTML, BINARY, TEXT = "text/html; charset=utf-8", "application/octet-stream", "text/plain"
ICON = "/favicon.ico"  # browsers ask for it
GONE = "Nothing is here: a layer is empty, or the map has been made anew. Load the page again."

log = logging.getLogger(__name__)


class MapServer(ThreadingHTTPServer):
    """Serves a map's page at ``address`` from `serve_forever` on.

    ``port``: 0 takes one that is free. MapError where the port cannot be had.
    """

    daemon_threads = True

    def __init__(self, folder: MapFolder, port: int = 0) -> None:
        self.folder, self.reading = folder, Lock()
        try:
            super().__init__((HOST, port), _Answer)
        except OSError as error:
            raise MapError(
                f"expected port {port} of {HOST} to be free for the page of {folder.root}, found:"
                f" {error.strerror}; name another with --port, or 0 for any that is free"
            ) from error

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.server_port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that has gone away is no fault."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Answer(BaseHTTPRequestHandler):
    """The answer to one request."""

    server: MapServer

    def do_GET(self) -> None:
        """Send the page or a layer; nothing to who got here by another name, as a foreign site."""
        if self.headers.get("Host", "").partition(":")[0] not in (HOST, "localhost"):
            return self._send(HTTPStatus.FORBIDDEN, TEXT, b"")
        try:
            with self.server.reading:
                answer = _answer(self.server.folder, self.path)
        except VnavError as error:
            answer = HTTPStatus.INTERNAL_SERVER_ERROR, TEXT, f"vnav: {error}".encode()
        return self._send(*answer)

    def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Tell of a request in the log."""
        log.debug(format, *args)


def _answer(folder: MapFolder, address: str) -> tuple[HTTPStatus, str, bytes]:
    """Status, kind and content of what is at an address; VnavError where the map is damaged."""
    if address == ICON:
        return HTTPStatus.NO_CONTENT, TEXT, b""
    large = addresses(folder)
    if address == "/":
        view = view3d.figure_beside(folder, large) if large else ""
        text = map_page.page(folder, view, pictures.drawn(folder) if large else {})
        return HTTPStatus.OK, HTML, text.encode()
    name = next((name for name, known in large.items() if known == address), None)
    layer = large_layer(folder, name) if name else None
    if layer is None:
        return HTTPStatus.NOT_FOUND, TEXT, GONE.encode()
    return HTTPStatus.OK, BINARY, layer.packed()


def addresses(folder: MapFolder) -> dict[str, str]:
    """Where the large layers of a map are, others after it was made anew; none before."""
    if not folder.has("fuse"):
        return {}
    digest = folder.inputs_of("fuse")["fuse"]
    return {name: f"/{digest}/{name}" for name in LARGE}
