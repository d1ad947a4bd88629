import pathlib

import numpy as np
import pytest
from bvh_helpers import write_bvh

from hugwbc import rotations
from hugwbc.errors import MotionFileError
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.scripts.bvh import find_joints, load_bvh
from hugwbc.scripts.whole_body_motion import PARTS, MotionScore, load_whole_body_motion
from tests.conftest import make_state


def asked(motion, name):
    return motion.asked[:, PARTS.index(name)]


@pytest.mark.parametrize(("up", "unit", "prefix"), [("y", 1.0, ""), ("z", 0.01, "mixamorig:"), ("y", 1.0, "Bob:")])
def test_a_person_who_stands_asks_for_nothing_but_hands(up, unit, prefix, tmp_path, robot):
    motion = load_whole_body_motion(write_bvh(tmp_path / "stand.bvh", up=up, unit=unit, prefix=prefix))
    assert motion.duration == pytest.approx(5.0) and not motion.walking.any()
    np.testing.assert_allclose(motion.asked, 0.0, atol=1e-6)
    # Each arm goes half of its length down and half of it forward, from the robot's own shoulder.
    half = (robot.upper_arm + robot.forearm) / 2.0
    np.testing.assert_allclose(
        motion.hands[:, 0], np.tile(robot.shoulder + np.array([half, 0, -half]), (251, 1)), atol=1e-6
    )
    np.testing.assert_allclose(motion.hands[:, 1], motion.hands[:, 0] * [1, -1, 1], atol=1e-6)
    assert motion.unused == tuple(f"{prefix}{name}" for name in ("Hips", "Spine", "Head"))


def test_a_walk_is_scaled_by_the_leg_and_turns_with_the_person(tmp_path):
    # 0.6 m/s to the file's +x with the person turned by 90 degrees about the vertical: straight ahead.
    motion = load_whole_body_motion(
        write_bvh(tmp_path / "walk.bvh", lambda t: {"position": (60 * t, 80, 0), "Hips": (0, 0, 90)})
    )
    middle = slice(60, 190)
    np.testing.assert_allclose(asked(motion, "v_x")[middle], 0.6 * load_robot().leg_length / 0.8, atol=1e-6)
    np.testing.assert_allclose(asked(motion, "v_y")[middle], 0.0, atol=1e-6)
    assert motion.walking[middle].all() and motion.command_at(2.5).gait is Gait.WALKING
    np.testing.assert_allclose(motion.allowed[middle], motion.asked[middle], atol=1e-9)


def test_a_turn_is_a_yaw_rate(tmp_path):
    motion = load_whole_body_motion(write_bvh(tmp_path / "turn.bvh", lambda t: {"Hips": (0, 0, 100 * t)}))
    np.testing.assert_allclose(asked(motion, "omega")[60:190], np.deg2rad(100), atol=1e-4)
    np.testing.assert_allclose(motion.allowed[60:190, PARTS.index("omega")], 1.0)
    np.testing.assert_allclose(asked(motion, "v_x"), 0.0, atol=1e-6)


def test_leaning_twisting_and_squatting(tmp_path):
    def move(t):
        bent = np.rad2deg(np.arccos(0.5))  # hips at half of the leg's length
        down = {f"{side}UpLeg": (0, -bent, 0) for side in ("Left", "Right")}
        down |= {f"{side}Leg": (0, 2 * bent, 0) for side in ("Left", "Right")}
        return {"position": (0, 40, 0), **down} if t > 4.0 else {"Spine": (0, 20, 30)} if t < 2.0 else {}

    motion = load_whole_body_motion(write_bvh(tmp_path / "lean.bvh", move))
    assert np.rad2deg(asked(motion, "w")[50]) == pytest.approx(30.0, abs=3.0), "to the left is positive"
    assert asked(motion, "p")[50] > 0.2, "forward is positive"
    leg = load_robot().leg_length
    assert asked(motion, "h")[-1] == pytest.approx(-0.5 * leg, abs=0.01)
    assert motion.allowed[-1, PARTS.index("h")] == pytest.approx(-0.3)
    assert asked(motion, "h")[150] == pytest.approx(0.0, abs=1e-6)
    for t in np.arange(0.0, 6.0, 0.1):
        motion.command_at(t).validate()
        assert motion.hands_at(t).is_usable


def test_errors_are_those_of_the_clip_the_ranges_and_the_robot(tmp_path):
    motion = load_whole_body_motion(write_bvh(tmp_path / "turn.bvh", lambda t: {"Spine": (0, 0, 80)}))
    robot, score = load_robot(), MotionScore(load_whole_body_motion(tmp_path / "turn.bvh"))
    still = make_state(yaw=0.7, position=(1.0, 2.0, robot.nominal_height - 0.1), velocity=np.zeros(3))
    for t in np.arange(0.0, 5.0, 0.02):
        level = motion.hands[motion.frame_at(t)] + [0.0, 0.0, 0.05]
        score.watch(t, still, still.position + level @ rotations.rotation_z(0.7).T)
    table = {line.split()[0]: line.split()[1:] for line in score.lines()[1:]}
    assert [float(table["hands"][2]), float(table["h"][2])] == [5.0, 10.0]
    cut = 80.0 - np.rad2deg(1.0)
    assert float(table["w"][0]) == pytest.approx(cut, abs=0.01) and float(table["w"][2]) == pytest.approx(80.0, abs=0.1)
    # The shoulders turn by what the range allows, and with them the hands.
    chord = 2 * np.hypot(*robot.shoulder[:2]) * np.sin(np.deg2rad(cut) / 2)
    assert float(table["hands"][0]) == pytest.approx(100 * chord, abs=0.01)
    assert list(table) == ["hands", "h", "p", "w", "v_x", "v_y", "omega"]


def test_other_conventions_have_the_joints_too():
    blender = [f"{part}.{side}" for part in ("thigh", "shin", "foot", "upper_arm", "forearm", "hand") for side in "LR"]
    biped = [f"Bip01 {s} {part}" for part in ("Thigh", "Calf", "Foot", "UpperArm", "Forearm", "Hand") for s in "LR"]
    for names in (blender, biped):
        pairs = zip(names[::2], names[1::2], strict=True)
        assert list(find_joints(pathlib.Path("a.bvh"), names).values()) == list(pairs)


def test_bad_clips_are_refused(tmp_path):
    path = write_bvh(tmp_path / "arm.bvh", without=("LeftHand",))
    with pytest.raises(MotionFileError, match=r"lacks joints .*: left wrist \(such as LeftHand\); rename"):
        load_bvh(path)
    text = write_bvh(tmp_path / "whole.bvh").read_text()
    for content in ("", "no motion", text[:400], text[:-200], text.replace("Frame Time: 0.040000", "Frame Time: nan")):
        path.write_text(content)
        with pytest.raises(MotionFileError, match=r"arm\.bvh"):
            load_bvh(path)
    with pytest.raises(MotionFileError, match=r"none\.bvh"):
        load_bvh(tmp_path / "none.bvh")
