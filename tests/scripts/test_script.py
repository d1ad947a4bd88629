import dataclasses
import math

import numpy as np
import pytest

from hugwbc.errors import CommandError, ConfigError, TargetError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.scripts.hand_paths import Hold, Line, Swing
from hugwbc.scripts.motion import ArmMotion
from hugwbc.scripts.script import HandMotion, Script, Segment, while_walking

PATH = Swing(centre=(0.3, 0.2, 0.1), amplitude=(0.1, 0.0, 0.05), phase=(0.0, 0.0, 0.25), period=2.0)
MOTION = HandMotion(PATH, PATH.mirrored())


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
    still = HandMotion(Hold((0.3, 0.2, 0.1)), Hold((0.3, -0.2, 0.1)))
    high = HandMotion(Hold((0.3, 0.2, 0.3)), Hold((0.3, -0.2, 0.3)))
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


def test_a_hand_motion_goes_on_through_equal_segments_and_starts_with_another():
    line = Line(((0.3, 0.2, 0.0), (0.3, 0.2, 0.4)), leg_time=4.0)
    up = HandMotion(line, None)
    script = Script("test", (Segment("wait", 1.0), Segment("a", 2.0, hands=up), Segment("b", 2.0, hands=up)))
    heights = [script.hands_at(t).left[2] for t in (1.0, 3.0, 5.0)]  # type: ignore[union-attr]
    assert heights == pytest.approx([0.0, 0.2, 0.4])
    assert script.hands_at(3.0).right is None  # type: ignore[union-attr]


def test_a_hand_without_a_target_before_starts_at_once():
    left, both = HandMotion(Hold((0.3, 0.2, 0.1)), None), HandMotion(Hold((0.3, 0.2, 0.1)), Hold((0.3, -0.2, 0.1)))
    script = Script("test", (Segment("a", 1.0, hands=left), Segment("b", 2.0, hands=both)))
    hands = script.hands_at(1.1)
    assert hands is not None
    assert hands.array() == pytest.approx(np.array([[0.3, 0.2, 0.1], [0.3, -0.2, 0.1]]))


def test_while_walking_puts_a_walk_under_a_script():
    squat = Segment("squat", 2.0, commands={"h": -0.1}, hands=MOTION)
    turn = Segment("turn", 2.0, Gait.WALKING, {"omega": 0.4})
    script = while_walking(Script("test", (squat, turn)), 0.3)
    assert script.name == "test while walking"
    assert script.segments[0] == dataclasses.replace(squat, gait=Gait.WALKING, commands={"h": -0.1, "v_x": 0.3})
    assert script.segments[1] == turn
    with pytest.raises(CommandError, match="v_x = 9"):
        while_walking(Script("test", (squat,)), 9.0)


RAISE = ArmMotion("raise", 10.0, np.linspace(0.0, 0.3, 21)[:, None] * np.ones(8), load_robot())
LOWER = ArmMotion("lower", 10.0, np.full((21, 8), -0.2), load_robot())


def test_a_motion_of_the_arms_plays_goes_on_and_rests_at_its_end():
    script = Script(
        "test",
        (Segment("wait", 1.0), Segment("a", 1.0, motion=RAISE), Segment("b", 2.0, motion=RAISE), Segment("c", 1.0)),
    )
    assert script.hands_at(0.9) is None and script.hands_at(4.5) is None
    for t, position, velocity in ((1.5, 0.075, 0.15), (2.5, 0.225, 0.15), (3.5, 0.3, 0.0)):
        targets = script.hands_at(t)
        assert targets is not None and not targets.given.any() and targets.is_usable
        assert targets.joints == pytest.approx(np.full(8, position))
        assert targets.joint_velocity == pytest.approx(np.full(8, velocity))


def test_one_motion_ramps_into_another():
    script = Script("test", (Segment("a", 2.0, motion=RAISE), Segment("b", 2.0, motion=LOWER)))
    middle = script.hands_at(2.5)
    assert middle is not None and middle.joints == pytest.approx(np.full(8, 0.05)), "half-way from 0.3 to -0.2"


def test_hands_and_a_motion_at_once_are_refused():
    with pytest.raises(TargetError, match="segment 'x' has both hands and a motion"):
        Segment("x", 1.0, hands=MOTION, motion=RAISE)


def test_a_script_checks_its_parts():
    with pytest.raises(CommandError, match="unknown command 'vx'"):
        Segment("x", 1.0, commands={"vx": 0.1})
    with pytest.raises(CommandError, match=r"segment 'x': command v_x = 0.1 m/s is out of range for the standing gait"):
        Segment("x", 1.0, Gait.STANDING, {"v_x": 0.1})
    with pytest.raises(ConfigError, match=r"commands.h is nan"):
        Segment("x", 1.0, Gait.STANDING, {"h": math.nan})
    with pytest.raises(ConfigError, match="duration"):
        Segment("x", 0.0)
    with pytest.raises(ConfigError, match="ramps for 2"):
        Segment("x", 1.0, ramp=2.0)
    with pytest.raises(ConfigError, match="at least 1"):
        Script("x", ())


def test_standing_cannot_start_at_speed():
    with pytest.raises(CommandError, match=r"segment 'halt' .* starts from v_x = 0.5 .*put a walking segment between"):
        Script("x", (Segment("go", 2.0, Gait.WALKING, {"v_x": 0.5}), Segment("halt", 2.0)))


def test_bad_hand_motions_are_refused():
    with pytest.raises(TargetError, match="neither hand has a path"):
        HandMotion(None, None)
    with pytest.raises(UnknownNameError, match="frame"):
        HandMotion(PATH, PATH, "body")  # type: ignore[arg-type]
    with pytest.raises(TargetError, match="changes the hand frame from pelvis to world"):
        Script(
            "x", (Segment("a", 1.0, hands=MOTION), Segment("b", 1.0, hands=dataclasses.replace(MOTION, frame="world")))
        )


def test_the_velocity_of_joints_is_that_of_their_positions_from_one_motion_to_the_next():
    rising = ArmMotion("rising", 50.0, np.tile(np.linspace(0.0, 0.3, 201)[:, None], 8), load_robot())
    falling = ArmMotion("falling", 50.0, np.tile(np.linspace(0.2, -0.3, 201)[:, None], 8), load_robot())
    script = Script("both", (Segment("a", 1.0, motion=rising), Segment("b", 2.0, motion=falling, ramp=1.5)))
    for t in (1.201, 1.751, 2.301, 2.705):  # between two frames
        before, now, after = (script.hands_at(t + dt) for dt in (-1e-4, 0.0, 1e-4))
        assert now.joint_velocity == pytest.approx((after.joints - before.joints) / 2e-4, abs=1e-5)
