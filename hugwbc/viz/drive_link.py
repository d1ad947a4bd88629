"""The driver's line to the live page, and who may use it: keys and a heartbeat come in, what to display goes out.

viser's page has no keyboard for robots, and says that a browser is gone only when its connection ends. Our part of the
page therefore has its own web socket on the same port, behind the same checks. Every 50 ms it says what is held; the
answer is what to display. A page that falls silent is gone (`DriveLink.silence`).

Only browsers that ask this machine for the page by its own name may use it, and only its own page. A server on
127.0.0.1 is still within reach of every page that the user's browser has open: a page of another site may open a web
socket to it (the browser says so in `Origin`, and leaves it to the server to check), or may have its own name point to
127.0.0.1 and so count as the same site (then `Host` has that name).
"""

import contextlib
import dataclasses
import http
import json
import math
import pathlib
import re
import threading
import time
import types
from collections.abc import Awaitable, Callable, Iterator
from typing import Any, cast

import msgspec
import websockets
import websockets.asyncio.server as server
import websockets.exceptions
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from hugwbc.errors import ConfigError
from hugwbc.viz.drive_keys import HELP, KEY_CODES, Touched, actions

Handler = Callable[[server.ServerConnection], Awaitable[None]]
SOCKET = "/drive"
SILENT_TIME = 0.35  # [s]; while a page says nothing for longer, its robot waits at rest
LONGEST_MESSAGE = 4096  # characters
MOST_ACTIONS = 32  # that wait for the next picture, from all pages
_FOLDER = pathlib.Path(__file__).parent
_FILES = {"/drive.js": "text/javascript; charset=utf-8", "/drive.css": "text/css; charset=utf-8"}
_starting = threading.Lock()
_TAGS = '<link rel="stylesheet" href="/drive.css"><script src="/drive.js"></script>'


class _Filtered:
    """A web socket of viser's page; what viser need not hear is dropped."""

    def __init__(self, connection: server.ServerConnection) -> None:
        self._connection = connection

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        return getattr(self._connection, name)

    async def recv(self) -> str | bytes:
        """Return the next message that viser may hear."""
        while not admitted(message := await self._connection.recv()):
            pass
        return message


@dataclasses.dataclass
class _Page:
    heard: float
    touched: Touched = dataclasses.field(default_factory=Touched)
    dark: bool | None = None  # whether its theme is dark


class DriveLink:
    """The messages between the open pages and the control loop.

    The server's thread and the control loop's thread use it at any time.
    """

    def __init__(self, about: dict[str, Any]) -> None:
        """Set up without a page; `about` is what a page displays that never changes, as JSON."""
        self._about = about
        self._status: dict[str, Any] = {}
        self._pages: dict[int, _Page] = {}
        self._pressed: list[str] = []
        self._last: float | None = None  # when a page that is gone now was heard last [s]
        self._using = threading.Lock()
        self.dark: bool | None = None  # whether the page that came or changed its theme last has a dark one
        self.clock = time.monotonic  # returns the time [s]

    @contextlib.contextmanager
    def serving(self, *, any_host: bool) -> Iterator[None]:
        """Let a viser server that starts within this context offer our part, and refuse what `refusal` refuses.

        viser 1.1 starts its server in its constructor and has no option to check requests. A proxy would not help, as
        viser would still listen on a port of its own. While the context lasts, the one module of viser that serves
        therefore finds a `serve` that checks first; the library `websockets` stays as it is.
        """
        from viser.infra import _infra

        infra: Any = _infra
        started = False

        def serve(handler: Handler, *arguments: Any, process_request: Callable, **named: Any) -> server.serve:  # noqa: ANN401
            nonlocal started
            started = True

            def checked(connection: server.ServerConnection, request: Request) -> Response | None:
                reason = refusal(request.headers, any_host=any_host)
                if reason is not None:
                    return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
                return self.answer(request, lambda own: process_request(connection, own))

            named["max_size"] = LARGEST_MESSAGE
            return server.serve(self.handler(handler), *arguments, process_request=checked, **named)

        checking = types.SimpleNamespace(
            server=types.SimpleNamespace(serve=serve, ServerConnection=server.ServerConnection)
        )
        with _starting:
            infra.websockets = types.SimpleNamespace(**{**vars(websockets), "asyncio": checking})
            try:
                yield
            finally:
                infra.websockets = websockets
        if not started:
            raise ConfigError("this viser starts its server in another way; install the version of constraints.txt")

    def say(self, **status: Any) -> None:  # noqa: ANN401  JSON
        """Replace what the pages display, as JSON."""
        self._status = status

    def take_actions(self) -> list[str]:
        """Return the actions requested since the last call."""
        with self._using:
            pressed, self._pressed = self._pressed, []
        return pressed

    def commands(self) -> dict[str, float]:
        """Return the values that held keys and sticks of all pages ask for; empty if nothing is touched.

        A page that has fallen silent asks for nothing: what it held last may have been let go.
        """
        now = self.clock()
        with self._using:
            touched = [page.touched.commands() for page in self._pages.values() if now - page.heard <= SILENT_TIME]
        return {name: value for values in touched for name, value in values.items()}

    @property
    def closed(self) -> bool:
        """Whether there were pages and none is left."""
        with self._using:
            return self._last is not None and not self._pages

    def silence(self) -> float:
        """Return the time since any page was heard [s]; infinity if none ever was."""
        with self._using:
            heard = [page.heard for page in self._pages.values()]
            heard += [self._last] if self._last is not None else []
        return self.clock() - max(heard, default=-math.inf)

    def answer(self, request: Request, viser: Callable[[Request], Response | None]) -> Response | None:
        """Return the answer to a request: our own files, viser's page with our part in it, or viser's answer."""
        path = request.path.partition("?")[0]
        if request.headers.get("Upgrade") == "websocket":
            return None if path == SOCKET else viser(request)
        if path in _FILES:
            return _response(self._file(path), _FILES[path])
        if path not in ("/", "/index.html"):
            return viser(request)
        # Without the header that allows compression, viser's page comes as text.
        plain = Headers((name, value) for name, value in request.headers.raw_items() if name != "Accept-Encoding")
        found = viser(dataclasses.replace(request, headers=plain))
        if found is None or found.status_code != http.HTTPStatus.OK or found.body is None:
            return found
        # At the very beginning, so that our listeners for keys come before viser's.
        page = bytes(found.body).decode("utf-8").replace("<head>", f"<head>{_TAGS}", 1)
        return _response(page.replace("<title>Viser</title>", "<title>hugwbc</title>", 1), "text/html; charset=utf-8")

    def _file(self, path: str) -> str:
        text = (_FOLDER / path.removeprefix("/")).read_text(encoding="utf-8")
        facts = {"@KEYS@": KEY_CODES, "@HELP@": HELP, "@ABOUT@": self._about}
        for mark, content in facts.items():
            text = text.replace(mark, json.dumps(content).replace("<", "\\u003c"))
        return text

    def handler(self, viser: Handler) -> Handler:
        """Return what talks to web sockets: ours at `SOCKET`, the others by viser's handler."""

        async def talk(connection: server.ServerConnection) -> None:
            request = connection.request
            if request is None or request.path.partition("?")[0] != SOCKET:
                await viser(cast(server.ServerConnection, _Filtered(connection)))
                return
            number = id(connection)
            try:
                async for message in connection:
                    self._hear(number, message)
                    await connection.send(json.dumps(self._status))
            except websockets.exceptions.ConnectionClosed:
                pass
            finally:
                with self._using:
                    page = self._pages.pop(number, None)
                    if page is not None:
                        self._last = max(page.heard, self._last or 0.0)

        return talk

    def _hear(self, number: int, message: str | bytes) -> None:
        """Take a page's message; a malformed one only shows that the page is alive."""
        said: Any = None
        if len(message) <= LONGEST_MESSAGE:
            with contextlib.suppress(ValueError, RecursionError):
                said = json.loads(message)
        if not isinstance(said, dict):
            said = {}
        dark = said.get("dark")
        with self._using:
            before = self._pages.get(number)
            if isinstance(dark, bool) and (before is None or dark is not before.dark):
                self.dark = dark
            self._pages[number] = _Page(self.clock(), Touched.parse(said), dark if isinstance(dark, bool) else None)
            self._pressed += actions(said.get("presses"), self._about.get("tasks", ()))
            del self._pressed[:-MOST_ACTIONS]  # the newest may be a stop


