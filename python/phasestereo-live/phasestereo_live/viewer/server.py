"""What answers the browser: on this machine alone, and only who knows the token.

Addresses are ``http://127.0.0.1:PORT/TOKEN/...``. A page of another site, which a browser may send
here too, knows neither the token nor, with a name of its own for this machine (DNS rebinding), the
right ``Host``.
"""

from __future__ import annotations

import io
import json
import secrets
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from threading import Lock, Thread
from typing import Any, Self
from urllib.parse import parse_qs

import numpy as np

from phasestereo._images import as_pixels, as_rgb8
from phasestereo.io.raster import encode_raster
from phasestereo.views.templating import render_page
from phasestereo_live.video.picture import FramePicture
from phasestereo_live.video.streaming import Frame
from phasestereo_live.viewer.show import RANGES, Show

_HOME = "127.0.0.1"
_LONGEST = 4096  # bytes of what a browser may send
_PATIENCE = 10.0  # seconds that a question for news is left open
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
        What is shown.
    port
        The port; 0: any that is free.

    Raises
    ------
    OSError
        If the port is taken.
    ImportError
        If the extra ``live`` is not installed.
    """

    def __init__(self, show: Show, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(18)
        answers = _Answers(show)
        attributes: dict[str, Any] = {"token": self._token, "answers": answers}
        handler = type("Handler", (_Handler,), attributes)

        self._server = _Listener((_HOME, port), handler)
        self._port = int(self._server.server_address[1])
        answers.hosts = f"{_HOME}:{self._port}", f"localhost:{self._port}"

        self._thread = Thread(target=self._server.serve_forever, daemon=True)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{_HOME}:{self._port}/{self._token}/"

    def __enter__(self) -> Self:
        """Begin to answer."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Answer no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Listener(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of browsers that have gone."""


class _Answers:
    """The answer to every question, and the deed for every request."""

    def __init__(self, show: Show) -> None:
        self._show = show
        self.hosts: tuple[str, ...] = ()
        self._lock = Lock()
        self._encoded: dict[str, tuple[Frame, bytes]] = {}
        self._picture: tuple[tuple[int, int], FramePicture] | None = None

        self.pages: dict[str, tuple[str, Callable[[dict[str, str]], bytes]]] = {
            "": ("text/html; charset=utf-8", self._page),
            "viewer.js": ("text/javascript; charset=utf-8", self._script),
            "state": ("application/json", self._state),
            "value": ("application/json", self._value),
            "left.jpg": ("image/jpeg", self._left),
            "disparity.png": ("image/png", self._disparity),
            "scale.png": ("image/png", self._scale),
        }

        self.deeds: dict[str, Callable[[Any], Any]] = {
            "settings": self._set,
            "save": lambda _: {"saved": show.save(), "folder": str(show.folder.resolve())},
            "close": lambda _: show.close(),
        }

    def _page(self, _: dict[str, str]) -> bytes:
        page = render_page("viewer.html.j2", package="phasestereo_live.viewer", ranges=RANGES)
        return page.encode()

    def _script(self, _: dict[str, str]) -> bytes:
        return (resources.files("phasestereo_live.viewer") / "templates" / "viewer.js").read_bytes()

    def _state(self, query: dict[str, str]) -> bytes:
        state = self._show.wait(int(query.get("after", "-1")), _PATIENCE)
        return json.dumps(state, allow_nan=False).encode()

    def _value(self, query: dict[str, str]) -> bytes:
        value = self._show.value(int(query.get("x", "-1")), int(query.get("y", "-1")))
        return json.dumps(value, allow_nan=False).encode()

    def _set(self, wanted: Any) -> None:
        if not isinstance(wanted, dict):
            raise TypeError(f"settings: got {type(wanted).__name__}; accepts an object")
        self._show.set(wanted)

    def _left(self, _: dict[str, str]) -> bytes:
        return self._drawn("JPEG", lambda frame: as_rgb8(as_pixels(frame.left, "left")))

    def _disparity(self, _: dict[str, str]) -> bytes:
        return self._drawn("PNG", lambda frame: self._colors().drawn(frame.result))

    def _scale(self, _: dict[str, str]) -> bytes:
        low, high = self._show.ends()
        ramp = np.linspace(low, high, 256, dtype=np.float32)[np.newaxis]
        return _encoded(self._colors().colored(ramp), "PNG")

    def _colors(self) -> FramePicture:
        """Return what colors disparities; the table is made anew where the range is another."""
        ends = self._show.ends()
        if self._picture is None or self._picture[0] != ends:
            self._picture = ends, FramePicture(*ends)
        return self._picture[1]

    def _drawn(self, kind: str, draw: Callable[[Frame], np.ndarray[Any, Any]]) -> bytes:
        """Return a picture of the last frame, encoded once however many look at it."""
        frame = self._show.frame
        if frame is None:
            raise ValueError("there is no frame yet")

        with self._lock:
            known = self._encoded.get(kind)
            if known is None or known[0] is not frame:
                known = self._encoded[kind] = frame, _encoded(draw(frame), kind)
            return known[1]


def _encoded(picture: np.ndarray[Any, Any], kind: str) -> bytes:
    file = io.BytesIO()
    encode_raster(file, picture, kind)
    return file.getvalue()


class _Handler(BaseHTTPRequestHandler):
    """Answers one browser."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "phasestereo", ""
    token: str
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
        """Do something: only what a page of ours can ask for, as JSON."""
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
        except (OSError, ValueError, TypeError) as error:
            self._say_json(HTTPStatus.BAD_REQUEST, {"error": " ".join(str(error).split())})

    def _place(self) -> tuple[str, dict[str, str]] | None:
        """Return what is asked for and how, if the browser may ask; else refuse it."""
        if self.headers.get("Host") not in self.answers.hosts:
            self._refuse(HTTPStatus.FORBIDDEN)
            return None

        path, _, query = self.path.partition("?")
        token, slash, name = path.removeprefix("/").partition("/")
        if not (slash and secrets.compare_digest(token.encode(), self.token.encode())):
            self._refuse(HTTPStatus.FORBIDDEN)
            return None
        return name, {key: values[-1] for key, values in parse_qs(query).items()}

    def _refuse(self, status: HTTPStatus) -> None:
        self._say(status, "text/plain; charset=utf-8", f"{status.phrase}\n".encode())

    def _say_json(self, status: HTTPStatus, content: Any) -> None:
        self._say(status, "application/json", json.dumps(content, allow_nan=False).encode())

    def _say(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in {**_HEADERS, "Content-Type": kind}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002 - its name
        """Say nothing: the terminal is for what is found."""
