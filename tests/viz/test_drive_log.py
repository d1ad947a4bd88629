"""A drive becomes a script that commands the same."""

import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.errors import ConfigError
from hugwbc.scripts import Script
from hugwbc.settings_file import parse
from hugwbc.targets import HandTargets
from hugwbc.viz.drive_log import DriveLog
from hugwbc.viz.live_source import LiveSource

DT = 0.02
SHARE_TOLERANCE = 0.08  # of the range of a command
WIDTHS = {"v_x": 2.6, "v_y": 1.2, "omega": 2.0, "f": 2.0, "l": 0.25, "h": 0.3, "p": 0.4, "w": 2.0}


def recorded(events, seconds):
    """Drive a source: at each time of an event, a function is called with it."""
    source, log, commands, waiting = LiveSource(), DriveLog(), [], sorted(events.items())
    for tick in range(round(seconds / DT)):
        t = tick * DT
        while waiting and waiting[0][0] <= t:
            waiting.pop(0)[1](source)
        command = source.command_at(t)
        log.add(t, command, source.hands_at(t))
        commands.append((t, command, source.hands_at(t)))
    return log, commands


def test_the_script_of_a_drive_commands_the_same(tmp_path):
    hands = HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), frame="heading")
    higher = HandTargets.of((0.3, 0.2, 0.3), (0.3, -0.2, 0.3), frame="heading", whole_body=True)
    log, commands = recorded(
        {
            1.0: lambda source: source.ask("v_x", 0.8),  # from standing: walking
            3.0: lambda source: source.ask("omega", -0.5),
            4.0: lambda source: setattr(source, "hands", hands),
            5.0: lambda source: setattr(source, "hands", higher),
            6.0: lambda source: setattr(source, "hands", None),
            6.5: lambda source: source.ask_gait(Gait.HOPPING_LEFT),
            8.0: lambda source: source.ask("v_x", 0.3),
            9.0: lambda source: source.halt("gone"),
            10.0: lambda source: source.ask("h", -0.2),
        },
        12.0,
    )
    script = parse(Script, log.script("test"), tmp_path / "drive.yaml", name="drive")
    assert script.duration == pytest.approx(12.0, abs=0.2)
    assert len(script.segments) < 30
    gaits = [command.gait for _, command, _ in commands]
    assert set(gaits) == {Gait.STANDING, Gait.WALKING, Gait.HOPPING_LEFT}
    other = [script.command_at(t).gait is not command.gait for t, command, _ in commands]
    assert np.mean(other) < 0.05
    for name, width in WIDTHS.items():
        error = [abs(getattr(script.command_at(t), name) - getattr(command, name)) for t, command, _ in commands]
        assert np.mean(error) < SHARE_TOLERANCE * width, name
        assert max(error) < 0.25 * width, name
    assert script.hands_at(4.5).frame == "heading" and not script.hands_at(4.5).whole_body
    np.testing.assert_allclose(script.hands_at(5.95).left, [0.3, 0.2, 0.3], atol=0.01)  # a jump becomes a ramp
    assert script.hands_at(5.5).whole_body and script.hands_at(8.0) is None


def test_a_drive_of_no_length_is_refused():
    with pytest.raises(ConfigError, match="record at least a second"):
        DriveLog().script("nothing")
