"""The live report over HTTP, for browsers on this machine only, and read-only.

A page from elsewhere, open in a browser on this machine, could make its own name resolve to 127.0.0.1 (DNS rebinding):
so requests are answered only if they name this machine. They carry no cookie and change nothing.
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
    """An HTTP server of a page, and of the rows and details of a live report, on threads of its own.

    Args:
        report: whose rows and details are served.
        page: HTML that requests them.
        port: on 127.0.0.1; 0 takes a free one.

    Raises:
        InputError: the port cannot be used.
    """

    def __init__(self, report: LiveReport, page: str, port: int) -> None:
        try:
            self._http = _Http(report, page.encode(), port)
        except OSError as error:
            reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be used: {error.strerror or error}"
            raise InputError(
                f"the dashboard's port {port} {reason}", "give another one with --dashboard-port (parameter port)"
            ) from None
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.1,), name="dashboard", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{ADDRESS}:{self._http.server_port}/"

    def close(self) -> None:
        """Stop answering, end open connections and release the port."""
        self._http.shutdown()
        self._thread.join()
        self._http.server_close()
        self._http.disconnect()


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    # socketserver's own is 5: of more connections at once than that, the others try again after seconds.
    request_queue_size = 2 * _MOST_CONNECTIONS

    def __init__(self, report: LiveReport, page: bytes, port: int) -> None:
        self.report, self.page = report, page
        self._connections: set[socket.socket] = set()
        self._lock = threading.Lock()
        super().__init__((ADDRESS, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer on a new thread, or close the connection if there are too many."""
        with self._lock:
            accepted = len(self._connections) < _MOST_CONNECTIONS
            if accepted:
                self._connections.add(request)
        if accepted:
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection and make room for another."""
        super().shutdown_request(request)
        with self._lock:
            self._connections.discard(request)

    def disconnect(self) -> None:
        """End the connections that browsers keep open."""
        with self._lock:
            for connection in self._connections:
                with suppress(OSError):  # it has gone already
                    connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error, unless a browser closed its connection."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: _Http
    protocol_version = "HTTP/1.1"
    timeout = _IDLE_S
    server_version, sys_version = "weld-force", ""

    def do_GET(self) -> None:
        """Answer a request that names this machine."""
        hosts = self.headers.get_all("Host") or []
        ours = {known for name in _HOSTS for known in (name, f"{name}:{self.server.server_port}")}
        if len(hosts) != 1 or hosts[0].lower() not in ours:
            self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"This dashboard answers to this machine's name only.\n")
            return
        report = self.server.report
        if self._is_page:
            self._answer(HTTPStatus.OK, "text/html; charset=utf-8", self.server.page)
        elif matched := _ROWS.fullmatch(self.path):
            self._answer(HTTPStatus.OK, "application/json", report.rows_after(int(matched["after"] or 0)))
        elif (matched := _WELD.fullmatch(self.path)) and (detail := report.detail(int(matched["number"]))) is not None:
            self._answer(HTTPStatus.OK, "application/gzip", detail)
        else:
            self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"There is nothing here.\n")

    do_HEAD = do_GET  # noqa: N815

    def _refuse(self) -> None:
        self.close_connection = True  # the request's body is not read
        self._answer(HTTPStatus.METHOD_NOT_ALLOWED, "text/plain", b"To be read only.\n", Allow="GET, HEAD")

    do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = _refuse  # noqa: N815

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
        """Add the security headers to every answer, errors too."""
        # What the page itself may do stands in the page, by the hashes of its scripts.
        policy = "frame-ancestors 'none'" if self._is_page else "default-src 'none'; frame-ancestors 'none'"
        for name, value in {**_HEADERS, "Content-Security-Policy": policy}.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """Log nothing: a page sends two requests a second."""
