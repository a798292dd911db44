"""The dashboard over HTTP: to this machine only, and only to be read.

A page of elsewhere, open in a browser of this machine, could have a name of its own resolve to 127.0.0.1 (DNS
rebinding): so requests are answered only if they name this machine. They carry no cookie and change nothing.
"""

import errno
import re
import socket
import sys
import threading
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from weld_force_ros.errors import InputError
from weld_force_ros.report.live_report import LiveReport

ADDRESS = "127.0.0.1"
_HOSTS = ("localhost", ADDRESS, "[::1]")
_MOST_CONNECTIONS = 64
_IDLE_S = 30.0
_ROWS = re.compile(r"/rows(\?after=(?P<after>[0-9]{1,15}))?")
_WELD = re.compile(r"/weld/(?P<number>[0-9]{1,15})")
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class Server:
    """Serves a page, the rows of a board and the details of its welds, on threads of its own.

    Args:
        board: what to show.
        page: the report's page for a server, HTML.
        port: on 127.0.0.1; 0 takes a free one.

    Raises:
        InputError: the port cannot be used.
    """

    def __init__(self, board: LiveReport, page: str, port: int) -> None:
        try:
            self._http = _Http(board, page.encode(), port)
        except OSError as error:
            reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be used: {error.strerror or error}"
            raise InputError(
                f"the dashboard's port {port} {reason}", "give another one with --dashboard-port (parameter port)"
            ) from None
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.1,), name="dashboard", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where to look."""
        return f"http://{ADDRESS}:{self._http.server_port}/"

    def close(self) -> None:
        """Answer no more, and let go of the port."""
        self._http.shutdown()
        self._thread.join()
        self._http.server_close()
        self._http.disconnect()


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    # socketserver's own is 5: of more connections at once than that, the others try again after seconds.
    request_queue_size = 2 * _MOST_CONNECTIONS

    def __init__(self, board: LiveReport, page: bytes, port: int) -> None:
        self.board, self.page = board, page
        self._connections: set[socket.socket] = set()
        self._lock = threading.Lock()
        super().__init__((ADDRESS, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer on a thread of the connection's own, if there are not too many."""
        with self._lock:
            welcome = len(self._connections) < _MOST_CONNECTIONS
            if welcome:
                self._connections.add(request)
        if welcome:
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        """Forget a connection."""
        super().shutdown_request(request)
        with self._lock:
            self._connections.discard(request)

    def disconnect(self) -> None:
        """End what browsers keep open."""
        with self._lock:
            for connection in self._connections:
                with suppress(OSError):  # it has gone already
                    connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes away in the middle is nothing to be told of."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: _Http
    protocol_version = "HTTP/1.1"
    timeout = _IDLE_S
    server_version, sys_version = "weld-force", ""

    def do_GET(self) -> None:
        """Answer, if it is this machine that is asked for."""
        named = self.headers.get_all("Host") or []
        if len(named) != 1 or not self._is_this_machine(named[0].lower()):
            self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"This dashboard answers to this machine's name only.\n")
            return
        board = self.server.board
        if self._is_page:
            self._answer(HTTPStatus.OK, "text/html; charset=utf-8", self.server.page)
        elif asked := _ROWS.fullmatch(self.path):
            self._answer(HTTPStatus.OK, "application/json", board.rows_after(int(asked["after"] or 0)))
        elif (asked := _WELD.fullmatch(self.path)) and (found := board.detail(int(asked["number"]))) is not None:
            self._answer(HTTPStatus.OK, "application/gzip", found)
        else:
            self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"There is nothing here.\n")

    do_HEAD = do_GET  # noqa: N815

    def _refuse(self) -> None:
        self.close_connection = True  # what it sends along is not read
        self._answer(HTTPStatus.METHOD_NOT_ALLOWED, "text/plain", b"To be read only.\n", Allow="GET, HEAD")

    do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = _refuse  # noqa: N815

    def _is_this_machine(self, host: str) -> bool:
        return host in {known for name in _HOSTS for known in (name, f"{name}:{self.server.server_port}")}

    @property
    def _is_page(self) -> bool:
        return getattr(self, "path", "").partition("?")[0] == "/"

    def _answer(self, status: HTTPStatus, content_type: str, content: bytes, **headers: str) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": content_type, "Content-Length": str(len(content)), **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def end_headers(self) -> None:
        """With every answer, errors too."""
        # What the page itself may do stands in the page, by the hashes of its scripts.
        policy = "frame-ancestors 'none'" if self._is_page else "default-src 'none'; frame-ancestors 'none'"
        for name, value in {**_HEADERS, "Content-Security-Policy": policy}.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """A page asks twice a second."""
