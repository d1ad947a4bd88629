"""The remote control's buttons and sticks."""

import io
import struct
import threading
import types

import numpy as np
import pytest

from hugwbc import Gait, load_robot
from hugwbc.commands import Command, command_ranges, default_command
from hugwbc.deploy.remote import BUTTONS, ButtonPresses, Remote, Request, Sticks, _read, listen


@pytest.mark.parametrize(("bit", "name"), list(enumerate(BUTTONS)))
def test_each_button_has_its_bit(bit: int, name: str) -> None:
    data = bytearray(40)
    struct.pack_into("<H", data, 2, 1 << bit)
    assert Remote.parse(bytes(data)).pressed == {name}
    assert Remote(frozenset({name})).pack() == bytes(data)


def test_the_layout_is_the_makers() -> None:
    data = bytearray(40)
    data[2], data[3] = 0b0000_0100, 0b0000_0001  # Start, A
    for at, value in ((4, 0.25), (8, -0.5), (12, 0.75), (20, -1.0)):
        struct.pack_into("<f", data, at, value)
    remote = Remote.parse(bytes(data))
    assert remote.pressed == {"Start", "A"}
    assert (remote.lx, remote.rx, remote.ry, remote.ly) == (0.25, -0.5, 0.75, -1.0)


@pytest.mark.parametrize(("value", "read"), [(float("nan"), 0.0), (float("inf"), 0.0), (-7.0, -1.0), (0.04, 0.0)])
def test_sticks_that_are_off_are_put_right(value: float, read: float) -> None:
    data = bytearray(40)
    struct.pack_into("<f", data, 20, value)
    assert Remote.parse(bytes(data)).ly == read


def test_a_press_asks_once_and_a_button_held_from_the_beginning_never() -> None:
    watch = ButtonPresses()
    assert watch.update(frozenset({"A"})) == []
    assert watch.update(frozenset({"A", "Start"})) == [Request.START]
    assert watch.update(frozenset({"A", "Start"})) == []
    assert watch.update(frozenset()) == []
    assert watch.update(frozenset({"A", "Select"})) == [Request.STOP, Request.RUN]


def hold(sticks: Sticks, remote: Remote, seconds: float, start: float = 0.0):
    for time in np.arange(start, start + seconds, 0.02):
        sticks.steer(remote, float(time))
    return sticks.command_at(0.0)


def test_without_sticks_the_robot_stands() -> None:
    sticks = Sticks(load_robot())
    assert sticks.command_at(0.0).gait is Gait.STANDING
    assert hold(sticks, Remote(), 2.0).gait is Gait.STANDING


def test_a_stand_has_the_defaults_of_the_robot() -> None:
    g1 = load_robot("g1")
    assert Sticks(g1).command_at(0.0) == default_command(Gait.STANDING, g1) != Command()


@pytest.mark.parametrize(
    ("remote", "name", "value"),
    [
        (Remote(ly=1.0), "v_x", 1.0),
        (Remote(ly=-1.0), "v_x", -0.6),
        (Remote(lx=1.0), "v_y", -0.6),
        (Remote(lx=-0.5), "v_y", 0.3),
        (Remote(rx=1.0), "omega", -1.0),
        (Remote(rx=-1.0), "omega", 1.0),
    ],
)
def test_each_stick_has_its_command(remote, name, value) -> None:
    command = hold(Sticks(load_robot()), remote, 5.0)
    assert command.gait is Gait.WALKING and getattr(command, name) == pytest.approx(value)
    assert command == command.validate()


def test_commands_have_no_jumps_and_end_in_a_stand() -> None:
    sticks, before = Sticks(load_robot()), 0.0
    for step in range(400):
        time = 0.02 * step
        sticks.steer(Remote(ly=1.0) if time < 3.0 else Remote(), time)
        v_x = sticks.command_at(time).v_x
        assert abs(v_x - before) <= 0.5 * 0.02 + 1e-9
        before = v_x
    assert sticks.command_at(0.0).gait is Gait.STANDING


def test_a_gap_in_time_is_no_jump_beyond_the_stick() -> None:
    sticks = Sticks(load_robot())
    sticks.steer(Remote(ly=1.0), 0.0)
    sticks.steer(Remote(ly=1.0), 100.0)
    assert sticks.command_at(0.0).v_x == pytest.approx(0.5 * command_ranges(Gait.WALKING)["v_x"].finishing[1])


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_each_line_of_a_terminal_is_passed_on(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("s\n r \n\nq\n"))
    lines: list[str] = []
    done = threading.Event()

    def act(line: str) -> None:
        lines.append(line)
        if line == "q":
            done.set()

    listen(act)
    assert done.wait(10.0) and lines[:4] == ["s", "r", "", "q"]


def test_ctrl_d_stops_and_the_next_keys_are_heard(monkeypatch) -> None:
    typed, lines = iter(["s\n", "", "q\n", "", ""]), []
    monkeypatch.setattr("sys.stdin", types.SimpleNamespace(isatty=lambda: True, readline=lambda: next(typed)))
    _read(lines.append)
    assert lines == ["s", "", "q", ""], "an empty line is a stop"


@pytest.mark.parametrize("stdin", [None, io.StringIO("s\n")])
def test_without_a_terminal_nothing_is_read(monkeypatch, stdin) -> None:
    monkeypatch.setattr("sys.stdin", stdin)
    before = threading.active_count()
    listen(lambda line: pytest.fail("read"))
    assert threading.active_count() == before
