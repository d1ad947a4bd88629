import pathlib
import re

import numpy as np
import pytest
from bvh_helpers import SKELETON, write_bvh

from hugwbc import rotations
from hugwbc.commands import MEASURED_NAMES
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.scripts.bvh import JOINTS, find_joints, load_bvh
from hugwbc.scripts.whole_body_motion import MotionScore, load_whole_body_motion
from tests.conftest import make_state


def asked(motion, name):
    return motion.asked[:, MEASURED_NAMES.index(name)]


@pytest.mark.parametrize(("up", "unit", "prefix"), [("y", 1.0, ""), ("z", 0.01, "mixamorig:"), ("y", 1.0, "Bob:")])
def test_a_person_who_stands_asks_for_nothing_but_hands(up, unit, prefix, tmp_path, robot):
    motion = load_whole_body_motion(write_bvh(tmp_path / "stand.bvh", up=up, unit=unit, prefix=prefix), load_robot())
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
        write_bvh(tmp_path / "walk.bvh", lambda t: {"position": (60 * t, 80, 0), "Hips": (0, 0, 90)}), load_robot()
    )
    middle = slice(60, 190)
    np.testing.assert_allclose(asked(motion, "v_x")[middle], 0.6 * load_robot().leg_length / 0.8, atol=1e-6)
    np.testing.assert_allclose(asked(motion, "v_y")[middle], 0.0, atol=1e-6)
    assert motion.walking[middle].all() and motion.command_at(2.5).gait is Gait.WALKING
    assert motion.walking[-1] and motion.command_at(motion.duration).v_x > 0.2
    after = motion.command_at(motion.duration + 0.1)
    assert after.gait is Gait.STANDING and after.v_x == 0.0, "the clip is over"
    np.testing.assert_allclose(motion.allowed[middle], motion.asked[middle], atol=1e-9)


def test_a_turn_is_a_yaw_rate(tmp_path):
    motion = load_whole_body_motion(write_bvh(tmp_path / "turn.bvh", lambda t: {"Hips": (0, 0, 100 * t)}), load_robot())
    np.testing.assert_allclose(asked(motion, "omega")[60:190], np.deg2rad(100), atol=1e-4)
    np.testing.assert_allclose(motion.allowed[60:190, MEASURED_NAMES.index("omega")], 1.0)
    np.testing.assert_allclose(asked(motion, "v_x"), 0.0, atol=1e-6)


def test_leaning_twisting_and_squatting(tmp_path):
    def move(t):
        bent = np.rad2deg(np.arccos(0.5))  # hips at half of the leg's length
        down = {f"{side}UpLeg": (0, -bent, 0) for side in ("Left", "Right")}
        down |= {f"{side}Leg": (0, 2 * bent, 0) for side in ("Left", "Right")}
        return {"position": (0, 40, 0), **down} if t > 4.0 else {"Spine": (0, 20, 30)} if t < 2.0 else {}

    motion = load_whole_body_motion(write_bvh(tmp_path / "lean.bvh", move), load_robot())
    assert np.rad2deg(asked(motion, "w")[50]) == pytest.approx(30.0, abs=3.0), "to the left is positive"
    assert asked(motion, "p")[50] > 0.2, "forward is positive"
    leg = load_robot().leg_length
    assert asked(motion, "h")[-1] == pytest.approx(-0.5 * leg, abs=0.01)
    assert motion.allowed[-1, MEASURED_NAMES.index("h")] == pytest.approx(-0.3)
    assert asked(motion, "h")[150] == pytest.approx(0.0, abs=1e-6)
    for t in np.arange(0.0, 6.0, 0.1):
        motion.command_at(t).validate()
        assert motion.hands_at(t).is_usable


def test_errors_are_those_of_the_clip_the_ranges_and_the_robot(tmp_path):
    motion = load_whole_body_motion(write_bvh(tmp_path / "turn.bvh", lambda t: {"Spine": (0, 0, 80)}), load_robot())
    robot, score = load_robot(), MotionScore(load_whole_body_motion(tmp_path / "turn.bvh", load_robot()), load_robot())
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


