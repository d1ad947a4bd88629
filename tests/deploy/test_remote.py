"""The remote control's buttons and sticks."""

import struct

import pytest

from hugwbc.deploy.remote import BUTTONS, ButtonWatch, Remote, Request


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


@pytest.mark.parametrize(("value", "read"), [(float("nan"), 0.0), (float("inf"), 1.0), (-7.0, -1.0), (0.04, 0.0)])
def test_sticks_that_are_off_are_put_right(value: float, read: float) -> None:
    data = bytearray(40)
    struct.pack_into("<f", data, 20, value)
    assert Remote.parse(bytes(data)).ly == read


def test_a_press_asks_once_and_a_button_held_from_the_beginning_never() -> None:
    watch = ButtonWatch()
    assert watch.update(frozenset({"A"})) == []
    assert watch.update(frozenset({"A", "Start"})) == [Request.START]
    assert watch.update(frozenset({"A", "Start"})) == []
    assert watch.update(frozenset()) == []
    assert watch.update(frozenset({"A", "Select"})) == [Request.STOP, Request.RUN]