def _response(text: str, kind: str) -> Response:
    body = text.encode("utf-8")
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store"})
    return Response(http.HTTPStatus.OK, "OK", headers, body)


HOST = "127.0.0.1"
OWN_HOSTS = (HOST, "localhost", "::1")
OWN_NAMES = (HOST, "localhost", "[::1]")  # the same in a request
LARGEST_MESSAGE = 65536  # [bytes] of a page
# What viser's page may say: where it looks from, which hand it drags, and the value of a slider, a box or a button.
_DRAGS = ("TransformControlsUpdateMessage", "TransformControlsDragStartMessage", "TransformControlsDragEndMessage")
_UPDATE = "GuiUpdateMessage"


def check_host(host: str, *, expose: bool) -> None:
    """Refuse a host to listen on that is not this machine by its own name, unless it is meant to be exposed."""
    if not expose and host not in OWN_HOSTS:
        raise ConfigError(
            f"host is {host}; give {', '.join(OWN_HOSTS)}, or --expose if other machines are to drive the robot"
        )


def refusal(headers: Headers, *, any_host: bool) -> str | None:
    """Return why a request must not be answered; None if it may be.

    Only with `any_host` may it call this machine by another name than its own.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or len(origins) > 1:
        return "expected exactly one Host and at most one Origin header"
    if not any_host and re.sub(r":\d+$", "", hosts[0]).lower() not in OWN_NAMES:
        return f"this page is at {OWN_NAMES[0]}, not at {hosts[0]}"
    if origins and origins[0] not in (f"http://{hosts[0]}", f"https://{hosts[0]}"):
        return f"pages of {origins[0]} may not drive this robot"
    return None


def admitted(message: str | bytes) -> bool:
    """Return whether a message of viser's page may reach viser.

    viser would also let a page remove parts of the panel, upload files into memory, and open a tunnel to the internet.
    """
    try:
        said: Any = msgspec.msgpack.decode(message) if isinstance(message, bytes) else None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return False
    if not isinstance(said, dict) or said.get("type") != _UPDATE:
        return isinstance(said, dict) and said.get("type") in ("ViewerCameraMessage", *_DRAGS)
    updates = said.get("updates")
    value = updates.get("value") if isinstance(updates, dict) and len(updates) == 1 else None
    return isinstance(value, int | float) and math.isfinite(value)


def page_address(host: str, port: int) -> str:
    """Return the address of a page for a browser, which requires brackets around an IPv6 address."""
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
