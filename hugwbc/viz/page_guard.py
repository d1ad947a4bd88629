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

import websockets.asyncio.server as server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from hugwbc.errors import ConfigError

HOST = "127.0.0.1"
OWN_NAMES = ("127.0.0.1", "localhost", "::1")
ProcessRequest = Callable[[server.ServerConnection, Request], Response | None]
Handler = Callable[[server.ServerConnection], Awaitable[None]]
_starting = threading.Lock()


class Addition(Protocol):
    """What is served on the same port besides viser's page."""

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
def guarded(*, any_host: bool, addition: Addition | None = None) -> Iterator[None]:
    """Make a viser server that starts within this context refuse what `refusal` refuses.

    viser starts its server in its constructor and has no option to check requests. For the time of the context viser
    alone, and no other user of websockets, finds a `serve` that checks them. If viser did not use it, its requests
    would go unchecked, and a ConfigError says so.

    Args:
        any_host: whether requests may call this machine by any name.
        addition: what the server offers besides viser's page, behind the same checks; None for nothing.
    """
    from viser.infra import _infra

    infra: Any = _infra
    started = []

    def serve(
        handler: Handler,
        *arguments: Any,  # noqa: ANN401  as websockets'
        process_request: ProcessRequest | None = None,
        **options: Any,  # noqa: ANN401  as websockets'
    ) -> server.serve:
        def checked(connection: server.ServerConnection, request: Request) -> Response | None:
            reason = refusal(request.headers, any_host=any_host)
            if reason is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")

            def viser(asked: Request) -> Response | None:
                return None if process_request is None else process_request(connection, asked)

            return viser(request) if addition is None else addition.answer(request, viser)

        started.append(True)
        both = handler if addition is None else addition.handler(handler)
        return server.serve(both, *arguments, process_request=checked, **options)

    with _starting:
        websockets = infra.websockets
        checking = _with(websockets, asyncio=_with(websockets.asyncio, server=_with(server, serve=serve)))
        infra.websockets = checking
        try:
            yield
        finally:
            infra.websockets = websockets
    if not started:
        raise ConfigError("this version of viser starts its server in another way; install the one of constraints.txt")


def _with(module: types.ModuleType, **names: Any) -> Any:  # noqa: ANN401  what is used like a module
    """Return what has the names of a module, with some in place of its own; the module stays as it is."""
    return types.SimpleNamespace(**{**vars(module), **names})


def page_address(host: str, port: int) -> str:
    """Return the address of a page for a browser, which requires brackets around an IPv6 address."""
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
