"""Whom the live page's server answers: browsers that asked this machine for it by its own name, and its own page only.

A server on 127.0.0.1 is still within reach of every page that the user's browser has open. A page of another site may
open a web socket to it (browsers say so in `Origin`, and leave it to the server to mind), or have its own name point to
127.0.0.1 and so pass for the same site (then `Host` has that name).
"""

import contextlib
import functools
import http
import threading
import urllib.parse
from collections.abc import Callable, Iterator
from typing import Any

import websockets.asyncio.server as server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from hugwbc.errors import ConfigError

OWN_NAMES = ("127.0.0.1", "localhost", "::1")
ProcessRequest = Callable[[server.ServerConnection, Request], Response | None]
_starting = threading.Lock()


def refusal(headers: Headers, *, any_host: bool) -> str | None:
    """Why a request is not answered; None if it is.

    Args:
        headers: of the request.
        any_host: whether the machine may be called by any name.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or len(origins) > 1:
        return "one Host and at most one Origin, please"
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
def guarded(*, any_host: bool) -> Iterator[None]:
    """Within this context, a web socket server that starts answers only what `refusal` does not refuse.

    viser starts its server in its constructor and offers no way to look at requests first, hence the detour.

    Raises:
        ConfigError: if no server started by way of here, whose requests would then go unchecked.
    """
    original, started = server.serve, []

    @functools.wraps(original)
    def serve(*arguments: Any, process_request: ProcessRequest | None = None, **options: Any) -> server.serve:  # noqa: ANN401  as websockets'
        def checked(connection: server.ServerConnection, request: Request) -> Response | None:
            reason = refusal(request.headers, any_host=any_host)
            if reason is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
            return None if process_request is None else process_request(connection, request)

        started.append(True)
        return original(*arguments, process_request=checked, **options)

    with _starting:
        server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            server.serve = original  # type: ignore[misc]
    if not started:
        raise ConfigError("this version of viser starts its server in another way; install the one of constraints.txt")
