import dataclasses
import pathlib

import numpy as np
import pytest

from hugwbc.errors import CommandError, ConfigError, TargetError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.scripts.hand_paths import Circle, Hold, Line, Swing, Wander
from hugwbc.scripts.motion import ArmMotion, generate_motions, load_motion
from hugwbc.scripts.script import SCRIPT_NAMES, HandMotion, Script, Segment, load_script, while_walking
from hugwbc.settings_file import parse as parse_settings

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


@pytest.mark.parametrize(
    ("gait", "name", "start", "end"), [(Gait.WALKING, "v_x", 0.18, -0.6), (Gait.STANDING, "h", -0.03, -0.3)]
)
def test_a_ramp_to_the_end_of_a_range_stays_in_it(gait, name, start, end):
    assert start + (end - start) < end, "by rounding"
    first, second = (Segment("go", 2.0, gait, {name: value}) for value in (start, end))
    assert Script("test", (first, second)).command_at(3.5).clamp() == (second.command(), ())


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
    hop = Segment("hop", 2.0, Gait.HOPPING_LEFT)
    assert while_walking(Script("test", (hop,)), 0.3).segments == (hop,), "it does not walk"
    with pytest.raises(CommandError, match="v_x = 9"):
        while_walking(Script("test", (squat,)), 9.0)


def test_segments_have_the_ranges_and_defaults_of_their_robot():
    """A G1 lifts its feet by 0.12 m, and may lift them by 0.09 m, less than an H1."""
    stand = Segment("stand", 1.0, robot=load_robot("g1"))
    low = dataclasses.replace(stand, gait=Gait.WALKING, commands={"l": 0.09})
    script = while_walking(Script("test", (stand, low)), 0.3)
    assert [script.command_at(t).l for t in (0.0, 1.0, 2.0)] == pytest.approx([0.12, 0.12, 0.09])
    with pytest.raises(CommandError, match=r"segment 'stand': command h = -0\.3 m .* valid: -0\.24 to 0 m"):
        dataclasses.replace(stand, commands={"h": -0.3})


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
    with pytest.raises(TargetError, match="commands of g1, but its motion 'raise' moves the arms of h1; load"):
        Segment("x", 1.0, motion=RAISE, robot=load_robot("g1"))


def test_bad_hand_motions_are_refused():
    with pytest.raises(TargetError, match="neither hand has a path"):
        HandMotion(None, None)
    with pytest.raises(TargetError, match="no hand has an orientation; give it one"):
        dataclasses.replace(MOTION, orientation_weight=0.1)
    with pytest.raises(TargetError, match="changes the hand frame from pelvis to world"):
        Script(
            "x", (Segment("a", 1.0, hands=MOTION), Segment("b", 1.0, hands=dataclasses.replace(MOTION, frame="world")))
        )


def test_declared_paths_may_be_slow_and_all_of_a_random_one_is_checked():
    slow = Line(((0.3, 0.2, 0.1), (0.35, 0.2, 0.1)), leg_time=60.0)
    HandMotion(slow, None)
    HandMotion(Circle((0.3, 0.2, 0.1), 0.05, period=900.0), None)
    for seed in range(3):
        with pytest.raises(TargetError, match=r"left hand path goes up to .* m from the pelvis"):
            HandMotion(Wander((1.0, 0.2, 0.1), (1.0, 0.4, 0.4), seed=seed), None)
        with pytest.raises(ConfigError, match="left hand path jumps by"):
            HandMotion(Wander((0.4, 0.2, 0.1), (0.4, 0.4, 0.4), leg_time=0.1, seed=seed), None)


def test_the_velocity_of_joints_is_that_of_their_positions_from_one_motion_to_the_next():
    rising = ArmMotion("rising", 50.0, np.tile(np.linspace(0.0, 0.3, 201)[:, None], 8), load_robot())
    falling = ArmMotion("falling", 50.0, np.tile(np.linspace(0.2, -0.3, 201)[:, None], 8), load_robot())
    script = Script("both", (Segment("a", 1.0, motion=rising), Segment("b", 2.0, motion=falling, ramp=1.5)))
    for t in (1.201, 1.751, 2.301, 2.705):  # between two frames
        before, now, after = (script.hands_at(t + dt) for dt in (-1e-4, 0.0, 1e-4))
        assert now.joint_velocity == pytest.approx((after.joints - before.joints) / 2e-4, abs=1e-5)


ROBOT = load_robot()

GOOD = """\
about: everything a segment can say
segments:
  - label: go
    duration: 2
    gait: walking
    commands: {v_x: 0.3, w: -0.2}
    ramp: 0.5
    hands:
      frame: heading
      left: {circle: {centre: [0.3, 0.2, 0.1], radius: 0.05, axis: z, period: 3}}
      right: mirror
  - {label: stop, duration: 0.5, gait: walking}
  - label: point
    duration: 3
    hands: {right: {hold: [0.3, -0.2, 0.1]}}
"""


def parse(text):
    return parse_settings(Script, text, pathlib.Path("scene.yaml"), name="scene")


