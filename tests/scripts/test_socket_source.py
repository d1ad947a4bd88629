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

from hugwbc import Command, Gait, load_robot
from hugwbc.commands import default_command
from hugwbc.errors import ConfigError
from hugwbc.scripts.socket_source import HOST, LONGEST_MESSAGE, SILENCE, SocketSource

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "how-to" / "teleoperate.md"


class Line:
    """A source with a clock of its own, and a client of it."""

    def __init__(self):
        """Open both ends."""
        self.now = 0.0
        self.told = []
        self.source = SocketSource(clock=lambda: self.now, tell=self.told.append)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, message):
        """Send a message, bytes or what is to be JSON, and return the command that follows."""
        self.queue(message if isinstance(message, bytes) else json.dumps(message).encode())
        return self.source.command_at(0.0)

    def queue(self, data):
        """Send a message that waits for the next tick."""
        self._socket.sendto(data, (HOST, self.source.port))

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
    line.send({"hands": {"left": [0.3, 0.2, 0.2], "left_orientation": "level", "orientation_weight": 0.1}})
    hands = line.source.hands_at(0.0)
    assert hands.left_orientation.tolist() == [0.0] * 4 and hands.orientation_weight == 0.1
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
        *({"hands": {"left": ["0.3", 0.2, 0.1]}}, {"hands": {"left": [True, 0.2, 0.1]}}, {"hands": {"left": "312"}}),
        *(
            {"hands": {"left": [10**400, 0.2, 0.1]}},
            {"hands": {"left": [0.3, 0.2, 0.1], "left_direction": [True, 0, 0]}},
        ),
        *({"sequence": -1}, {"sequence": 1.5}, {"sequence": True}),
    ],
)
def test_a_malformed_message_is_counted_and_changes_nothing(line, message):
    before = line.send({"command": {"v_x": 0.4}, "hands": {"left": [0.3, 0.2, 0.2]}})
    hands = line.source.hands_at(0.0)
    assert line.send(message) is before and line.source.hands_at(0.0) is hands
    assert line.source.tally.counts["refused"] == 1 and line.source.tally.problem


def test_a_message_that_is_overtaken_is_ignored(line):
    line.send({"sequence": 7, "command": {"v_x": 0.4}})
    assert line.send({"sequence": 6, "command": {"v_x": 0.1}}).v_x == 0.4
    assert line.source.tally.counts["late"] == 1


def test_a_client_that_disappears_stops_the_robot_and_may_come_back(line):
    line.send({"sequence": 100, "command": {"v_x": 0.4}, "hands": {"left": [0.3, 0.2, 0.2]}})
    line.now = SILENCE - 0.01
    assert line.source.command_at(0.0).v_x == 0.4
    line.now = SILENCE + 0.01
    assert line.source.command_at(0.0) == Command() and line.source.hands_at(0.0) is None
    line.source.command_at(0.0)
    assert SILENCE < 0.5 and line.source.tally.counts["silent"] == 1
    assert line.send({"sequence": 0, "command": {"v_x": 0.2}}).v_x == 0.2


def test_without_a_client_a_robot_stands_with_its_own_defaults():
    source = SocketSource(robot=load_robot("g1"))
    assert source.command_at(0.0) == default_command(Gait.STANDING, load_robot("g1")) != Command()
    source.close()


def test_the_person_at_the_terminal_learns_what_is_wrong_once_a_second_and_in_the_end(line):
    told = line.told
    for n in range(30):  # 1.5 s
        line.now = 0.05 * n
        line.send({"command": {"vx": 0.4}})
    assert len(told) == 2 and all("vx" in text and "'v_x'" in text for text in told), "with what was meant"
    for n in (0, 1, 4, 3, 5):
        line.send({"sequence": n})
    line.send(b"\x80\x04\x95")  # a pickle
    line.send({"hands": {"left": [300, 200, 100]}})
    line.now += 1.0
    line.send({"hands": {"left": [0.3, 0.2, 0.1, 0, 0, 0, 1]}})
    assert "three finite numbers" in told[-2] and "the robot stands" in told[-1]
    line.send({"sequence": 6})
    for words in ("39 messages", "33 refused", "2 missing", "1 late", "longest gap 1000 ms", "1 silent"):
        assert words in str(line.source.tally)


@pytest.mark.parametrize(
    "message",
    [
        b'{"hands": {"left": [0.3, 0.2, 0.1], "frame": "' + b"x" * 4000 + b'"}}',
        b'{"hands": {"left": ' + b"[" * 900 + b"]" * 900 + b"}}",
        b'{"gait": "' + b"y" * 4000 + b'"}',
        b'{"' + b"z" * 4000 + b'": 1}',
        b'{"command": {"v_x": 0.1}, "hands": {"left": [0.3, 0.2, 0.1]}}',
    ],
)
def test_a_flood_takes_little_time_and_the_newest_message_wins(line, message):
    data, spent = message, []
    for _ in range(3):
        for _ in range(200):
            line.queue(data)
        line.queue(b'{"command": {"v_x": 0.25}}')
        begin = time.thread_time()
        assert line.source.command_at(0.0).v_x == 0.25
        spent.append(time.thread_time() - begin)
    assert min(spent) < 0.01, "half a control period of the policy; a quiet tick among other work"
    assert line.source.tally.counts["overtaken"] > 30


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
        while not source.tally.received and time.monotonic() < give_up:
            command = source.command_at(0.0)
            time.sleep(0.005)
        assert process.wait(30.0) == 0
    assert command.v_x == 0.3 and source.hands_at(0.0).given.all() and not source.tally.counts["refused"]
    source.close()
