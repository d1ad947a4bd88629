import dataclasses
import math

import numpy as np
import pytest

from hugwbc.commands import VELOCITY_NAMES
from hugwbc.errors import CommandError, ConfigError, TargetError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.script import SCRIPT_NAMES, HandMotion, HandPath, Script, Segment, load_script, smooth_step

PATH = HandPath(centre=(0.3, 0.2, 0.1), amplitude=(0.1, 0.0, 0.05), phase=(0.0, 0.0, 0.25), period=2.0)
MOTION = HandMotion(PATH, PATH.mirrored())


def test_smooth_step_is_minimum_jerk():
    assert [smooth_step(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert smooth_step(0.25) == pytest.approx(10 / 64 - 15 / 256 + 6 / 1024)


def test_hand_path_by_hand():
    assert PATH.at(0.0) == pytest.approx([0.3, 0.2, 0.15])
    assert PATH.at(0.5) == pytest.approx([0.4, 0.2, 0.1])
    assert PATH.mirrored().at(0.5) == pytest.approx([0.4, -0.2, 0.1])


def test_commands_ramp_from_one_segment_to_the_next():
    script = Script(
        "test", (Segment("go", 2.0, Gait.WALKING, {"v_x": 0.4}), Segment("turn", 3.0, Gait.WALKING, {"omega": 1}))
    )
    assert script.duration == 5.0
    assert script.command_at(0.0).v_x == 0.0
    assert script.command_at(0.5).v_x == pytest.approx(0.2)
    assert script.command_at(1.0).v_x == pytest.approx(0.4)
    assert script.command_at(2.5).v_x == pytest.approx(0.2)
    assert script.command_at(2.5).omega == pytest.approx(0.5)
    assert script.command_at(3.0).v_x == 0.0
    assert script.command_at(-1.0) == script.command_at(0.0)
    assert script.command_at(99.0) == script.command_at(5.0)
    assert script.command_at(99.0).omega == 1.0


def test_hands_blend_and_end():
    still = HandMotion(HandPath((0.3, 0.2, 0.1)), HandPath((0.3, -0.2, 0.1)))
    high = HandMotion(HandPath((0.3, 0.2, 0.3)), HandPath((0.3, -0.2, 0.3)))
    script = Script(
        "test", (Segment("a", 1.0), Segment("b", 1.0, hands=still), Segment("c", 2.0, hands=high), Segment("d", 1.0))
    )
    heights = []
    for t in (1.0, 2.0, 2.5, 3.5):
        hands = script.hands_at(t)
        assert hands is not None
        heights.append(hands.left[2])
    assert heights == pytest.approx([0.1, 0.1, 0.2, 0.3])
    assert script.hands_at(0.5) is None
    assert script.hands_at(4.5) is None


@pytest.mark.parametrize("name", SCRIPT_NAMES)
def test_shipped_scripts_are_valid_and_smooth_at_every_tick(name):
    script = load_script(name)
    dt = 0.002
    previous, hands_before = None, None
    for t in np.arange(0.0, script.duration, dt):
        command = script.command_at(t).validate()
        hands = script.hands_at(t)
        if previous is not None:
            # Fastest ramp: 0.5 rad or m/s in 1 s, 1.875 times its mean speed.
            assert np.abs(command.array() - previous).max() <= 1.875 * 0.5 * dt + 1e-12
        if hands is not None and hands_before is not None:
            assert np.linalg.norm(hands.array() - hands_before, axis=1).max() < 0.2 * dt
        previous, hands_before = command.array(), None if hands is None else hands.array()


def test_loco_manipulation_does_what_the_comparison_needs():
    script = load_script("loco_manipulation")
    assert script.duration == 20.0
    commands = {s.label: script.command_at(sum(x.duration for x in script.segments[: i + 1]) - 1e-6)
                for i, s in enumerate(script.segments)}  # fmt: skip
    assert commands["walk"].v_x == 0.5
    assert commands["turn"].omega == 0.4
    assert commands["turn"].v_x == 0.0
    assert (commands["squat"].h, commands["squat"].p, commands["squat"].w) == (-0.2, 0.3, 0.5)
    assert commands["stand up"].h == pytest.approx(0.0, abs=1e-12)
    for label in ("reach", "walk", "turn", "stop", "squat"):
        segment = next(s for s in script.segments if s.label == label)
        assert segment.hands is not None
        assert segment.hands.frame == "pelvis"
    for t in np.arange(0.0, 20.0, 0.01):
        command = script.command_at(t)
        if command.gait is Gait.STANDING:
            assert all(getattr(command, name) == 0.0 for name in VELOCITY_NAMES)


def test_a_script_checks_its_parts():
    with pytest.raises(UnknownNameError, match="unknown script 'loco'"):
        load_script("loco")
    with pytest.raises(UnknownNameError, match="unknown command 'vx'"):
        Segment("x", 1.0, commands={"vx": 0.1})
    with pytest.raises(CommandError, match=r"segment 'x': command v_x = 0.1 m/s is out of range for the standing gait"):
        Segment("x", 1.0, Gait.STANDING, {"v_x": 0.1})
    with pytest.raises(CommandError, match="segment 'x': command h is nan"):
        Segment("x", 1.0, Gait.STANDING, {"h": math.nan})
    with pytest.raises(ConfigError, match="finite duration above 0"):
        Segment("x", 0.0)
    with pytest.raises(ConfigError, match="ramps for 2"):
        Segment("x", 1.0, ramp=2.0)
    with pytest.raises(ConfigError, match="at least one segment"):
        Script("x", ())


def test_standing_cannot_start_at_speed():
    with pytest.raises(CommandError, match=r"segment 'halt' .* starts from v_x = 0.5 .*put a walking segment between"):
        Script("x", (Segment("go", 2.0, Gait.WALKING, {"v_x": 0.5}), Segment("halt", 2.0)))


def test_bad_hand_paths_are_refused():
    with pytest.raises(TargetError, match=r"centre is .*nan"):
        HandPath((0.3, math.nan, 0.1))
    with pytest.raises(TargetError, match="amplitude"):
        HandPath((0.3, 0.2, 0.1), amplitude=(0.1, 0.1))  # type: ignore[arg-type]
    with pytest.raises(TargetError, match="period is 0"):
        HandPath((0.3, 0.2, 0.1), period=0.0)
    with pytest.raises(UnknownNameError, match="hand frame"):
        HandMotion(PATH, PATH, "body")  # type: ignore[arg-type]
    with pytest.raises(TargetError, match="changes the hand frame from pelvis to world"):
        Script(
            "x",
            (Segment("a", 1.0, hands=MOTION), Segment("b", 1.0, hands=dataclasses.replace(MOTION, frame="world"))),
        )
