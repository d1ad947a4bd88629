"""Commands from the sticks."""

import numpy as np
import pytest

from hugwbc import Gait, load_robot
from hugwbc.commands import command_ranges
from hugwbc.deploy.remote import Remote
from hugwbc.deploy.sticks import Sticks


def hold(sticks: Sticks, remote: Remote, seconds: float, start: float = 0.0):
    for time in np.arange(start, start + seconds, 0.02):
        sticks.steer(remote, float(time))
    return sticks.command_at(0.0)


def test_without_sticks_the_robot_stands() -> None:
    sticks = Sticks(load_robot())
    assert sticks.command_at(0.0).gait is Gait.STANDING
    assert hold(sticks, Remote(), 2.0).gait is Gait.STANDING


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
