"""Serve the page on this machine only, and only to admitted browsers.

The browser exchanges the key in its address for a cookie: ``http://127.0.0.1:PORT/KEY`` leads to
``http://127.0.0.1:PORT/ROOM/``, which answers nothing without the cookie. The key is in a file that
only this user can read and on the terminal, never in the command line of a browser, which every
user of the machine can see. Browsers send a cookie to all ports of a machine, so this one goes only
to the room, and nobody else knows its name. A browser may also send requests here from a page of
another site. These do not carry the cookie, and, under another name for this machine (DNS
rebinding), not the right ``Host``.

All other clients that connect can only wait for a few seconds, and while connections are free.
"""

from __future__ import annotations

import json
import secrets
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from threading import Lock, Thread
from typing import Any, Self
from urllib.parse import parse_qs

from phasestereo.views.page.blank import blank_viewer, viewer_script
from phasestereo.views.templating import render_page
from phasestereo_live.video.streaming import Frame
from phasestereo_live.viewer.show import RANGES, Display

_HOME = "127.0.0.1"
_LONGEST = 4096  # the most bytes that a browser may send
_PATIENCE = 10.0  # seconds that a request for news stays open
_SILENCE = 20.0  # seconds before a silent connection is closed
_MOST = 32  # connections at a time; a browser opens six
_COOKIE = "phasestereo"
_HTML = "text/html; charset=utf-8"
_NOTHING: Mapping[str, str] = {}
_POLICY = (
    "default-src 'none'; img-src 'self' data:; connect-src 'self'; style-src 'unsafe-inline'; "
    "script-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Server:
    """Serves the page in threads of its own, in a ``with`` block.

    Parameters
    ----------
    show
        The show to serve.
    port
        The port; 0: any free port.

    Raises
    ------
    OSError
        If the port is taken.
    ImportError
        If the extra ``live`` is not installed.
    """

    def __init__(self, show: Display, port: int = 0) -> None:
        self._key, room, cookie = (secrets.token_urlsafe(18) for _ in range(3))
        answers = _Answers(show)
        attributes = {"key": self._key, "room": room, "cookie": cookie, "answers": answers}
        handler = type("Handler", (_Handler,), attributes)

        self._server = _Listener((_HOME, port), handler)
        self._port = int(self._server.server_address[1])
        answers.hosts = f"{_HOME}:{self._port}", f"localhost:{self._port}"

        self._thread = Thread(target=self._server.serve_forever, daemon=True)

    @property
    def address(self) -> str:
        """The address of the page, for the browsers to admit."""
        return f"http://{_HOME}:{self._port}/{self._key}"

    def write_link(self, path: Path) -> Path:
        """Write a new file that leads a browser to the page; only this user can read it.

        Raises
        ------
        OSError
            If it exists, or cannot be written.
        """
        path.touch(mode=0o600, exist_ok=False)
        path.write_bytes(_leading_to(self.address))
        return path

    def __enter__(self) -> Self:
        """Start answering."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop answering."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def _leading_to(address: str) -> bytes:
    """Return a page that leads to another one."""
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>phasestereo</title>'
        '<link rel="icon" href="data:,">'
        f'<meta http-equiv="refresh" content="0; url={address}">'
        f'<a href="{address}">phasestereo</a></html>'
    ).encode()


class _Listener(ThreadingHTTPServer):
    """Accepts connections; if there are too many, it closes the oldest one without a cookie."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 128

    def __init__(self, *given: Any) -> None:
        self._lock = Lock()
        self._connections: dict[Any, bool] = {}  # True for admitted browsers
        super().__init__(*given)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread, if a connection is free or this can free one."""
        with self._lock:
            if len(self._connections) >= _MOST:
                spare = next(
                    (one for one, known in self._connections.items() if not known), request
                )
                self._connections.pop(spare, None)
                with suppress(OSError):
                    spare.shutdown(socket.SHUT_RDWR)  # its thread closes it
            self._connections[request] = False
        super().process_request(request, client_address)

    def recognize(self, request: Any) -> None:
        """Keep a connection even if others come."""
        with self._lock:
            if request in self._connections:
                self._connections[request] = True

    def shutdown_request(self, request: Any) -> None:
        """Close a connection."""
        with self._lock:
            self._connections.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Do not report browsers that are gone."""


class _Answers:
    """Answers every question, and carries out every request."""

    def __init__(self, show: Display) -> None:
        self._show = show
        self.hosts: tuple[str, ...] = ()
        self._lock = Lock()
        self._packed: tuple[Frame, bytes] | None = None

        self.pages: dict[str, tuple[str, Callable[[dict[str, str]], bytes]]] = {
            "": (_HTML, self._page),
            "viewer.js": ("text/javascript; charset=utf-8", self._script),
            "state": ("application/json", self._state),
            "frame": ("application/octet-stream", self._frame),
        }

        self.deeds: dict[str, Callable[[Any], Any]] = {
            "settings": self._set,
            "hold": show.hold,
            "save": self._save,
            "close": lambda _: show.close(),
        }

    def _page(self, _: dict[str, str]) -> bytes:
        blank = blank_viewer(truth=False)
        package = "phasestereo_live.viewer"
        return render_page("live.html.j2", package=package, ranges=RANGES, **blank).encode()

    def _script(self, _: dict[str, str]) -> bytes:
        own = resources.files("phasestereo_live.viewer") / "templates" / "live.js"
        return viewer_script().encode() + own.read_bytes()

    def _state(self, query: dict[str, str]) -> bytes:
        state = self._show.wait(int(query.get("after", "-1")), _PATIENCE)
        return json.dumps(state, allow_nan=False).encode()

    def _frame(self, _: dict[str, str]) -> bytes:
        """Return the frame on display, packed only once for all viewers."""
        with self._lock:
            frame = self._show.looked_at
            if frame is None:
                raise ValueError("there is no frame yet")
            if self._packed is None or self._packed[0] is not frame:
                self._packed = frame, self._show.packed(frame)
            return self._packed[1]

    def _save(self, wants_report: Any) -> dict[str, Any]:
        names = self._show.save(report=wants_report is not False)
        return {"saved": names, "folder": str(self._show.folder.resolve())}

    def _set(self, wanted: Any) -> None:
        if not isinstance(wanted, dict):
            raise TypeError(f"settings: got {type(wanted).__name__}; accepts an object")
        self._show.set(wanted)


def _is_same(one: str, other: str) -> bool:
    """Compare secrets in a time that does not reveal them."""
    return secrets.compare_digest(one.encode("utf-8", "replace"), other.encode())


class _Handler(BaseHTTPRequestHandler):
    """Answers one browser."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "phasestereo", ""
    timeout = _SILENCE
    key: str
    room: str
    cookie: str
    answers: _Answers

    def do_GET(self) -> None:
        """Answer a question."""
        place = self._place()
        if place is None:
            return

        kind, answer = self.answers.pages.get(place[0], ("", None))
        if answer is None:
            self._refuse(HTTPStatus.NOT_FOUND)
            return
        try:
            self._say(HTTPStatus.OK, kind, answer(place[1]))
        except ValueError as error:
            self._say_json(HTTPStatus.BAD_REQUEST, {"error": str(error)})

    def do_POST(self) -> None:
        """Carry out a request, which only our own page can make, as JSON."""
        place = self._place()
        if place is None:
            return

        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal() and int(length) <= _LONGEST):
            self.close_connection = True
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
            return

        body = self.rfile.read(int(length))
        # Other sites may send forms here, but not under our name.
        origin = self.headers.get("Origin")
        if origin is not None and origin != f"http://{self.headers['Host']}":
            self._refuse(HTTPStatus.FORBIDDEN)
            return

        deed = self.answers.deeds.get(place[0])
        if deed is None or self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.NOT_FOUND)
            return

        try:
            self._say_json(HTTPStatus.OK, deed(json.loads(body or b"null")) or {})
        except (OSError, ValueError, TypeError, OverflowError, RecursionError) as error:
            self._say_json(HTTPStatus.BAD_REQUEST, {"error": " ".join(str(error).split())})

    def _place(self) -> tuple[str, dict[str, str]] | None:
        """Return the request's path and method if the browser is admitted; else refuse it."""
        if self.headers.get("Host") not in self.answers.hosts:
            self._refuse(HTTPStatus.FORBIDDEN)
            return None

        path, _, query = self.path.partition("?")
        room, slash, name = path.removeprefix("/").partition("/")
        if self.command == "GET" and not slash and _is_same(room, self.key):
            self._let_in()
            return None

        if not (slash and _is_same(room, self.room) and self._is_known()):
            self._refuse(HTTPStatus.FORBIDDEN)
            return None
        return name, {key: values[-1] for key, values in parse_qs(query).items()}

    def _let_in(self) -> None:
        """Set the cookie, on our own page: browsers do not send it from other sites' pages."""
        cookie = f"{_COOKIE}={self.cookie}; Path=/{self.room}/; HttpOnly; SameSite=Strict"
        page = _leading_to(f"/{self.room}/")
        self._say(HTTPStatus.OK, _HTML, page, {"Set-Cookie": cookie})

    def _is_known(self) -> bool:
        """Return whether the browser has the cookie."""
        wanted = f"{_COOKIE}={self.cookie}"
        if not any(_is_same(one, wanted) for one in self.headers.get("Cookie", "").split("; ")):
            return False

        self.server.recognize(self.connection)  # type: ignore[attr-defined]  # a _Listener
        return True

    def _refuse(self, status: HTTPStatus) -> None:
        self._say(status, "text/plain; charset=utf-8", f"{status.phrase}\n".encode())

    def _say_json(self, status: HTTPStatus, content: Any) -> None:
        self._say(status, "application/json", json.dumps(content, allow_nan=False).encode())

    def _say(
        self, status: HTTPStatus, kind: str, content: bytes, more: Mapping[str, str] = _NOTHING
    ) -> None:
        self.send_response(status)
        for name, value in {**_HEADERS, "Content-Type": kind, **more}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002 - its name
        """Print nothing: the terminal is for findings."""
