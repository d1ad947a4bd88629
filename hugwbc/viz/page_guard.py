"""Who may use the live page: browsers that ask this machine for it by its own name, and only its own page.

A server on 127.0.0.1 is still within reach of every page that the user's browser has open: a page of another site may
open a web socket to it (the browser says so in `Origin`, and leaves it to the server to check), or may have its own
name point to 127.0.0.1 and so count as the same site (then `Host` has that name).
"""

import ipaddress
import math
import re
from typing import Any

import msgspec
from websockets.datastructures import Headers

from hugwbc.errors import ConfigError

HOST = "127.0.0.1"
OWN_NAMES = ("127.0.0.1", "localhost", "[::1]")
LARGEST_MESSAGE = 65536  # [bytes] of a page
# What viser's page may say: where it looks from, which hand it drags, and the value of a slider, a box or a button.
_DRAGS = ("TransformControlsUpdateMessage", "TransformControlsDragStartMessage", "TransformControlsDragEndMessage")
_UPDATE = "GuiUpdateMessage"


def check_host(host: str, *, expose: bool) -> str:
    """Return the host to listen on, unchanged; only an exposed one may be within reach of other machines."""
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