# Hip, knee, ankle, toes; collar bone, shoulder, elbow, wrist, a finger: {} is the side, in each convention's words.
CONVENTIONS = {
    "smpl": (("L", "R"), "{}_Hip {}_Knee {}_Ankle {}_Foot {}_Collar {}_Shoulder {}_Elbow {}_Wrist {}_Hand"),
    "smpl-x": (("left", "right"), "{}_hip {}_knee {}_ankle {}_foot {}_collar {}_shoulder {}_elbow {}_wrist {}_index1"),
    "mixamo": (
        ("Left", "Right"),
        "{}UpLeg {}Leg {}Foot {}ToeBase {}Shoulder {}Arm {}ForeArm {}Hand {}HandIndex1",
    ),
    "lafan": (("Left", "Right"), "{}UpLeg {}Leg {}Foot {}Toe {}Shoulder {}Arm {}ForeArm {}Hand {}HandEnd"),
    "xsens": (("Left", "Right"), "{}Hip {}Knee {}Ankle {}Toe {}Collar {}Shoulder {}Elbow {}Wrist {}Finger0"),
    "unreal": (("l", "r"), "thigh_{} calf_{} foot_{} ball_{} clavicle_{} upperarm_{} lowerarm_{} hand_{} index_01_{}"),
    "daz": (("l", "r"), "{}Thigh {}Shin {}Foot {}Toe {}Collar {}Shldr {}ForeArm {}Hand {}Mid1"),
    "genesis": (
        ("l", "r"),
        "{}ThighBend {}Shin {}Foot {}Toe {}Collar {}ShldrBend {}ForearmBend {}Hand {}Index1",
    ),
    "rokoko": (("Left", "Right"), "{}Thigh {}Shin {}Foot {}Toe {}Shoulder {}Arm {}ForeArm {}Hand {}Digit2"),
    "jnt": (
        ("l", "r"),
        "{}_upleg_JNT {}_leg_JNT {}_foot_JNT {}_toebase_JNT {}_shoulder_JNT {}_arm_JNT {}_forearm_JNT {}_hand_JNT "
        "{}_handIndex1_JNT",
    ),
    "bandai": (
        ("L", "R"),
        "UpperLeg_{} LowerLeg_{} Foot_{} Toes_{} Shoulder_{} UpperArm_{} LowerArm_{} Hand_{} Tip_{}",
    ),
    "blender": (("L", "R"), "thigh.{} shin.{} foot.{} toe.{} shoulder.{} upper_arm.{} forearm.{} hand.{} f_index.{}"),
    "biped": (
        ("Bip01 L", "Bip01 R"),
        "{} Thigh;{} Calf;{} Foot;{} Toe0;{} Clavicle;{} UpperArm;{} Forearm;{} Hand;{} Finger0",
    ),
    "asf": (("l", "r"), "{}femur {}tibia {}foot {}toes {}clavicle {}humerus {}radius {}wrist {}hand"),
}
# Lengths of a person [cm]: y up, x to the left.
WAYS = [(9, -4, 0), (0, -42, 0), (0, -40, 0), (0, -8, 14), (4, 40, 0), (16, 0, 0), (28, 0, 0), (25, 0, 0), (9, 0, 0)]


def person(convention: str, twists: str = "", ends: bool = True) -> tuple[dict, dict]:
    """Return a skeleton, and the names of its left and right joints by ours.

    Args:
        convention: of names.
        twists: "beside" for twist bones as other children, "between" for such in the middle of segments.
        ends: whether it has toes and fingers.
    """
    sides, text = CONVENTIONS[convention]
    skeleton, found = {"Root": (None, (0, 0, 0)), "Chest": ("Root", (0, 12, 0))}, {}
    for side, mirror in zip(sides, (1, -1), strict=True):
        names = [name.format(side) for name in (text.split(";") if ";" in text else text.split())]
        for index, (name, way) in enumerate(zip(names, np.array(WAYS) * (mirror, 1, 1), strict=True)):
            parent = {0: "Root", 4: "Chest"}.get(index, names[index - 1])
            if index in (3, 8) and not ends:
                continue
            if index in (1, 2, 6, 7) and twists:
                twist = f"{parent}_twist_01"
                skeleton[twist] = (parent, tuple(way / 2))
                if twists == "between":
                    parent, way = twist, way / 2
            skeleton[name] = (parent, tuple(way))
        for joint, index in zip(JOINTS, (0, 1, 2, 5, 6, 7), strict=True):
            found.setdefault(joint, []).append(names[index])
    return skeleton, {joint: tuple(pair) for joint, pair in found.items()}


