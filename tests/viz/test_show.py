"""Runs in front of a viewer: what is drawn and when, what is told, and what is left to look at."""

import itertools
import sys
from unittest import mock

import numpy as np
import pytest

from hugwbc import Command, load_robot
from hugwbc.errors import ConfigError
from hugwbc.runtime import Constant, ControlLoop
from hugwbc.runtime.controllers import HoldController
from hugwbc.sim import Simulation
from hugwbc.viz import show


@pytest.fixture
def now(monkeypatch) -> list[float]:
    """The time of a clock that only sleeping moves [s]."""
    now = [10.0]
    monkeypatch.setattr(show.time, "sleep", lambda length: now.__setitem__(0, now[0] + length))
    monkeypatch.setattr(show.time, "monotonic", lambda: now[0])
    return now


def test_the_clock_keeps_real_time_and_slows_evenly_where_the_computer_is_slow(now):
    def lengths(costs):
        clock, times = show.RealTime(), []
        for picture, cost in enumerate(costs, start=1):
            before = now[0]
            now[0] += cost
            clock.keep(0.04 * picture)
            times.append(now[0] - before)
        return times, clock.speed

    times, speed = lengths([0.01, 0.03] * 100)
    assert times == pytest.approx([0.04] * 200) and speed == pytest.approx(1.0)
    times, speed = lengths([0.03, 0.08] * 100)  # every other picture takes twice as long as it should
    assert np.ptp(times[-50:]) < 0.01 and 0.5 < speed < 0.6
    times, _ = lengths([0.02] * 50 + [600.0] + [0.02] * 50)  # suspended once
    assert times[51:] == pytest.approx([0.04] * 50)


def test_driving_keeps_real_time_after_a_task(now):
    pictures, page = [], mock.MagicMock()
    page.take.return_value = False
    page.take_task.side_effect = itertools.chain([None, "press_button"], itertools.repeat(None))
    page.show.side_effect = lambda *_, speed, **__: pictures.append((now[0], speed))

    def perform(task):
        now[0] += 60.0
        return f"{task} was done"

    loop = ControlLoop(HoldController(load_robot()), Constant(Command()), Simulation(sensing="exact"))
    show.drive(loop, page, 1.0, perform=perform, tell=lambda words: None)
    times, speeds = np.array(pictures).T
    assert times[-1] - times[0] == pytest.approx(60.0 + 1.0, abs=0.05) and speeds == pytest.approx(1.0)


def test_a_run_is_drawn_in_time_recorded_and_left_as_a_page(tmp_path, monkeypatch):
    told, drawn, simulation = [], [], Simulation(sensing="exact")
    page = tmp_path / "out" / "hold.html"
    monkeypatch.setattr(show, "open_view", lambda *_, **__: lambda shown: drawn.append((simulation.data.time, shown)))
    outputs = {"show": True, "replay": page, "tell": told.append}
    trace = show.watch(HoldController(load_robot()), Constant(Command(w=0.3)), simulation, duration=0.4, **outputs)
    times = np.array([time for time, _ in drawn])
    assert times == pytest.approx(np.arange(0.0, 0.4, show.FRAME_PERIOD), abs=1e-6)
    assert np.stack([snapshot.qpos for _, snapshot in drawn]) == pytest.approx(trace.qpos[::2])
    assert told == [f"replay in {page}"]
    assert "set_animation" in page.read_text(encoding="utf-8")
    assert trace.fate == "stayed up for 0.4 s"


def test_a_live_run_opens_a_page_and_tells_its_address(monkeypatch):
    opened, told = [], []
    monkeypatch.setattr(show.webbrowser, "open", opened.append)
    show.watch(HoldController(load_robot()), Constant(Command()), duration=0.1, show=True, tell=told.append)
    (address,) = opened
    assert address.startswith("http://127.0.0.1") and told == [f"watch at {address}; Ctrl-C stops"]


def test_what_the_safety_filter_changed_before_a_fall_is_told_as_well(capsys):
    """A fall clears the filter's counters."""

    class Stumbling(HoldController):
        """Fails once, and falls; then it stands until the end."""

        ticks = 0

        def act(self, state, command, upper_body):
            self.ticks += 1
            if self.ticks == 3:
                raise RuntimeError("stumbled")
            return super().act(state, command, upper_body)

    show.run_live(ControlLoop(Stumbling(load_robot()), Constant(Command()), Simulation(sensing="exact")), 1.7)
    text = capsys.readouterr().out
    assert "standing up again" in text and "hold: 1.7 s simulated, 1 falls" in text
    assert "safety: hold raised RuntimeError: stumbled" in text


def test_a_script_reads_its_options_and_ends_with_a_message_on_bad_ones(monkeypatch, capsys):
    seen = []

    def main(value: float = 1.0) -> None:
        if value < 0.0:
            raise ConfigError(f"value is {value}; give 0 or more")
        seen.append(value)

    monkeypatch.setattr(sys, "argv", ["folder/example.py", "--value", "3"])
    show.run_script(main)
    assert seen == [3.0]
    monkeypatch.setattr(sys, "argv", ["folder/example.py", "--value", "-3"])
    with pytest.raises(SystemExit) as end:
        show.run_script(main)
    assert end.value.code == 2
    assert capsys.readouterr().err == "example.py: value is -3.0; give 0 or more\n"
