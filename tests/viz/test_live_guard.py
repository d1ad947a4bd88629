"""The live page's server refuses what a page of another site would send it."""

import http.client

import pytest

pytest.importorskip("viser")

from websockets.datastructures import Headers

from hugwbc.errors import ConfigError
from hugwbc.sim import Simulation
from hugwbc.viz.live import LivePage
from hugwbc.viz.live_guard import guarded, refusal


@pytest.mark.parametrize(
    ("host", "origin", "answered"),
    [
        ("127.0.0.1:8080", None, True),
        ("localhost:8080", "http://localhost:8080", True),
        ("[::1]:8080", "http://[::1]:8080", True),
        ("evil.example:8080", "http://evil.example:8080", False),  # a name of theirs that points to this machine
        ("127.0.0.1.evil.example", None, False),
        ("127.0.0.1:8080", "http://evil.example", False),
        ("127.0.0.1:8080", "http://127.0.0.1:3000", False),  # another program's page on this machine
        ("127.0.0.1:8080", "null", False),
        ("[", None, False),
        ("", None, False),
    ],
)
def test_only_this_machine_by_its_own_name_and_its_own_page_are_answered(host, origin, answered):
    headers = Headers(Host=host)
    if origin is not None:
        headers["Origin"] = origin
    assert (refusal(headers, any_host=False) is None) is answered


def test_exposed_it_answers_to_any_name_but_still_to_its_own_page_only():
    assert refusal(Headers(Host="lab.example"), any_host=True) is None
    assert refusal(Headers(Host="lab.example", Origin="http://lab.example"), any_host=True) is None
    assert refusal(Headers(Host="lab.example", Origin="http://evil.example"), any_host=True) is not None


def test_several_hosts_or_none_are_refused():
    twice = Headers([("Host", "localhost"), ("Host", "evil.example")])
    assert refusal(twice, any_host=True) is not None
    assert refusal(Headers(), any_host=True) is not None


def test_a_server_that_the_guard_does_not_see_is_refused():
    with pytest.raises(ConfigError, match="another way"), guarded(any_host=False):
        pass


@pytest.fixture(scope="module")
def port():
    page = LivePage(Simulation(), name="test")
    yield page.server.get_port()
    page.close()


SOCKET = {
    "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol": "viser-v0",
}  # fmt: skip


def status(port, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.putrequest("GET", "/", skip_host=True)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        return connection.getresponse().status
    finally:
        connection.close()


def test_the_running_server_refuses_other_names_and_other_pages(port):
    own = f"127.0.0.1:{port}"
    assert status(port, Host=own) == 200
    assert status(port, Host=f"evil.example:{port}") == 403
    assert status(port, Host=own, Origin=f"http://{own}", **SOCKET) == 101
    assert status(port, Host=own, Origin="http://evil.example", **SOCKET) == 403
    assert status(port, Host=f"evil.example:{port}", Origin=f"http://evil.example:{port}", **SOCKET) == 403
