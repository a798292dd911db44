"""The live report over HTTP, read-only: for browsers on this machine, or with a token in the address for a tablet.

A page from elsewhere, open in a browser on this machine, could make its own name resolve to 127.0.0.1 (DNS rebinding):
so requests are answered only if they name this machine. They carry no cookie and change nothing. A server that others
can reach answers only those who know its token, whatever they call the machine.
"""

import errno
import hmac
import re
import secrets
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
ANY_ADDRESS = "0.0.0.0"  # noqa: S104 - never the default, and then with a token
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
        port: 0 takes a free one.
        host: address of this machine to serve on; any but 127.0.0.1 puts a new token into the page's address.

    Raises:
        InputError: the host or the port cannot be used.
    """

    def __init__(self, report: LiveReport, page: str, port: int, host: str = ADDRESS) -> None:
        self._host = host
        token = "" if host == ADDRESS else secrets.token_urlsafe(12)
        try:
            self._http = _Http(report, page.encode(), (host, port), token)
        except (socket.gaierror, UnicodeError) as error:
            raise _no_host(host, error) from None
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise _no_host(host, error) from None
            reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be used: {error.strerror or error}"
            raise InputError(
                f"the dashboard's port {port} {reason}", "give another one with --dashboard-port (parameter port)"
            ) from None
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.1,), name="dashboard", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        host = _outward_address() if self._host == ANY_ADDRESS else self._host
        return f"http://{host}:{self._http.server_port}{self._http.root}"

    def close(self) -> None:
        """Stop answering, end open connections and release the port."""
        self._http.shutdown()
        self._thread.join()
        self._http.server_close()
        self._http.disconnect()


def _no_host(host: str, error: Exception) -> InputError:
    return InputError(
        f"the dashboard's host {host!r} is no address of this machine ({error})",
        f"give one of its addresses, or {ANY_ADDRESS} for all (--dashboard-host, parameter host)",
    )


def _outward_address() -> str:
    """Return the address that others are likely to reach this machine by; no packet is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # reserved for documentation (RFC 5737)
        except OSError:  # no network
            return ADDRESS
        return str(probe.getsockname()[0])


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    # socketserver's own is 5: of more connections at once than that, the others try again after seconds.
    request_queue_size = 2 * _MOST_CONNECTIONS

    def __init__(self, report: LiveReport, page: bytes, address: tuple[str, int], token: str) -> None:
        self.report, self.page = report, page
        self.root = f"/{token}/" if token else "/"
        self._connections: set[socket.socket] = set()
        self._lock = threading.Lock()
        super().__init__(address, _Handler)

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
        """Answer a request that names this machine, or knows the token."""
        if self.server.root == "/" and not self._names_this_machine:
            self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"This dashboard answers to this machine's name only.\n")
            return
        report, asked = self.server.report, self._asked
        if self._is_page:
            self._answer(HTTPStatus.OK, "text/html; charset=utf-8", self.server.page)
        elif matched := _ROWS.fullmatch(asked):
            self._answer(HTTPStatus.OK, "application/json", report.rows_after(int(matched["after"] or 0)))
        elif asked == "/header":
            self._answer(HTTPStatus.OK, "text/html; charset=utf-8", report.header())
        elif (matched := _WELD.fullmatch(asked)) and (detail := report.detail(int(matched["number"]))) is not None:
            self._answer(HTTPStatus.OK, "application/gzip", detail)
        else:
            self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"There is nothing here.\n")

    do_HEAD = do_GET  # noqa: N815

    def _refuse(self) -> None:
        self.close_connection = True  # the request's body is not read
        self._answer(HTTPStatus.METHOD_NOT_ALLOWED, "text/plain", b"To be read only.\n", Allow="GET, HEAD")

    do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = _refuse  # noqa: N815

    @property
    def _names_this_machine(self) -> bool:
        hosts = self.headers.get_all("Host") or []
        ours = {known for name in _HOSTS for known in (name, f"{name}:{self.server.server_port}")}
        return len(hosts) == 1 and hosts[0].lower() in ours

    @property
    def _asked(self) -> str:
        """Return the path below the page's address; empty where that is not known to who asks."""
        path, root = getattr(self, "path", "").encode(), self.server.root.encode()
        return (b"/" + path[len(root) :]).decode() if hmac.compare_digest(path[: len(root)], root) else ""

    @property
    def _is_page(self) -> bool:
        return self._asked.partition("?")[0] == "/"

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
