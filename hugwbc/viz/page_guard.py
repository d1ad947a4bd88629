"""Who may use the live page: browsers that ask this machine for it by its own name, and only its own page.

A server on 127.0.0.1 is still within reach of every page that the user's browser has open: a page of another site may
open a web socket to it (the browser says so in `Origin`, and leaves it to the server to check), or may have its own
name point to 127.0.0.1 and so count as the same site (then `Host` has that name).
"""

import contextlib
import http
import ipaddress
import threading
import types
import urllib.parse
from collections.abc import Awaitable, Callable, Iterator
from typing import Any, Protocol

import websockets
import websockets.asyncio.server as server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from hugwbc.errors import ConfigError

HOST = "127.0.0.1"
OWN_NAMES = ("127.0.0.1", "localhost", "::1")
Handler = Callable[[server.ServerConnection], Awaitable[None]]
_starting = threading.Lock()


class Addition(Protocol):
    """Content served on the same port besides viser's page."""

    def answer(self, request: Request, viser: Callable[[Request], Response | None]) -> Response | None:
        """Return the answer to a request; None to open a web socket. `viser` answers as viser would."""
        ...

    def handler(self, viser: Handler) -> Handler:
        """Return what talks to web sockets: some itself, the others by viser's handler."""
        ...


def check_host(host: str, *, expose: bool) -> str:
    """Return the host to listen on, unchanged.

    Args:
        host: name or address of the host.
        expose: whether other machines may reach it.
    """
    try:
        loopback = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = False
    if not loopback and not expose:
        raise ConfigError(
            f"host is {host}: other machines could drive the robot; give {HOST}, or --expose if that is meant"
        )
    return host


def refusal(headers: Headers, *, any_host: bool) -> str | None:
    """Return why a request must not be answered; None if it may be.

    Args:
        headers: headers of the request.
        any_host: whether the request may call this machine by any name.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or len(origins) > 1:
        return "expected exactly one Host and at most one Origin header"
    if not any_host and _hostname(f"//{hosts[0]}") not in OWN_NAMES:
        return f"this page is at {OWN_NAMES[0]}, not at {hosts[0]}"
    if origins and origins[0] not in (f"http://{hosts[0]}", f"https://{hosts[0]}"):
        return f"pages of {origins[0]} may not drive this robot"
    return None


def _hostname(url: str) -> str | None:
    try:
        return urllib.parse.urlsplit(url).hostname
    except ValueError:
        return None


@contextlib.contextmanager
def guarded(addition: Addition, *, any_host: bool) -> Iterator[None]:
    """Make a viser server that starts within this context refuse what `refusal` refuses.

    viser 1.1 starts its server in its constructor and has no option to check requests. A proxy would not help: viser
    would still listen on a port of its own. While the context lasts, the one module of viser that serves therefore
    finds a `serve` that checks first; the library `websockets` stays as it is.

    Args:
        addition: what the server offers besides viser's page, behind the same checks.
        any_host: whether requests may call this machine by any name.
    """
    from viser.infra import _infra

    infra: Any = _infra
    started = False

    def serve(handler: Handler, *arguments: Any, process_request: Callable, **options: Any) -> server.serve:  # noqa: ANN401
        nonlocal started
        started = True

        def checked(connection: server.ServerConnection, request: Request) -> Response | None:
            reason = refusal(request.headers, any_host=any_host)
            if reason is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
            return addition.answer(request, lambda asked: process_request(connection, asked))

        return server.serve(addition.handler(handler), *arguments, process_request=checked, **options)

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
        raise ConfigError("this version of viser starts its server in another way; install the one of constraints.txt")


def page_address(host: str, port: int) -> str:
    """Return the address of a page for a browser, which requires brackets around an IPv6 address."""
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