def test_a_script_is_what_the_file_says():
    script = parse(GOOD)
    circle = Circle((0.3, 0.2, 0.1), 0.05, "z", 3.0)
    go = Segment(
        "go", 2.0, Gait.WALKING, {"v_x": 0.3, "w": -0.2}, HandMotion(circle, circle.mirrored(), "heading"), 0.5
    )
    point = Segment("point", 3.0, hands=HandMotion(None, Hold((0.3, -0.2, 0.1))))
    assert script.name == "scene"
    assert script.about == "everything a segment can say"
    assert script.segments == (go, Segment("stop", 0.5, Gait.WALKING, ramp=0.5), point)


def test_a_segment_may_play_a_motion_file(tmp_path):
    generate_motions(ROBOT, seed=0, count=1, duration=2.0)[0].save(tmp_path / "wave.npz")
    text = "segments: [{label: a, duration: 1, motion: wave.npz}, {label: b, duration: 1, motion: %s}]"
    (tmp_path / "scene.yaml").write_text(text % "wave.npz")
    first, second = load_script(tmp_path / "scene.yaml", ROBOT).segments
    assert first.motion is not None and first.motion is second.motion
    assert first.motion.positions == pytest.approx(load_motion(tmp_path / "wave.npz", ROBOT).positions)
    (tmp_path / "scene.yaml").write_text(text % "other.npz")
    with pytest.raises(ConfigError, match=r"scene.yaml:1:7\d: cannot read .*other.npz"):
        load_script(tmp_path / "scene.yaml", ROBOT)


def test_directions_and_hands_that_hold_one_thing():
    text = "segments: [{label: a, duration: 1, hands: {left: {hold: [0, 0, 0]}, right: mirror, %s}}]"
    hands = parse(text % "left_direction: [0, 0, -2], together: true").segments[0].hands
    assert hands is not None
    targets = hands.at(0.5)
    assert targets.together
    assert targets.left_direction == pytest.approx([0.0, 0.0, -1.0])
    assert targets.right_direction is None
    with pytest.raises(ConfigError, match=r"yaml:1:36: left direction is .*not zero"):
        parse(text % "left_direction: [0, 0, 0]")
    with pytest.raises(ConfigError, match=r"maybe.*bool"):
        parse(text % "together: maybe")
    with pytest.raises(ConfigError, match=r"hold one object both need a target"):
        parse("segments: [{label: a, duration: 1, hands: {left: {hold: [0, 0, 0]}, together: true}}]")