def joints_of(skeleton: dict, prefix: str = "") -> dict:
    names = list(skeleton)
    parents = {names.index(name): names.index(parent) for name, (parent, _) in skeleton.items() if parent}
    places = np.zeros((1, len(names), 3))
    for index, parent in parents.items():
        places[0, index] = places[0, parent] + skeleton[names[index]][1]
    found = find_joints(pathlib.Path("a.bvh"), [prefix + name for name in names], parents, places)
    return {joint: tuple(names[index] for index in pair) for joint, pair in found.items()}


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_limbs_are_found_in_all_conventions_with_toes_fingers_and_twist_bones(convention):
    for twists in ("", "beside", "between"):
        for ends in (True, False):
            skeleton, expected = person(convention, twists, ends)
            assert joints_of(skeleton) == joints_of(skeleton, "Bob:") == expected, (twists, ends)


def test_what_may_be_several_joints_is_refused_with_their_names():
    lafan, _ = person("lafan")
    inserted = {**lafan, "LeftX": ("LeftUpLeg", (0, -21, 0)), "LeftLeg": ("LeftX", (0, -21, 0))}
    doubled = {**lafan, "LeftHandB": ("LeftForeArm", (0, -25, 0))}
    without = {name: part for name, part in lafan.items() if name not in ("RightHand", "RightHandEnd")}
    for skeleton, words in (
        (inserted, r"left leg \(hip, knee, ankle\) is not clear from the joints LeftUpLeg, LeftLeg, LeftFoot, LeftToe"),
        (doubled, r"left arm .* LeftHand, LeftHandEnd, LeftHandB; name three in a row left Arm, ForeArm, Hand"),
        (without, r"right arm .* RightShoulder, RightArm, RightForeArm; name"),
    ):
        with pytest.raises(ConfigError, match=words):
            joints_of(skeleton)


def test_a_squat_is_as_deep_whatever_the_joints_are_called(tmp_path):
    depth = {}
    for convention in ("lafan", "smpl", "unreal"):
        skeleton, found = person(convention)
        bent = np.rad2deg(np.arccos(0.5))
        down = {name: (0, -bent, 0) for name in found["hip"]} | {name: (0, 2 * bent, 0) for name in found["knee"]}
        path = tmp_path / f"{convention}.bvh"
        write_bvh(path, lambda t, down=down: {"position": (0, 86 if t < 3 else 45, 0), **(down if t > 3 else {})},
                  skeleton=skeleton)  # fmt: skip
        depth[convention] = asked(load_whole_body_motion(path, load_robot()), "h")[-1]
    assert depth["lafan"] == pytest.approx(-0.5 * load_robot().leg_length, abs=0.01)
    assert depth["smpl"] == depth["unreal"] == depth["lafan"]


def test_a_folded_rest_pose_such_as_lafans_stands_along_y(tmp_path):
    folded = {name: (parent, (x, abs(y), z)) for name, (parent, (x, y, z)) in SKELETON.items()}
    unfold = {f"{side}{part}": (0, 180, 0) for side in ("Left", "Right") for part in ("UpLeg", "Arm")}
    path = write_bvh(tmp_path / "folded.bvh", lambda t: unfold, skeleton=folded)
    np.testing.assert_allclose(load_whole_body_motion(path, load_robot()).asked, 0.0, atol=1e-6)


BOTH = ("Left", "Right")
POSES = {
    "plank": {"position": (0, 30, 0), "Hips": (0, 80, 0)},
    "on the back": {"position": (0, 10, 0), "Hips": (0, -90, 0)},
    "crawl": {"position": (0, 45, 0), "Hips": (0, 85, 0), **{f"{s}UpLeg": (0, -85, 0) for s in BOTH},
              **{f"{s}Leg": (0, 80, 0) for s in BOTH}},
    "chair": {"position": (0, 40, 0), **{f"{s}UpLeg": (0, -90, 0) for s in BOTH},
              **{f"{s}Leg": (0, 90, 0) for s in BOTH}},
    "kneel": {"position": (0, 40, 0), **{f"{s}Leg": (0, 90, 0) for s in BOTH}},
    "on the heels": {"position": (0, 10, 0), **{f"{s}UpLeg": (0, -90, 0) for s in BOTH},
                     **{f"{s}Leg": (0, 178, 0) for s in BOTH}},
    "handstand": {"position": (0, 80, 0), "Hips": (180, 0, 0)},
    "hang": {"position": (0, 110, 0)},
    "lean on a wall": {"Hips": (0, 35, 0)},
}  # fmt: skip


