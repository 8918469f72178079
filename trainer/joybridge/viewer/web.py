"""The local web server of the page. It listens on the loopback interface and answers only those who know its URL.

A page of another origin, a name that has been pointed to this machine (DNS rebinding) and a program without the token
get the same empty answer as for a file that does not exist.
"""

import atexit
import hmac
import html
import logging
import secrets
import socket
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from tempfile import NamedTemporaryFile
from threading import Thread

from websockets.datastructures import Headers, MultipleValuesError
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from joybridge.client.signals import wait_for_interrupt
from joybridge.config.errors import ConfigError
from joybridge.viewer.messages import MAX_MESSAGE_BYTES

HOST = "127.0.0.1"
PORT = 5006  # a fixed one by default, because browsers remember controls per host and port
SOCKET = "socket"  # the path of the WebSocket, after the token
KINDS = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Website:
    """The files of the page and its WebSocket, below a secret token in the path."""

    def __init__(self, port: int, index: str) -> None:
        """Make a token for a server that listens on `port`. index: the file that the URL itself is."""
        self._index = index
        self.token = secrets.token_urlsafe(24)
        self.url = f"http://{HOST}:{port}/{self.token}/"
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
        folder = files(__package__) / "page"
        self._files = {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the response to a request; None for one that may open the WebSocket."""
        name = self._allowed(request)
        if name == SOCKET:
            return None
        name = self._index if name == "" else name
        if name is None or name not in self._files:
            return Response(HTTPStatus.NOT_FOUND, "Not Found", Headers({"Content-Length": "0", **HEADERS}))
        body = self._files[name]
        headers = {
            "Content-Type": KINDS[Path(name).suffix],
            "Content-Length": str(len(body)),
            "Connection": "close",
            **HEADERS,
        }
        return Response(HTTPStatus.OK, "OK", Headers(headers), body)

    def _allowed(self, request: Request) -> str | None:
        """Return the name that a request asks for, None if it may not ask."""
        try:
            host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        except MultipleValuesError:
            return None
        place, _, name = request.path.rpartition("/")
        if (
            request.method != "GET"
            or host not in self._hosts
            or not hmac.compare_digest(place.encode(), f"/{self.token}".encode())
        ):
            return None
        return name if origin == f"http://{host}" or (origin is None and name != SOCKET) else None


@contextmanager
def open_website(
    port: int | None, play: Callable[[ServerConnection], None], index: str = "index.html"
) -> Iterator[str]:
    """Serve the page in threads, `play` with each page that is opened, and yield the URL; the end closes all pages.

    port: 0: any free one; None: PORT, or any free one if that is in use. index: the file of the page.
    Raises ConfigError for one that is in use.
    """
    listening = _listen(port)
    website = Website(listening.getsockname()[1], index)

    def handle(connection: ServerConnection) -> None:
        with suppress(ConnectionClosed):  # the page has gone away
            play(connection)

    silent = logging.getLogger(__name__)
    silent.setLevel(logging.CRITICAL + 1)  # requests of strangers are no news
    with serve(
        handle,
        sock=listening,
        process_request=website.answer,
        compression=None,
        max_size=MAX_MESSAGE_BYTES,
        logger=silent,
        server_header=None,
        open_timeout=2.0,  # the end waits for connections on which nothing has come
        close_timeout=1.0,
    ) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield website.url


def show(url: str, *, browser: bool) -> None:
    """Show a page until the command is interrupted. browser: open it there."""
    if browser:
        open_browser(url)
    with suppress(KeyboardInterrupt):
        wait_for_interrupt()


def open_browser(url: str) -> None:
    """Open a URL in the browser, by way of a file that only this user can read, and that is there until the end.

    All users of the machine see the browser's command line, and the URL has the token of the page.
    """
    with NamedTemporaryFile("w", prefix="joybridge-", suffix=".html", delete=False) as file:
        file.write(f'<meta http-equiv="refresh" content="0; url={html.escape(url)}">')
    path = Path(file.name)
    atexit.register(path.unlink, missing_ok=True)
    webbrowser.open(path.as_uri())


def _listen(port: int | None) -> socket.socket:
    for candidate in (PORT, 0) if port is None else (port,):
        try:
            return socket.create_server((HOST, candidate))
        except OSError as error:
            reason = error.strerror
    raise ConfigError(f"--port: cannot listen on {port} ({reason}); choose another port, or 0 for any free one")
