"""Connections within one process."""

import threading
import time

from hugwbc.deploy.transport import HISTORY, UNREACHABLE, local_pair


def test_messages_arrive_in_order_and_the_oldest_are_forgotten() -> None:
    robot, client = local_pair()
    for index in range(HISTORY + 8):
        robot.send(bytes([index]))
    assert client.receive(0.0) == [bytes([index]) for index in range(8, HISTORY + 8)]
    assert client.receive(0.0) == []
    client.send(b"command")
    assert robot.receive(0.0) == [b"command"]


def test_a_reader_waits_no_longer_than_it_said() -> None:
    _, client = local_pair()
    begin = time.perf_counter()
    assert client.receive(0.05) == []
    assert 0.04 < time.perf_counter() - begin < 2.0


def test_a_message_ends_the_wait() -> None:
    robot, client = local_pair()
    threading.Timer(0.05, robot.send, (b"state",)).start()
    begin = time.perf_counter()
    assert client.receive(20.0) == [b"state"]
    assert time.perf_counter() - begin < 10.0


def test_calls_reach_the_service() -> None:
    robot, client = local_pair()
    assert client.call(1001, "{}", 0.0)[0] == UNREACHABLE
    robot.serve(lambda number, parameter: (0, f"{number} {parameter}"))
    assert client.call(1001, "{}", 0.0) == (0, "1001 {}")
