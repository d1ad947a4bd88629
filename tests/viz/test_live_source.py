import contextlib
import dataclasses
import json
import socket
import sys
import threading

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.scripts.socket_source import SocketSource
from hugwbc.viz.live_source import RATES, LiveSource

DT = 0.02


def play(source, seconds, start=0.0):
    return [source.command_at(start + tick * DT) for tick in range(1, round(seconds / DT) + 1)]


def test_commands_ramp_and_stay_in_range_whatever_is_asked():
    source = LiveSource(load_robot())
    source.ask_gait(Gait.WALKING)
    source.ask("v_x", 9.0)
    source.ask("h", -9.0)
    commands = play(source, 6.0)
    values = np.array([command.validate().array() for command in commands])
    assert np.all(np.abs(np.diff(values, axis=0)) <= RATES * DT + 1e-12)
    assert commands[-1].v_x == 2.0
    assert commands[-1].h == pytest.approx(-0.3)
    assert commands[49].v_x == pytest.approx(0.5), "after 1 s at 0.5 m/s^2"


def test_a_robot_comes_to_rest_before_another_moving_gait():
    source = LiveSource(load_robot())
    source.ask_gait(Gait.WALKING)
    source.ask("v_x", 0.5)
    play(source, 2.0)
    source.ask_gait(Gait.JUMPING)
    commands = play(source, 2.0, start=2.0)
    first = next(index for index, command in enumerate(commands) if command.gait is Gait.JUMPING)
    assert commands[first - 1].gait is Gait.WALKING and commands[first - 1].v_x <= 0.02
    assert first * DT == pytest.approx(1.0, abs=0.1)


def test_nan_asks_for_the_default_and_a_restart_is_at_rest():
    source = LiveSource(load_robot())
    source.ask("w", float("nan"))
    assert source.requested == Command()
    source.requested = dataclasses.replace(source.requested, h=-0.2)
    play(source, 3.0)
    assert source.command_at(0.0) == Command()


def test_what_is_asked_for_at_one_time_is_all_kept():
    """The page's server calls from several threads."""
    source, asked, rounds = LiveSource(load_robot()), {"h": -0.1, "p": 0.2, "w": 0.5}, 300
    barrier, lost, switch = threading.Barrier(len(asked) + 1, timeout=30.0), 0, sys.getswitchinterval()

    def person(name, value):
        for _ in range(rounds):
            barrier.wait()
            source.ask(name, value)
            barrier.wait()

    threads = [threading.Thread(target=person, args=item, daemon=True) for item in asked.items()]
    for thread in threads:
        thread.start()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(rounds):
            source.requested = Command()
            barrier.wait()
            barrier.wait()
            lost += source.requested != Command(**asked)
    finally:
        sys.setswitchinterval(switch)
    for thread in threads:
        thread.join()
    assert lost == 0


def test_a_velocity_makes_a_standing_robot_walk_and_a_stop_makes_it_stand_again():
    source = LiveSource(load_robot())
    source.ask("h", -0.1)
    assert source.requested.gait is Gait.STANDING and source.notice == ""
    source.ask("omega", 0.3)
    assert source.requested == Command(omega=0.3, h=-0.1, gait=Gait.WALKING) and "starts walking" in source.notice
    source.stop()
    assert source.requested == Command(h=-0.1)
    source.ask_gait(Gait.WALKING)
    source.ask("v_x", 0.3)
    source.stop()
    assert source.requested == Command(h=-0.1), "also where the gait was chosen"


def test_a_velocity_that_is_let_go_ends_only_a_walk_that_it_began():
    source = LiveSource(load_robot())
    source.ask("v_x", 0.3)
    source.let_go()
    assert source.requested == Command(v_x=0.3, gait=Gait.WALKING), "a slider still asks for it"
    source.ask("v_x", 0.0)
    source.let_go()
    assert source.requested == Command()
    source.ask_gait(Gait.WALKING)
    source.let_go()
    assert source.requested == Command(gait=Gait.WALKING), "the gait was chosen"


def test_a_halt_and_a_pause_ask_for_a_stand_at_once():
    """The control loop brakes before it (`hugwbc.runtime.braking`)."""
    source = LiveSource(load_robot())
    source.ask_gait(Gait.WALKING)
    source.ask("v_x", 2.0)
    source.ask("omega", 1.0)
    play(source, 5.0)
    source.pause(on=True)
    assert play(source, DT, start=5.0)[0] == Command()
    source.pause(on=False)
    assert play(source, 0.1, start=5.0 + DT)[-1].v_x == pytest.approx(0.05), "a request is ramped as always"
    source.halt("the page is gone")
    assert play(source, DT, start=5.2)[0] == Command()
    assert source.notice == "the page is gone"


def test_another_programs_commands_count_while_they_come():
    now = [10.0]
    with contextlib.closing(SocketSource(clock=lambda: now[0])) as stream:
        source = LiveSource(load_robot(), stream=stream)
        source.ask("w", 0.5)
        assert play(source, 1.0)[-1].w == pytest.approx(0.5), "nobody sends yet"
        hands = {"left": [0.3, 0.2, 0.1], "right": [0.3, -0.2, 0.1]}
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.sendto(json.dumps({"command": {"v_x": 0.4}, "hands": hands}).encode(), ("127.0.0.1", stream.port))
        (command,) = play(source, DT, start=1.0)
        assert source.following and command == source.requested == Command(v_x=0.4, gait=Gait.WALKING)
        assert source.hands_at(1.0) is not None
        source.ask("v_x", 0.1)
        source.ask_gait(Gait.JUMPING)
        source.halt("the page is gone")
        source.pause(on=True)
        assert play(source, DT, start=1.02) == [command] and source.notice == ""
        source.pause(on=False)
        now[0] += 0.4
        assert play(source, 1.0, start=1.04)[-1].gait is Gait.STANDING
        assert not source.following and source.hands_at(2.0) is None and "silent" in source.notice
        source.ask("w", 0.2)
        assert play(source, 2.0, start=2.04)[-1].w == pytest.approx(0.2), "the person may drive"


def test_a_stop_takes_the_robot_from_another_program_until_that_is_silent():
    now = [10.0]
    with (
        contextlib.closing(SocketSource(clock=lambda: now[0])) as stream,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
    ):
        source = LiveSource(load_robot(), stream=stream)

        def hear():
            client.sendto(b'{"command": {"v_x": 0.4, "h": -0.1}}', ("127.0.0.1", stream.port))

        hear()
        (driven,) = play(source, DT)
        assert driven == Command(v_x=0.4, h=-0.1, gait=Gait.WALKING)
        source.stop()
        assert source.requested == Command(h=-0.1) and "the other program drives again once" in source.notice
        for tick in range(1, 51):  # it goes on sending
            now[0] += DT
            hear()
            assert source.command_at(tick * DT).gait is Gait.STANDING and not source.following
        source.ask("w", 0.2)
        assert source.requested.w == 0.2, "the person may drive"
        now[0] += 0.4
        play(source, DT, start=1.0)
        hear()
        assert play(source, DT, start=1.02) == [driven] and source.following
