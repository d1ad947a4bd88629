"""Commands and hand targets from another program: the documented client, what is malformed, a client that is gone."""

import json
import pathlib
import re
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ConfigError
from hugwbc.scripts.socket_source import HOST, LONGEST_MESSAGE, SILENCE, SocketSource

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "how-to" / "teleoperate.md"


class Line:
    """A source with a clock of its own, and a client of it."""

    def __init__(self):
        """Open both ends."""
        self.now = 0.0
        self.source = SocketSource(clock=lambda: self.now)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, message):
        """Send a message, bytes or what is to be JSON, and return the command that follows."""
        data = message if isinstance(message, bytes) else json.dumps(message).encode()
        self._socket.sendto(data, (HOST, self.source.port))
        return self.source.command_at(0.0)

    def close(self):
        """Close both ends."""
        self.source.close()
        self._socket.close()


@pytest.fixture
def line():
    line = Line()
    yield line
    line.close()


def test_commands_and_hands_arrive(line):
    assert line.source.command_at(0.0) == Command() and line.source.hands_at(0.0) is None
    command = line.send({"command": {"v_x": 0.4, "h": -0.1}, "hands": {"left": [0.3, 0.2, 0.2], "frame": "world"}})
    assert (command.v_x, command.h, command.gait) == (0.4, -0.1, Gait.WALKING)
    hands = line.source.hands_at(0.0)
    np.testing.assert_array_equal(hands.left, [0.3, 0.2, 0.2])
    assert hands.right is None and hands.frame == "world"
    assert line.send({}) == Command() and line.source.hands_at(0.0) is None


@pytest.mark.parametrize(
    "message",
    [
        *(b"", b"\xff", b"[]", b"1", b"{", b"[" * 4000, b" " * (LONGEST_MESSAGE + 1), b'{"sequence": ' + b"9" * 4001),
        *(
            b'{"command": {"v_x": NaN}}',
            b'{"command": {"v_x": 1e999}}',
            {"command": {"v_x": 50}},
            {"command": {"v": 1}},
        ),
        *({"command": [1]}, {"command": {"v_x": "1"}}, {"command": {"v_x": True}}, {"gait": "flying"}, {"gait": 1}),
        *({"hands": 1}, {"hands": {}}, {"hands": {"left": [1, 2]}}, {"hands": {"left": [0, 0, None]}}, {"speed": 1}),
        *({"hands": {"left": [1, 2, 3], "frame": ["world"]}}, {"hands": {"left": [1, 2, 3], "together": 1}}),
        *({"sequence": -1}, {"sequence": 1.5}, {"sequence": True}),
    ],
)
def test_a_malformed_message_is_counted_and_changes_nothing(line, message):
    before = line.send({"command": {"v_x": 0.4}, "hands": {"left": [0.3, 0.2, 0.2]}})
    hands = line.source.hands_at(0.0)
    assert line.send(message) is before and line.source.hands_at(0.0) is hands
    assert line.source.counts.malformed == 1 and line.source.problem


def test_a_message_that_is_overtaken_is_ignored(line):
    line.send({"sequence": 7, "command": {"v_x": 0.4}})
    assert line.send({"sequence": 6, "command": {"v_x": 0.1}}).v_x == 0.4
    assert line.source.counts.late == 1


def test_a_client_that_disappears_stops_the_robot_and_may_come_back(line):
    line.send({"sequence": 100, "command": {"v_x": 0.4}, "hands": {"left": [0.3, 0.2, 0.2]}})
    line.now = SILENCE - 0.01
    assert line.source.command_at(0.0).v_x == 0.4
    line.now = SILENCE + 0.01
    assert line.source.command_at(0.0) == Command() and line.source.hands_at(0.0) is None
    line.source.command_at(0.0)
    assert SILENCE < 0.5 and line.source.counts.silences == 1
    assert line.send({"sequence": 0, "command": {"v_x": 0.2}}).v_x == 0.2


def test_a_port_in_use_or_out_of_range_is_refused(line):
    with pytest.raises(ConfigError, match="another port"):
        SocketSource(line.source.port)
    with pytest.raises(ConfigError, match="65535"):
        SocketSource(70000)


def test_the_client_of_the_guide_drives(tmp_path):
    client = tmp_path / "client.py"
    client.write_text(re.search(r'```python title="client.py"\n(.*?)```', PAGE.read_text(), re.S)[1])
    source = SocketSource()
    with subprocess.Popen([sys.executable, str(client), str(source.port), "0.2"]) as process:
        give_up = time.monotonic() + 30.0
        while source.counts.good == 0 and time.monotonic() < give_up:
            command = source.command_at(0.0)
            time.sleep(0.005)
        assert process.wait(30.0) == 0
    assert command.v_x == 0.3 and source.hands_at(0.0).given.all() and source.counts.malformed == 0
    source.close()