SAID = {
    "lying or head down": ("plank", "on the back", "crawl", "handstand"),
    "weight beside the feet": ("chair", "kneel", "lean on a wall"),
    "hips too low to stand": ("on the heels",),
    "both feet off the ground": ("hang",),
}


@pytest.mark.parametrize(("words", "pose"), [(words, pose) for words, poses in SAID.items() for pose in poses])
def test_a_clip_that_leaves_the_feet_is_refused_with_the_times(words, pose, tmp_path):
    def move(t):
        there = {"position": (0, 80, 0)} | POSES[pose]
        share = np.clip(min(t - 1.6, 3.9 - t) / 0.4, 0.0, 1.0)  # there from 2.0 to 3.5 s
        return {name: share * np.array(to) + (1 - share) * (name == "position") * np.array([0, 80, 0])
                for name, to in there.items()}  # fmt: skip

    path = write_bvh(tmp_path / "part.bvh", move)
    message = rf"part: .*{words}[^0-9]* from (1\.[6-9]|2\.0) to 3\.[5-9] s.*cut the file to 0\.0 to (1\.[6-9]|2\.0) s"
    with pytest.raises(ConfigError, match=message):
        load_whole_body_motion(path, load_robot())


def test_a_short_time_off_the_feet_is_told(tmp_path, caplog):
    load_whole_body_motion(
        write_bvh(tmp_path / "a.bvh", lambda t: POSES["handstand"] if 2.0 <= t < 2.4 else {}), load_robot()
    )
    assert "lying or head down from 2.0 to 2.4 s; cut the file to 2.4 to 5.0 s" in caplog.text


@pytest.mark.parametrize("pose", ["plank", "on the back", "crawl"])
def test_up_is_that_of_the_rest_pose_not_of_the_clip(pose, tmp_path):
    with pytest.raises(ConfigError, match=r"lying or head down from 0\.0 to 5\.0 s.*rest pose"):
        load_whole_body_motion(write_bvh(tmp_path / "floor.bvh", lambda t: POSES[pose]), load_robot())


def test_bows_hops_and_lunges_stay_on_the_feet(tmp_path):
    def move(t):
        if t < 1.5:
            return {"Spine": (0, 60, 0)}
        if t < 3.0:  # every half a second, 0.3 s in the air
            return {"position": (0, 80 + 20 * (t % 0.5 < 0.3), 0)}
        return {"position": (0, 62, 0), "LeftUpLeg": (0, -39, 0), "RightUpLeg": (0, 39, 0)}

    assert load_whole_body_motion(write_bvh(tmp_path / "move.bvh", move), load_robot()).duration == pytest.approx(5.0)


def test_a_jump_of_the_root_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"cut jumps by 1\.25 leg lengths within 0\.04 s at 1\.9"):
        load_whole_body_motion(
            write_bvh(tmp_path / "cut.bvh", lambda t: {"position": (100 * (t > 1.97), 80, 0)}), load_robot()
        )


def test_units_of_a_clip_are_told(tmp_path, caplog):
    path = write_bvh(tmp_path / "a.bvh", lambda t: {"Spine": (0, 0.4, 0)})
    load_bvh(path)
    assert "no angle is above 3.14; if these are radians, convert them to degrees" in caplog.text
    for time in ("33.3", "8.333", "1"):
        path.write_text(re.sub("Frame Time: .*", f"Frame Time: {time}", path.read_text()))
        with pytest.raises(ConfigError, match=rf"divide {time} by 1000 if it is in milliseconds"):
            load_bvh(path)
    for time in ("inf", "1e-320"):
        path.write_text(re.sub("Frame Time: .*", f"Frame Time: {time}", path.read_text()))
        with pytest.raises(ConfigError, match=r"a\.bvh"):
            load_bvh(path)


def test_bad_clips_are_refused(tmp_path):
    path = write_bvh(tmp_path / "arm.bvh", without=("LeftHand",))
    with pytest.raises(
        ConfigError, match=r"the left arm .* not clear from the joints LeftArm, LeftForeArm; name three"
    ):
        load_bvh(path)
    text = write_bvh(tmp_path / "whole.bvh").read_text()
    for content in ("", "no motion", text[:400], text[:-200], text.replace("Frame Time: 0.040000", "Frame Time: nan")):
        path.write_text(content)
        with pytest.raises(ConfigError, match=r"arm\.bvh"):
            load_bvh(path)
    with pytest.raises(ConfigError, match=r"none\.bvh"):
        load_bvh(tmp_path / "none.bvh")