def test_paths_by_kind(tmp_path):
    (tmp_path / "wipe.csv").write_text("t,x,y,z\n0,0.3,0.2,0.1\n1,0.4,0.2,0.1\n")
    (tmp_path / "scene.yaml").write_text(
        "segments: [{label: a, duration: 1, hands: {left: {line: {points: [[0, 0, 0], [0, 0, 1]], repeat: true}},"
        " right: {file: wipe.csv}}}]"
    )
    hands = load_script(tmp_path / "scene.yaml").segments[0].hands
    assert hands is not None
    assert hands.left == Line(((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), repeat=True)
    assert hands.right is not None
    assert hands.right.at(0.5) == pytest.approx([0.35, 0.2, 0.1])


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ("duration: 2", "duration: soon", "4:5", "number"),
        ("duration: 2", "duration: -2", "4:5", "greater than 0"),
        ("    duration: 2\n", "", "3:5", "duration is missing"),
        (", duration: 0.5", "", "12:5", "segments.1.duration is missing"),
        ("duration: 2", "durration: 2", "4:5", "unknown Segment field 'durration'. Did you mean 'duration'?"),
        ("gait: walking", "gait: wolking", "5:5", "unknown gait 'wolking'. Did you mean 'walking'?"),
        ("v_x: 0.3", "v_x: 9", "6:16", "command v_x = 9 m/s is out of range for the walking gait"),
        ("v_x: 0.3", "vx: 0.3", "6:16", "unknown command 'vx'. Did you mean 'v_x'?"),
        ("ramp: 0.5", "ramp: 5", "7:5", "segment 'go' ramps for 5.0 s"),
        ("frame: heading", "frame: body", "9:7", "'body'. Valid: pelvis"),
        ("circle:", "circel:", "10:14", "unknown path 'circel'. Did you mean 'circle'?"),
        ("radius: 0.05, ", "", "10:14", "radius is missing"),
        ("radius: 0.05", "radius: -1", "10:48", "greater than 0"),
        ("[0.3, 0.2, 0.1], radius", "[0.3, 0.2], radius", "10:23", "missing"),
        ("axis: z", "axis: up", "10:62", "'up'. Valid: x, y, z"),
        ("{circle:", "{hold: [0, 0, 0], circle:", "10:7", "one path"),
        ("right: mirror", "right: {file: gone.csv}", "11:7", "cannot read gone.csv"),
        ("right: mirror", "right: {file: [a]}", "11:7", "path"),
        ("left: {circle", "# left: {circle", "11:7", "the other hand has no path to mirror"),
        ("right: mirror", "right_orientation: level", "8:5", "the right hand has no path; give it one"),
        ("0.5, gait: walking}", "0.5}", "12:5", "segment 'stop' (standing) starts from v_x = 0.3"),
        ("segments:", "segment:", "2:1", "unknown Script field 'segment'. Did you mean 'segments'?"),
        ("commands: {v_x: 0.3, w: -0.2}", "commands: fast", "6:5", "mapping"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_line(old, new, place, message):
    assert GOOD.count(old) >= 1
    with pytest.raises(ConfigError) as caught:
        parse(GOOD.replace(old, new, 1))
    assert str(caught.value).startswith(f"scene.yaml:{place}: ")
    assert message in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read .*gone\.yaml: No such file or directory; give"):
        load_script(tmp_path / "gone.yaml")
    with pytest.raises(UnknownNameError, match="unknown script 'loco'"):
        load_script("loco")


def test_the_library():
    scenes = {"wave", "reach_grid", "wipe_table", "pick_from_floor", "hand_over"}
    assert scenes | {"arms_random_walk", "loco_manipulation", "stand", "walk", "squat"} == set(SCRIPT_NAMES)
    assert all(load_script(name).about for name in SCRIPT_NAMES)


def test_the_documented_example_is_a_script_and_its_mistake_is_told_so():
    page = (pathlib.Path(__file__).parents[2] / "docs" / "how-to" / "add-a-command-script.md").read_text()
    text = page.split('```yaml title="inspect.yaml"\n')[1].split("```")[0]
    assert [segment.label for segment in parse(text).segments][:3] == ["stand", "approach", "stop"]
    with pytest.raises(ConfigError) as caught:
        parse(text.replace("v_x: 0.4", "v_x: 4"))
    assert str(caught.value).removeprefix("scene.yaml") in page


@pytest.mark.parametrize("name", SCRIPT_NAMES)
def test_shipped_scripts_are_valid_and_smooth_at_every_tick(name):
    script = load_script(name)
    dt = 0.005
    previous, hands_before = None, None
    for t in np.arange(0.0, script.duration, dt):
        command = script.command_at(t).validate()
        hands = script.hands_at(t)
        if previous is not None:
            # Fastest ramp: 0.5 rad or m/s in 1 s, 1.875 times its mean speed.
            assert np.abs(command.array() - previous).max() <= 1.875 * 0.5 * dt + 1e-12
        if hands is not None and hands_before is not None:
            way = np.linalg.norm(hands.array() - hands_before, axis=1)
            assert np.nanmax(way) < 1.0 * dt, "hands go at most 1 m/s"
        previous, hands_before = command.array(), None if hands is None else hands.array()


def test_a_script_with_orientations_is_refused_for_arms_without_wrists(tmp_path):
    path = tmp_path / "level.yaml"
    hands = "{left: {hold: [0.3, 0.2, 0.1]}, right: mirror, left_orientation: level, right_orientation: [1, 0, 0, 0]}"
    path.write_text(f"segments:\n  - {{label: a, duration: 1}}\n  - {{label: b, duration: 1, hands: {hands}}}\n")
    hands = load_script(path, load_robot("g1")).hands_at(1.5)
    assert hands is not None and not hands.left_orientation.any() and hands.right_orientation.tolist() == [1, 0, 0, 0]
    with pytest.raises(ConfigError, match=r"level.yaml:3:\d+: .*left_orientation takes an arm of 5 joints .* h1 has 4"):
        load_script(path, load_robot("h1"))


def test_a_script_has_the_ranges_and_defaults_of_the_robot_that_it_is_loaded_for(tmp_path):
    """A G1 lifts its feet lower: its default is 0.15 m times its leg over the paper's, and 0.08 m is allowed."""
    path = tmp_path / "walk.yaml"
    path.write_text(
        "segments:\n"
        "- {label: go, duration: 2, gait: walking, commands: {v_x: 0.3}}\n"
        "- {label: low, duration: 2, gait: walking, commands: {l: 0.08}}\n"
    )
    script = load_script(path, load_robot("g1"))
    assert [script.command_at(t).l for t in (1.5, 4.0)] == pytest.approx([0.15 * 0.6366 / 0.8, 0.08], abs=0.005)
    with pytest.raises(ConfigError, match=r"segment 'low': command l = 0\.08 m .* valid: 0\.1 to 0\.35"):
        load_script(path, load_robot("h1"))


def test_a_robots_own_defaults_follow_one_another(tmp_path) -> None:
    """A G1's hop has the swing height of its walk, which is not the paper's."""
    path = tmp_path / "hop.yaml"
    path.write_text(
        "segments:\n  - {label: stand, duration: 1}\n  - {label: walk, duration: 2, gait: walking}\n"
        "  - {label: hop, duration: 2, gait: hopping_left}\n"
    )
    robot = load_robot("g1")
    script = load_script(path, robot)
    assert all(script.command_at(t).clamp(robot)[1] == () for t in np.linspace(0.0, 5.0, 51))
