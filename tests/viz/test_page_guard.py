"""Who the live page answers: this machine by its own name, and its own page."""

import http.client
import time

import msgspec
import pytest
import viser
import websockets.exceptions
from websockets.datastructures import Headers
from websockets.sync import client

from hugwbc.errors import ConfigError
from hugwbc.sim import Simulation
from hugwbc.viz.drive_link import DriveLink, admitted, check_host, refusal
from hugwbc.viz.live import LivePage


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "example.org", "::", "127.0.0.2"])
def test_hosts_but_this_machine_by_its_own_names_are_refused_unless_a_flag_says_so(host):
    with pytest.raises(ConfigError, match="--expose if other machines are to drive the robot"):
        check_host(host, expose=False)
    check_host(host, expose=True)
    for own in ("127.0.0.1", "localhost", "::1"):
        check_host(own, expose=False)


@pytest.mark.parametrize(
    ("host", "origin", "answered"),
    [
        ("127.0.0.1:8080", None, True),
        ("localhost:8080", "http://localhost:8080", True),
        ("[::1]:8080", "http://[::1]:8080", True),
        ("evil.example:8080", "http://evil.example:8080", False),  # a name of theirs that points to this machine
        ("127.0.0.1:8080", "http://evil.example", False),
        ("127.0.0.1:8080", "http://127.0.0.1:3000", False),  # another program's page on this machine
        ("127.0.0.1:8080", "null", False),
        ("LOCALHOST:8080", "http://LOCALHOST:8080", True),  # names of hosts have no case
        ("evil.com@127.0.0.1:8080", None, False),
        ("127.0.0.1/evil.com:8080", "http://127.0.0.1/evil.com:8080", False),
        ("localhost#.evil.com", "http://localhost#.evil.com", False),
        ("", None, False),
    ],
)
def test_only_this_machine_by_its_own_name_and_its_own_page_are_answered(host, origin, answered):
    headers = Headers(Host=host)
    if origin is not None:
        headers["Origin"] = origin
    assert (refusal(headers, any_host=False) is None) is answered


@pytest.mark.parametrize(
    ("headers", "answered"),
    [
        ([("Host", "lab.example")], True),
        ([("Host", "lab.example"), ("Origin", "http://lab.example")], True),
        ([("Host", "lab.example"), ("Origin", "http://evil.example")], False),
        ([("Host", "localhost"), ("Host", "evil.example")], False),
        ([], False),
    ],
)
def test_exposed_it_answers_to_any_one_name_but_still_to_its_own_page_only(headers, answered):
    assert (refusal(Headers(headers), any_host=True) is None) is answered


def test_a_server_that_the_guard_does_not_see_is_refused():
    with pytest.raises(ConfigError, match="another way"), DriveLink({}).serving(any_host=False):
        pass


def packed(**message):
    return msgspec.msgpack.encode(message)


def update(**updates):
    return packed(type="GuiUpdateMessage", uuid="a", updates=updates)


@pytest.mark.parametrize("message", [update(value=1.0), update(value=True), packed(type="ViewerCameraMessage", fov=1)])
def test_what_the_page_of_viser_does_is_let_through(message):
    assert admitted(message)


@pytest.mark.parametrize(
    "message",
    [
        update(removed=True),
        update(value=1.0, removed=True),
        update(value=float("nan")),
        update(value="0.4"),
        packed(type="ShareUrlRequest"),
        packed(type="FileTransferStartUpload", part_count=4),
        packed(type="FileTransferPart", content=b"x"),
        packed(type=["GuiUpdateMessage"]),
        packed(updates=None, type="GuiUpdateMessage"),
        msgspec.msgpack.encode([1, 2]),
        b"\xc1",
        b"\x91" * 5000,
        b"",
        "text",
    ],
)
def test_what_a_page_need_not_do_does_not_reach_viser(message):
    assert not admitted(message)


def test_viser_hears_only_what_is_admitted(served, port):
    slider = served._sliders["v_x"]
    with client.connect(f"ws://127.0.0.1:{port}", subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as page:
        for words in ({"removed": True}, {"value": 0.3, "removed": True}, {"value": 0.2}):
            page.send(packed(type="GuiUpdateMessage", uuid=slider._impl.uuid, updates=words))
        deadline = time.monotonic() + 10.0
        while slider.value != 0.2 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert slider.value == 0.2 and not slider._impl.removed
        page.send(b"x" * 100_000)  # larger than any message of a page
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            while True:
                page.recv(timeout=10.0)
    assert ask(port, Host=f"127.0.0.1:{port}")[0] == 200, "the others go on"


@pytest.fixture(scope="module")
def served():
    page = LivePage(Simulation(sensing="exact"), name="test")
    yield page
    page.close()


@pytest.fixture(scope="module")
def port(served):
    return served.server.get_port()


SOCKET = {
    "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol": "viser-v0",
}  # fmt: skip


def ask(port, path="/", **headers):
    """Return the status and the text of what a server on this machine answers."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.putrequest("GET", path, skip_host=True, skip_accept_encoding=True)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, "" if answer.status == 101 else answer.read().decode()
    finally:
        connection.close()


def test_the_page_of_viser_has_our_part_in_it_and_our_files_are_served(port):
    own = f"127.0.0.1:{port}"
    status, index = ask(port, Host=own, Accept_Encoding="gzip")
    assert status == 200 and '<head><link rel="stylesheet" href="/drive.css"><script src="/drive.js"></script>' in index
    assert '<meta name="viewport" content="width=device-width' in index, "phones"
    status, script = ask(port, "/drive.js", Host=own)
    assert status == 200 and '"KeyW"' in script and '"hopping_left"' in script and "@" not in script
    assert ask(port, "/drive.css", Host=own)[0] == 200 and ask(port, "/nothing.js", Host=own)[0] == 404
    assert ask(port, "/drive.js", Host="evil.example")[0] == 403


def test_the_running_server_refuses_other_names_and_other_pages(port):
    own = f"127.0.0.1:{port}"
    assert ask(port, Host=own)[0] == 200
    assert ask(port, Host=f"evil.example:{port}")[0] == 403
    assert ask(port, Host=own, Origin=f"http://{own}", **SOCKET)[0] == 101
    assert ask(port, Host=own, Origin="http://evil.example", **SOCKET)[0] == 403
    assert ask(port, Host=f"evil.example:{port}", Origin=f"http://evil.example:{port}", **SOCKET)[0] == 403
    ours = {name: value for name, value in SOCKET.items() if name != "Sec-WebSocket-Protocol"}
    assert ask(port, path="/drive", Host=own, Origin=f"http://{own}", **ours)[0] == 101
    assert ask(port, path="/drive", Host=own, Origin="http://evil.example", **ours)[0] == 403
