"""Schedules of a simulated robot's remote control and hoist."""

import pytest

from hugwbc.deploy.schedule import Happening, Schedule
from hugwbc.errors import ConfigError


def test_buttons_are_held_for_a_while_and_sticks_for_ever() -> None:
    schedule = Schedule.parse("1 Start, 2 ly=0.5,2 lx=-1, 3 lower, 3 release")
    assert schedule.update(0.5) == [] and not schedule.remote.pressed
    schedule.update(1.0)
    assert schedule.remote.pressed == {"Start"}
    schedule.update(1.3)
    assert not schedule.remote.pressed and schedule.remote.ly == 0.0
    schedule.update(2.5)
    assert (schedule.remote.ly, schedule.remote.lx) == (0.5, -1.0)
    assert schedule.update(3.0) == ["lower", "release"] and schedule.update(3.1) == []


def test_something_can_be_added_while_it_runs() -> None:
    schedule = Schedule.parse("5 lift")
    schedule.update(1.0)
    schedule.add(Happening(1.0, "release"))
    assert schedule.update(1.002) == ["release"] and schedule.update(5.0) == ["lift"]


@pytest.mark.parametrize(
    "text",
    ["Start", "x Start", "1 Stat", "1", "1 ly", "1 ly=x", "1 ly=2", "-1 A", "nan A", "inf A", "1 A B", "1 A=0.5"],
)
def test_what_is_not_understood_is_refused(text) -> None:
    with pytest.raises(ConfigError, match="is not valid; give TIME and one of R1"):
        Schedule.parse(text)
